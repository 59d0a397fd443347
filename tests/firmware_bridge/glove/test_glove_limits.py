"""Heat and nuisance limits, broken motors, sensors and buttons of the glove's core, each at its boundary."""

from __future__ import annotations

import random
import struct

import numpy as np
from numpy.typing import NDArray

from tests.firmware_bridge.glove.rig import GloveRig, spans
from waychair.firmware_bridge.frames import Frame, encode_frame
from waychair.firmware_bridge.glove.messages import Alive, Gain, Play, PlayCut, PlayRefusal, PlayStep, StopPlaying

SHORT = (1 << 2, 200, 50, 10)


def test_steps_out_of_their_limits_are_refused_and_those_at_them_are_played(rig: GloveRig) -> None:
    wrong = [(0, 200, 50, 0), (1 << 9, 200, 50, 0), (1, 0, 50, 0), (1, 200, 0, 0), (1, 200, 501, 0), (1, 200, 50, 2001)]
    right = [(1 << 8, 1, 1, 0), (1, 255, 500, 2000)]
    for step in wrong:
        rig.arm()
        rig.play(SHORT, step)
        assert rig.judged() == PlayRefusal.STEPS, step
        assert not rig.run(50).any()
    for step in right:
        rig.arm()
        rig.play(step)
        assert rig.judged() == 0, step
    rig.play()
    assert rig.judged() == PlayRefusal.STEPS


def test_a_refused_pattern_does_not_disturb_the_one_that_plays(rig: GloveRig) -> None:
    rig.arm()
    rig.play((1 << 7, 195, 100, 0))
    rig.play((1 << 7, 195, 0, 0), priority=255)
    assert spans(rig.run(200), 7) == [(0, 100)]


def test_sixteen_steps_are_played_and_seventeen_are_no_message(rig: GloveRig) -> None:
    rig.arm()
    rig.play(*[(1 << k % 9, 200, 5, 5) for k in range(16)])
    levels = rig.run_alive(200)
    assert [spans(levels, motor)[0] for motor in (0, 8)] == [(1, 5), (81, 5)]
    assert spans(levels, 6)[-1] == (151, 5)
    step = struct.pack("<HBHH", 1, 200, 50, 0)
    for payload in (struct.pack("<BH", 100, 500) + 17 * step, b"\1", struct.pack("<BH", 100, 500) + step[:-1]):
        rig.sequence += 1
        rig.feed(encode_frame(Frame(Play.TYPE, rig.sequence, payload)))
        assert not rig.run_alive(100).any()
    assert rig.report.bad_frames == 3


def test_messages_of_another_length_are_bad(rig: GloveRig) -> None:
    rig.arm()
    kinds = (
        (StopPlaying.TYPE, 1),
        (Gain.TYPE, 15),
        (Gain.TYPE, 17),
        (Alive.TYPE, 0),
        (Alive.TYPE, 2),
        (65, 21),
        (65, 23),
    )
    for count, (kind, length) in enumerate(kinds, 1):
        rig.play(SHORT)
        rig.run(5)
        rig.sequence += 1
        rig.feed(encode_frame(Frame(kind, rig.sequence, bytes(length))))
        assert spans(rig.run_alive(100), 2) == [(0, 45)]
        assert rig.report.bad_frames == count


def test_a_pattern_without_a_whole_motor_in_a_step_is_refused(rig: GloveRig) -> None:
    for opened, shorted in ((1 << 4, 0), (0, 1 << 4)):
        rig.start()
        rig.arm()
        rig.sense(opened=opened, shorted=shorted)
        rig.play((1 << 7, 195, 50, 0), (1 << 4, 195, 50, 0))
        assert rig.judged() == PlayRefusal.FAULTY
        assert not rig.run(100).any()
        rig.play((0b10010, 195, 50, 0))
        levels = rig.run(100)
        assert spans(levels, 1) == [(0, 50)]
        assert spans(levels, 4) == []
        assert (rig.report.open_motors, rig.report.shorted_motors) == (opened, shorted)


def test_a_motor_that_is_switched_off_counts_as_broken(rig: GloveRig) -> None:
    rig.arm()
    for motor in (7, 0):
        rig.send(Gain(bytes(0 if k == motor else 255 for k in range(16))))
        rig.run(1)
        rig.play((1 << motor, 195, 50, 0), (1 << 4, 195, 50, 0))
        assert rig.judged() == PlayRefusal.FAULTY
        rig.play((1 << 8, 195, 50, 0))
        assert rig.judged() == 0


