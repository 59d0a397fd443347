"""The generator of corrupted recordings: every fault changes the recording, and a seed gives the same one again."""

from __future__ import annotations

import hashlib
import math
from pathlib import Path

import numpy as np
import pytest
from evaluation.corruptions import drawing
from evaluation.corruptions.drawing import FAULTS, Corrupted, corrupted, fault_of
from evaluation.corruptions.fault import Fault
from evaluation.corruptions.messages import Event, Messages
from evaluation.corruptions.odometry_faults import odometry_jumps
from evaluation.corruptions.verdict import Verdict, judged, names
from evaluation.corruptions.warm_runner import Run

SHORT = 200
"""Messages of a shortened drive: all kinds of them, some of them each."""

RUN = Run(0, "", 2.0, 3.0, 300.0)


def packed(messages: Messages) -> bytes:
    """Return all that a bag of the messages would hold."""
    store = messages.store
    parts: list[bytes] = []
    for event in messages.events:
        data = bytes(store.serialize_cdr(event.body, event.body.__msgtype__))
        data = data if event.raw is None else event.raw(data)
        parts += [event.topic.encode(), event.kind.encode(), str(event.log_ns).encode(), data]
    return hashlib.sha256(b"|".join(parts)).digest()


def shortened(*, clouds: bool) -> Messages:
    """Return the sound drive with one of many messages of each topic."""
    whole = drawing.sound_messages(2, clouds=clouds)
    kept: list[Event] = []
    for topic in dict.fromkeys(event.topic for event in whole.events):
        own = whole.of(topic)
        kept += own[:: max(1, len(own) // SHORT)]
    return Messages(2, sorted(kept, key=lambda event: event.log_ns))


@pytest.mark.parametrize("fault", [fault for fault in FAULTS if fault.messages], ids=lambda fault: fault.name)
def test_a_fault_of_messages_changes_them_and_a_seed_does_the_same_again(fault: Fault) -> None:
    assert fault.messages is not None
    clouds = fault.where == "clouds"
    drawn = []
    for seed in (3, 3, 4, 5):
        messages = shortened(clouds=clouds)
        with np.errstate(all="ignore"):
            fault.messages(messages, np.random.default_rng(seed))
            drawn.append(packed(messages))
    sound = packed(shortened(clouds=clouds))
    assert drawn[0] == drawn[1]
    assert any(each != sound for each in drawn[1:])
