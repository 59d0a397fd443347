"""`waychair` as a user types it; few tests start a process, as its imports take a second or two."""

from __future__ import annotations

import contextlib
import io
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

from waychair.cli.main import main

WAYCHAIR = Path(sys.executable).parent / "waychair"
"""The installed program, for tests that start, interrupt or kill a process."""


def waychair(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """Run the program in this process and return its output and exit code; unexpected errors are raised."""
    command, said, told, code = [str(WAYCHAIR), *map(str, arguments)], io.StringIO(), io.StringIO(), 0
    with contextlib.ExitStack() as stack:
        stack.enter_context(pytest.MonkeyPatch.context()).setattr(sys, "argv", command)
        stack.enter_context(warnings.catch_warnings())
        warnings.filterwarnings("ignore", "Cyclopts application invoked without tokens")  # as `main` does on purpose
        stack.enter_context(contextlib.redirect_stdout(said))
        stack.enter_context(contextlib.redirect_stderr(told))
        try:
            main()
        except SystemExit as end:
            code = int(end.code or 0)
    return subprocess.CompletedProcess(command, code, said.getvalue(), told.getvalue())


def started(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """Run the installed program in a separate process."""
    command = [str(WAYCHAIR), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def refused(done: subprocess.CompletedProcess[str]) -> str:
    """Return the single sentence on standard error of a failed command."""
    assert done.returncode == 1, done.stdout
    assert "Traceback" not in done.stderr
    (sentence,) = [line for line in done.stderr.splitlines() if line.startswith("waychair: ")]
    return sentence