def test_all_reasons_against_a_pattern_are_told_together(rig: GloveRig) -> None:
    rig.arm()
    rig.play((1 << 7, 195, 500, 0), priority=200)
    rig.run(5)
    rig.play(*[(1 << 3, 195, 500, 0)] * 11, (1 << 4, 195, 50, 0))
    rig.run(1)  # the first 64 of its 94 bytes
    rig.sense(worn=False, opened=1 << 4, temperature_c=60)
    reasons = PlayRefusal.FAULTY, PlayRefusal.NOT_WORN, PlayRefusal.HOT, PlayRefusal.DUTY, PlayRefusal.LOWER
    assert rig.judged() == sum(reasons)


def test_the_duty_is_of_the_patterns_own_steps_and_of_every_motor(rig: GloveRig) -> None:
    rig.arm()
    for on_ms in (*[500] * 9, 400):
        rig.play((1, 200, on_ms, 0))
        rig.run_alive(510)
    rig.sense(opened=1 << 8)
    rig.play(*[(1, 200, 1, 0)] * 16)
    rig.run(1)
    assert rig.judged() == 0
    rig.run_alive(100)
    rig.play((1, 200, 85, 0))
    assert rig.judged() == PlayRefusal.DUTY
    rig.play((1, 200, 84, 0))
    assert rig.judged() == 0
    rig.run_alive(100)
    rig.play((2, 200, 100, 0))
    assert spans(rig.run_alive(200), 1) == [(0, 100)]


def test_a_motor_that_breaks_during_its_step_ends_the_pattern(rig: GloveRig) -> None:
    rig.arm()
    rig.play((1 << 7, 195, 100, 0), (1 << 4, 195, 100, 0), (1 << 1, 195, 100, 0))
    rig.run(20)
    rig.sense(opened=1 << 4)
    levels = rig.run(300)
    assert spans(levels, 7) == [(0, 80)]
    assert spans(levels, 4) == spans(levels, 1) == []
    assert PlayCut.FAULTY in {report.cut for report in rig.reports}


def test_a_motor_that_breaks_during_a_rest_ends_the_pattern_only_at_its_step(rig: GloveRig) -> None:
    rig.arm()
    rig.play((1 << 7, 195, 50, 100), (1 << 4, 195, 50, 0))
    rig.run(60)
    rig.sense(opened=1 << 7)
    assert spans(rig.run(200), 4) == [(90, 50)]


def test_a_glove_that_is_not_worn_plays_nothing(rig: GloveRig) -> None:
    rig.arm()
    rig.play((1 << 7, 195, 400, 0))
    rig.run(20)
    rig.sense(worn=False)
    assert not rig.run_alive(200).any()
    assert (rig.report.worn, PlayCut.NOT_WORN in {report.cut for report in rig.reports}) == (0, True)
    rig.play(SHORT)
    assert rig.judged() == PlayRefusal.NOT_WORN
    rig.sense()
    rig.play(SHORT)
    assert rig.judged() == 0


def test_a_warm_glove_plays_nothing_until_it_has_cooled_down(rig: GloveRig) -> None:
    for temperature_c, refused in ((42, 0), (43, PlayRefusal.HOT), (42, PlayRefusal.HOT), (41, 0), (-5, 0)):
        rig.arm()
        rig.sense(temperature_c=temperature_c)
        rig.play(SHORT)
        assert rig.judged() == refused, temperature_c
        assert rig.report.temperature_c == temperature_c
    rig.sense(temperature_c=43)
    assert not rig.run(60).any()
    assert PlayCut.HOT in {report.cut for report in rig.reports}


def test_a_cut_is_reported_once(rig: GloveRig) -> None:
    rig.arm()
    rig.play((1 << 7, 195, 400, 0))
    rig.run(20)
    rig.sense(worn=False)
    rig.run_alive(200)
    assert [report.cut for report in rig.reports].count(PlayCut.NOT_WORN) == 1


