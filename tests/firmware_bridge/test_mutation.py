"""A sample of the mutation run: wrong changes to the firmware are noticed, or explained in survivors.txt."""

from __future__ import annotations

import random

import pytest

from tests.firmware_bridge.mutation import explained, mutants, run


@pytest.mark.parametrize("count", [4, pytest.param(12, marks=pytest.mark.nightly)])
def test_a_sample_of_wrong_changes_is_noticed_or_explained(count: int) -> None:
    reasons = explained()
    chosen = random.Random(3).sample(mutants(), count)
    results = run(chosen)
    assert [mutant.name() for mutant, fate in results if fate == "survived" and mutant.name() not in reasons] == []
    assert sum(fate == "killed" for _, fate in results) >= count // 2


def test_every_explanation_belongs_to_an_existing_mutant_and_gives_a_reason() -> None:
    names = {mutant.name() for mutant in mutants()}
    for name, reason in explained().items():
        assert name in names
        assert len(reason) > 20, name


def test_there_are_mutants_of_every_kind_in_every_file() -> None:
    everything = mutants()
    assert len(everything) > 400
    assert {mutant.file for mutant in everything} == {
        "safety_core.h",
        "safety_core.c",
        "axes.h",
        "guard.h",
        "guard.c",
        "frame.c",
        "protocol.c",
        "converter.c",
    }
    assert all(mutant.changed != mutant.original for mutant in everything)
