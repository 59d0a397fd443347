"""`pytest tests/replay --update --reason "why"` makes the present outputs the reference; `--record` also records a new
drive."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.runtime.riding import coarse_arcs


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("replay")
    group.addoption("--update", action="store_true", help="make today's outputs the reference; needs --reason")
    group.addoption("--record", action="store_true", help="drive anew in the simulator, then as --update")
    group.addoption("--reason", default="", help="why the outputs are others, in a sentence that is kept")


def pytest_configure(config: pytest.Config) -> None:
    rewrites = config.getoption("--update", False) or config.getoption("--record", False)
    if rewrites and not str(config.getoption("--reason", "")).strip():
        raise pytest.UsageError(
            'the references are not rewritten without a reason: say --reason "why the outputs are others"'
        )


@pytest.fixture(scope="package", autouse=True)
def _coarse_arcs() -> Iterator[None]:
    """The references were recorded with few arcs per tick."""
    with coarse_arcs():
        yield