def _long(rig: GloveRig, count: int) -> NDArray[np.uint8]:
    """So many halves of a second on the motor 3, each with as long a rest."""
    parts = []
    for _ in range(count):
        rig.play((1 << 3, 200, 500, 500))
        parts.append(rig.run_alive(1000))
    return np.concatenate(parts)


def test_a_motor_vibrates_for_half_of_ten_seconds_at_most(rig: GloveRig) -> None:
    rig.arm()
    for _ in range(9):
        rig.play((1 << 3, 200, 500, 0))
        rig.run_alive(510)
    rig.play((1 << 3, 200, 250, 0), (1 << 3, 200, 251, 0))
    assert rig.judged() == PlayRefusal.DUTY
    rig.play((1 << 5, 200, 500, 0))
    assert rig.judged() == 0  # another motor may
    rig.send(StopPlaying())
    rig.play((1 << 3, 200, 250, 1), (1 << 3, 200, 250, 0))
    rig.run(2)
    assert rig.report.refused == 0
    rig.run_alive(600)
    rig.play((1 << 3, 200, 1, 0))
    assert rig.judged() == PlayRefusal.DUTY
    rig.run_alive(5200)  # the first of them is ten seconds and a bin ago
    rig.play((1 << 3, 200, 200, 0))
    assert rig.judged() == 0


def test_vibration_is_forgotten_ten_seconds_and_a_bin_later_to_the_millisecond(rig: GloveRig) -> None:
    rig.arm()
    rig.run(98)  # the first bin of 100 ms ends here
    begun = rig.now_ms
    for _ in range(10):
        rig.play((1 << 3, 200, 500, 0))
        rig.run_alive(501)
    while True:
        rig.play((1 << 3, 200, 1, 0))
        if rig.judged() == 0:
            break
        assert rig.report.refused == PlayRefusal.DUTY
        rig.run(0 if rig.now_ms > begun + 9990 else 7)
    assert rig.now_ms - begun == 10_101


def test_half_the_time_may_be_used_for_ever(rig: GloveRig) -> None:
    rig.arm()
    assert 0.45 < _long(rig, 40)[:, 3].astype(bool).mean() <= 0.5


def test_a_queued_pattern_that_goes_beyond_the_duty_is_stopped(rig: GloveRig) -> None:
    rig.arm()
    for _ in range(9):
        rig.play((1 << 3, 200, 500, 0))
        rig.run_alive(510)
    rig.play((1 << 3, 200, 300, 10))
    rig.run(1)
    rig.play((1 << 3, 200, 300, 0))
    levels = rig.run_alive(700)
    assert spans(levels, 3) == [(0, 299), (309, 200)]
    assert PlayCut.DUTY in {report.cut for report in rig.reports}


def test_more_than_four_motors_vibrate_for_250_ms_at_most(rig: GloveRig) -> None:
    rig.arm()
    rig.play((0b11111, 200, 250, 0), (1, 200, 50, 0))
    levels = rig.run_alive(400)
    assert spans(levels, 4) == [(0, 250)]
    assert spans(levels, 0) == [(0, 300)]
    rig.run_alive(500)
    rig.play((0b11111, 200, 251, 0), (1, 200, 50, 0))
    levels = rig.run_alive(400)
    assert spans(levels, 0) == spans(levels, 4) == [(0, 250)]
    assert PlayCut.CROWD in {report.cut for report in rig.reports}


def test_four_motors_may_follow_a_crowd_at_once(rig: GloveRig) -> None:
    rig.arm()
    rig.play((0b11111, 200, 250, 0), (0b1111, 200, 100, 0))
    assert spans(rig.run_alive(400), 0) == [(0, 350)]


def test_four_motors_are_no_crowd(rig: GloveRig) -> None:
    rig.arm()
    rig.play((0b1111, 200, 500, 0))
    assert spans(rig.run_alive(700), 0) == [(0, 500)]


def test_a_crowd_is_forgotten_after_a_rest_of_250_ms(rig: GloveRig) -> None:
    for rest, second in ((249, [(0, 200), (449, 50)]), (250, [(0, 200), (450, 200)])):
        rig.start()
        rig.arm()
        rig.play((0b11111, 200, 200, rest), (0b11111, 200, 200, 0))
        assert spans(rig.run_alive(900), 4) == second


