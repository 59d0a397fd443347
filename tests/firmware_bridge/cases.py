"""All tests of the firmware that need nothing but a `Rig`, run against a given library: `cases.py LIBRARY`.

The same tests that pytest runs, so that they can be run under sanitizers, for coverage and against mutants, where one
process per library matters. The first failure ends the run with status 1.
"""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable
from pathlib import Path

from tests.firmware_bridge import (
    test_protocol,
    test_safety_core_guard,
    test_safety_core_guard_faults,
    test_safety_core_guard_override,
    test_safety_core_host,
    test_safety_core_lines,
    test_safety_core_stops,
    test_safety_core_sweeps,
)
from tests.firmware_bridge.rig import Rig, load_core

MODULES = (
    test_protocol,
    test_safety_core_guard,
    test_safety_core_guard_faults,
    test_safety_core_guard_override,
    test_safety_core_host,
    test_safety_core_lines,
    test_safety_core_stops,
    test_safety_core_sweeps,
)


def cases() -> list[Callable[[Rig], None]]:
    """The tests with `rig` as their only argument, in the order of their modules."""
    functions = [value for module in MODULES for name, value in vars(module).items() if name.startswith("test_")]
    return [function for function in functions if list(inspect.signature(function).parameters) == ["rig"]]


def failure(library: Path) -> str:
    """Name of the first test that the library fails; empty when it passes all."""
    rig = Rig(load_core(library))
    for case in cases():
        rig.start()
        try:
            case(rig)
        except AssertionError:
            return case.__name__
    return ""


if __name__ == "__main__":
    sys.exit(1 if failure(Path(sys.argv[1])) else 0)
