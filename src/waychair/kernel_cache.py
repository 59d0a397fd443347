"""Loading of numba's compiled kernels from their cache, and compiling them, without what numba does beside that.

Before it looks into its cache, numba fills its compiler's tables: it imports sixty modules of its own, and scipy.linalg to
see whether there is a BLAS. A short command spends more time on that than on its own work. `load_lightly` looks into the
cache first; a kernel that is not there is compiled as ever, with everything loaded.

While it compiles, numba spends a tenth of the time on three things of no use here. It compares flags by tables of all
options whenever it looks for the implementation of a function, as their hash is the same for all. It notes when each call of
LLVM begins and ends. And garbage is collected again and again among its many objects, hardly any of which are a ring.
`compile_lightly` leaves that out; the compiled code stays the same.
"""

from __future__ import annotations

import gc
from collections.abc import Callable
from functools import cache
from typing import Any


@cache
def load_lightly() -> None:
    """Let this process load kernels from the cache first; later calls do nothing.

    A numba whose inside is another than the known one keeps its own way.
    """
    from numba.core import caching
    from numba.core.runtime.nrt import rtsys

    numba_way: Any = getattr(caching.Cache, "load_overload", None)
    if numba_way is None or not hasattr(caching.Cache, "_load_overload") or not hasattr(rtsys, "initialize"):
        return

    def load_overload(kept: Any, sig: Any, target_context: Any) -> Any:
        """Return the kernel of a signature from the cache, or None, as `Cache.load_overload` does."""
        try:
            _import_array_functions()
            rtsys.initialize(target_context)
            found = kept._load_overload(sig, target_context)
        except (AttributeError, ImportError, KeyError, OSError, TypeError):  # left to numba, which knows its cache best
            found = None
        return numba_way(kept, sig, target_context) if found is None else found

    caching.Cache.load_overload = load_overload  # type: ignore[method-assign]


@cache
def compile_lightly() -> None:
    """Let this process compile kernels in less time; later calls do nothing.

    A numba whose inside is another than the known one keeps its own way.
    """
    from numba.core import event, targetconfig

    config: Any = targetconfig.TargetConfig
    if not hasattr(config, "options") or getattr(config, "__slots__", None) != ["_values"]:
        return
    equal = config.__eq__
    name_hashes: dict[type, int] = {}

    def has_equal_options(flags: Any, other: Any) -> Any:
        """Compare the options that are set in either; all others have the default of the class in both."""
        if type(flags) is not type(other):
            return equal(flags, other)
        own, others, options = flags._values, other._values, flags.options
        return own == others or all(
            own.get(name, options[name].default) == others.get(name, options[name].default) for name in {*own, *others}
        )

    def hash_of_names(flags: Any) -> int:
        """Return numba's own hash, which depends on the class alone."""
        kind = type(flags)
        if kind not in name_hashes:
            name_hashes[kind] = hash(tuple(sorted(flags.options)))
        return name_hashes[kind]

    config.__eq__ = has_equal_options
    config.__hash__ = hash_of_names
    for name in ("start_event", "end_event"):
        setattr(event, name, _without_calls_of_llvm(getattr(event, name)))

    class Compiling(event.Listener):
        """Has no garbage collected while a kernel is compiled, with the kernels that it calls."""

        depth = 0
        collects = True

        def on_start(self, event: event.Event) -> None:
            if self.depth == 0:
                self.collects = gc.isenabled()
                gc.disable()
            self.depth += 1

        def on_end(self, event: event.Event) -> None:
            self.depth -= 1
            if self.depth == 0 and self.collects:
                gc.enable()

    event.register("numba:compile", Compiling())  # type: ignore[no-untyped-call]


def _without_calls_of_llvm(numba_way: Callable[..., None]) -> Callable[..., None]:
    """Return a function that notes all events but the calls of LLVM, a hundred thousand in a minute."""

    def note(kind: str, *details: Any, **named: Any) -> None:
        if kind != "numba:llvm_lock":
            numba_way(kind, *details, **named)

    return note


@cache
def _import_array_functions() -> None:
    """Import numba's array functions, to which cached kernels refer, without a search for BLAS.

    scipy, which brings the BLAS, is there with waychair; a kernel that calls it finds it by itself.
    """
    from numba.np import linalg

    search: Any = getattr(linalg, "ensure_blas", None)
    if search is None:
        return
    linalg.ensure_blas = lambda: None
    try:
        from numba.np import arraymath

        arraymath.ensure_blas = search  # type: ignore[attr-defined]
    finally:
        linalg.ensure_blas = search