def test_a_motor_vibrates_for_500_ms_at_most_without_a_rest(rig: GloveRig) -> None:
    rig.arm()
    rig.play((1, 200, 300, 0), (1, 200, 300, 0), (2, 200, 100, 0))
    levels = rig.run_alive(900)
    assert spans(levels, 0) == [(0, 500)]
    assert spans(levels, 1) == []
    assert PlayCut.RUN in {report.cut for report in rig.reports}
    rig.play((1, 200, 300, 1), (1, 200, 300, 0))
    assert spans(rig.run_alive(900), 0) == [(0, 300), (301, 300)]


def test_a_step_of_the_clock_stops_the_pattern_and_the_queue(rig: GloveRig) -> None:
    for jump, going_on in ((49, True), (50, False)):
        rig.start()
        rig.arm()
        rig.play((1 << 7, 195, 200, 0), (1 << 4, 195, 100, 0))
        rig.run(1)
        rig.play((1 << 5, 195, 100, 0))
        rig.run(1)
        rig.jump(jump)
        levels = rig.run_alive(500)
        assert levels[:, 4].any() == levels[:, 5].any() == going_on
        assert (PlayCut.CLOCK in {report.cut for report in rig.reports}) != going_on


def test_vibration_during_a_hang_counts(rig: GloveRig) -> None:
    rig.arm()
    rig.play((1 << 3, 200, 400, 0))
    rig.run(1)
    rig.jump(2600)
    rig.run(1)
    rig.arm()
    rig.play((1 << 3, 200, 500, 0))
    assert rig.judged() == 0
    rig.jump(2000)
    rig.run(1)
    rig.arm()
    rig.play((1 << 3, 200, 500, 0))
    assert rig.judged() == PlayRefusal.DUTY
    rig.jump(20_000)
    rig.run(1)
    rig.arm()
    rig.play((1 << 3, 200, 500, 0))
    assert rig.judged() == 0


def test_a_button_counts_once_when_it_is_held_for_20_ms(rig: GloveRig) -> None:
    rig.greet()
    for pressed, which in ((1, 0), (2, 1)):
        for ms, presses in ((19, 0), (20, 1), (500, 2)):
            rig.sense(pressed=pressed)
            rig.run_alive(ms) if ms > 100 else rig.run(ms)
            rig.sense()
            rig.run_alive(100)
            assert (rig.report.repeat_presses, rig.report.yes_presses)[which] == presses
    assert (rig.report.repeat_presses, rig.report.yes_presses) == (2, 2)


def test_a_button_that_is_held_for_a_minute_counts_once(rig: GloveRig) -> None:
    rig.greet()
    rig.sense(pressed=1)
    rig.run_alive(70_000)
    assert rig.report.repeat_presses == 1


def worst(levels: NDArray[np.uint8]) -> tuple[int, int, int]:
    """Most vibration of a motor in any 10 s, longest without a rest, longest time of crowds before a rest of 250 ms."""
    on = levels > 0
    sums = np.concatenate([np.zeros((1, 16), int), np.cumsum(on, axis=0)])
    reach = min(10_000, len(on))
    duty = int((sums[reach:] - sums[:-reach]).max())
    run = max((length for motor in range(16) for _, length in spans(levels, motor)), default=0)
    crowd = longest = calm = 0
    for many in on.sum(axis=1) > 4:
        crowd, calm = (crowd + 1, 0) if many else (crowd, calm + 1)
        crowd = 0 if calm >= 250 else crowd
        longest = max(longest, crowd)
    return duty, run, longest


def test_random_commands_break_no_limit(rig: GloveRig) -> None:
    draw = random.Random(5)
    rig.arm()
    parts = []
    for _ in range(300):
        steps = [
            (
                draw.choice([1 << draw.randrange(9), draw.randrange(512)]),
                255,
                draw.randrange(1, 501),
                draw.choice([0, 0, 3]),
            )
            for _ in range(draw.randrange(1, 17))
        ]
        rig.send(Play(draw.choice([100, 100, 101]), 1000, tuple(PlayStep(*step) for step in steps)))
        parts.append(rig.run_alive(draw.randrange(1, 400)))
    duty, run, crowd = worst(np.concatenate(parts))
    assert 4000 < duty <= 5000
    assert 300 < run <= 500
    assert 200 < crowd <= 250
