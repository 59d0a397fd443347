"""Interrupts during a wait of rclpy are handled after it."""

from __future__ import annotations

import signal
import threading

import pytest

from waychair.ros.interrupts import held_interrupts


def test_an_interrupt_is_raised_when_the_block_has_ended() -> None:
    went_on: list[bool] = []

    def wait() -> None:
        with held_interrupts():
            signal.raise_signal(signal.SIGINT)
            went_on.append(True)

    with pytest.raises(KeyboardInterrupt):
        wait()
    assert went_on
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)


def test_a_handler_of_another_signal_is_called_once_and_stays() -> None:
    came: list[int] = []

    def note(number: int, frame: object) -> None:
        came.append(number)

    before = signal.signal(signal.SIGTERM, note)
    try:
        with held_interrupts():
            signal.raise_signal(signal.SIGTERM)
            assert came == []
        assert came == [signal.SIGTERM]
        assert signal.getsignal(signal.SIGTERM) is note
    finally:
        signal.signal(signal.SIGTERM, before)


def test_an_error_of_the_block_is_kept_beside_the_interrupt() -> None:
    def fail() -> None:
        with held_interrupts():
            signal.raise_signal(signal.SIGINT)
            raise ValueError("of the block")

    with pytest.raises(KeyboardInterrupt) as raised:
        fail()
    assert isinstance(raised.value.__context__, ValueError)


def test_other_threads_leave_the_handlers_alone() -> None:
    seen: list[object] = []
    before = signal.getsignal(signal.SIGINT)

    def look() -> None:
        with held_interrupts():
            seen.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=look)
    thread.start()
    thread.join()
    assert seen == [before]
