"""The numba kernels of a chair that this process has loaded or compiled."""

from __future__ import annotations

import gc

from numba.core.dispatcher import Dispatcher


def loaded_kernels() -> set[tuple[str, str, int]]:
    """Return module, name and number of loaded signatures of a chair's kernels in this process."""
    functions = (thing for thing in gc.get_objects() if isinstance(thing, Dispatcher))
    named = {(each.py_func.__module__, each.py_func.__name__, len(each.signatures)) for each in functions}
    return {
        each for each in named if each[0].startswith("waychair.") and not each[0].startswith("waychair.simulation.")
    }
