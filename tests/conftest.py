"""Shared by all tests: the folder of the real recordings, interrupts, and a report of every test that was skipped."""

from __future__ import annotations

import gc
import os
import re
import signal
import sys
from collections import defaultdict
from collections.abc import Generator
from pathlib import Path

import pytest
from hypothesis import settings

from waychair.kernel_cache import compile_lightly

# The first call of a kernel loads or compiles it, which does not make a test slow. The same examples every time, so
# that a run is repeatable; `pytest --hypothesis-profile=search`, as in `make nightly`, draws new and more ones.
settings.register_profile("waychair", deadline=None, derandomize=True, max_examples=30)
settings.register_profile("search", deadline=None)
settings.load_profile("waychair")

# A shell starts background jobs with interrupts ignored, which processes of the tests would inherit.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

ROOT = Path(__file__).resolve().parent.parent

MAY_BE_SKIPPED = (
    "keeps real time: ",  # `make test` runs these one after the other, beside all others
    "there is a GPU",
    "this numba has no CUDA target",
    "Open3D is not installed",  # no wheel for every Python
    "mounting a small disk takes an administrator",
    "this system has no /dev/full",
    "ROS's own launch hides",
    "gcov is not installed",
    "this C compiler has no AddressSanitizer",
    "the published schemas of VDA 5050 are not here",  # own lists of their fields are checked everywhere
)
"""Reasons that `.ci/run` accepts. It fails where a browser, a camera, ROS, the firmware or the recordings are missing."""


@pytest.hookimpl(tryfirst=True)  # before pytest leaves out the nightly ones
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip the tests that keep real time, unless this run is for them; mark the cases beyond a sample as nightly."""
    cases: defaultdict[tuple[str, int], list[pytest.Item]] = defaultdict(list)
    for item in items:
        sample = item.get_closest_marker("sampled")
        if sample is not None:
            cases[item.nodeid.split("[")[0], sample.args[0]].append(item)
    for (_, count), alike in cases.items():
        sampled = {k * len(alike) // count for k in range(count)}
        for k, item in enumerate(alike):
            if k not in sampled:
                item.add_marker(pytest.mark.nightly)
    if os.environ.get("WAYCHAIR_REALTIME") == "1":
        return
    alone = pytest.mark.skip(reason="keeps real time: run with WAYCHAIR_REALTIME=1, in one process")
    for item in items:
        if item.get_closest_marker("realtime"):
            item.add_marker(alone)


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Collect tests without a garbage collector, which would find nothing and take two fifths of the time.

    Later it leaves out the imported modules, which stay.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()
        if "numba" in sys.modules:
            compile_lightly()


_skipped: defaultdict[str, list[str]] = defaultdict(list)


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Remember each skipped test by its reason."""
    _remember(report)


def pytest_collectreport(report: pytest.CollectReport) -> None:
    """Remember each skipped module."""
    _remember(report)


def _remember(report: pytest.TestReport | pytest.CollectReport) -> None:
    if report.skipped and not hasattr(report, "wasxfail"):
        reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
        reason = re.sub(r"^Skipped: ", "", reason)
        if report.nodeid not in _skipped[reason]:
            _skipped[reason].append(report.nodeid)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say which tests were skipped and why; under `WAYCHAIR_REQUIRE_ALL=1` say which reasons fail the run."""
    for reason, tests in sorted(_skipped.items()):
        kind = "may be skipped" if reason.startswith(MAY_BE_SKIPPED) else "MISSING"
        terminalreporter.write_line(
            f"skipped ({kind}): {len(tests)}: {reason}: {tests[0]}" + (" ..." * (len(tests) > 1))
        )


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Fail the run under `WAYCHAIR_REQUIRE_ALL=1` if a test was skipped for a reason that is not accepted."""
    missing = [reason for reason in _skipped if not reason.startswith(MAY_BE_SKIPPED)]
    if missing and os.environ.get("WAYCHAIR_REQUIRE_ALL") == "1" and session.exitstatus == pytest.ExitCode.OK:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """Folder of the real recordings (`WAYCHAIR_DATA`, default ../shared/data): skips without it, unless required."""
    folder = Path(os.environ.get("WAYCHAIR_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        message = f"no recordings at {folder}: set WAYCHAIR_DATA to the folder that holds lidar_intel"
        if os.environ.get("WAYCHAIR_REQUIRE_DATA") == "1":
            pytest.fail(message)
        pytest.skip(message)
    return folder
