"""Loading of numba's compiled kernels from their cache, without what numba loads in case that it has to compile.

Before it looks into its cache, numba fills its compiler's tables: it imports sixty modules of its own, and scipy.linalg to
see whether there is a BLAS. A short command spends more time on that than on its own work. `load_lightly` looks into the
cache first; a kernel that is not there is compiled as ever, with everything loaded.
"""

from __future__ import annotations

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
