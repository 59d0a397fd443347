"""The board keeps the time of every step, priorities, one queued pattern, validity, and its session."""

from __future__ import annotations

from dataclasses import replace

from tests.firmware_bridge.glove.rig import GloveRig, spans
from waychair.firmware_bridge.glove.messages import (
    GLOVE_FIRMWARE_VERSION,
    GLOVE_LAYOUT_HASH,
    GLOVE_PROTOCOL_VERSION,
    Alive,
    Gain,
    GloveRefusal,
    GloveState,
    Hand,
    Play,
    PlayRefusal,
    PlayStep,
    StopPlaying,
    encode_glove,
    glove_hello,
)

SHORT = (1 << 2, 200, 50, 10)


def test_a_glove_rests_until_it_is_told_to_play(rig: GloveRig) -> None:
    assert not rig.run(1000).any()
    rig.arm()
    assert not rig.run_alive(1000).any()
    assert rig.report.state == GloveState.ARMED
    assert rig.report.playing == 0


def test_a_greeting_is_answered_with_the_gloves_identity(rig: GloveRig) -> None:
    rig.start(motors=4, hand=Hand.LEFT)
    rig.greet()
    (reply,) = rig.replies
    assert (reply.version, reply.layout_hash) == (GLOVE_PROTOCOL_VERSION, GLOVE_LAYOUT_HASH)
    assert reply.firmware_version == GLOVE_FIRMWARE_VERSION
    assert (reply.device_id, reply.layout, reply.motors, reply.hand) == (b"A".ljust(16, b"\0"), 1, 4, Hand.LEFT)
    assert reply.refused == 0


def test_a_pattern_begins_in_the_millisecond_of_its_frame_and_keeps_its_times(rig: GloveRig) -> None:
    rig.arm()
    number = rig.play((1 << 7, 195, 150, 0), (1 << 4, 195, 150, 20), (1 << 1, 100, 150, 400))
    levels = rig.run(480)
    assert spans(levels, 7) == [(0, 150)]
    assert spans(levels, 4) == [(150, 150)]
    assert spans(levels, 1) == [(320, 150)]
    assert (levels[0, 7], levels[200, 4], levels[400, 1]) == (195, 195, 100)
    assert levels.sum() == 150 * (195 + 195 + 100)
    assert (rig.report.playing, rig.report.sequence, rig.report.step) == (1, number, 2)
    rig.run_alive(450)
    assert rig.report.playing == 0


def test_a_report_names_the_step_and_the_motors_that_vibrate(rig: GloveRig) -> None:
    rig.arm()
    rig.play((0b101, 255, 100, 0), (0b10, 255, 100, 100))
    rig.run(1)
    assert (rig.report.step, rig.report.on) == (0, 0b101)
    rig.run_alive(150)
    assert (rig.report.step, rig.report.on) == (1, 0b10)
    rig.run_alive(100)
    assert (rig.report.step, rig.report.on, rig.report.playing) == (1, 0, 1)


def test_a_gain_scales_the_strength_to_the_nearest_level(rig: GloveRig) -> None:
    rig.arm()
    rig.send(Gain(bytes([255, 128, 62, 0, 255, 255, 255, 255, 255, *([255] * 7)])))
    rig.run(1)
    rig.play((0b1111, 200, 100, 0))
    assert rig.run(10)[5, :5].tolist() == [200, 100, 49, 0, 0]
    rig.greet()
    rig.play((0b11, 200, 100, 0))
    assert rig.run(10)[5, :2].tolist() == [200, 200]


def test_a_higher_priority_interrupts_in_the_same_millisecond_and_clears_the_queue(rig: GloveRig) -> None:
    rig.arm()
    rig.play((1 << 7, 195, 150, 400))
    rig.run(40)
    rig.play((1 << 3, 195, 150, 400))
    rig.run(10)
    rig.play((1 << 0, 255, 50, 0), priority=101)
    levels = rig.run(1)
    assert (levels[0, 7], levels[0, 0]) == (0, 255)
    levels = rig.run_alive(1500)
    assert spans(levels, 0) == [(0, 49)]
    assert spans(levels, 3) == spans(levels, 7) == []


def test_an_equal_priority_queues_one_deep_and_the_last_one_stays(rig: GloveRig) -> None:
    rig.arm()
    rig.play((1 << 7, 195, 100, 100))
    rig.play((1 << 5, 195, 100, 0))
    last = rig.play((1 << 3, 195, 100, 0))
    levels = rig.run(350)
    assert spans(levels, 7) == [(0, 100)]
    assert spans(levels, 5) == []
    assert spans(levels, 3) == [(200, 100)]
    assert rig.report.judged == last


def test_a_lower_priority_is_refused_while_something_plays(rig: GloveRig) -> None:
    rig.arm()
    rig.play((1 << 7, 195, 100, 100))
    rig.run(150)
    rig.play((1 << 3, 195, 100, 0), priority=99)
    assert rig.judged() == PlayRefusal.LOWER
    assert not rig.run(300)[:, 3].any()
    rig.play((1 << 3, 195, 100, 0), priority=99)
    assert rig.judged() == 0


def test_a_queued_pattern_that_has_become_late_is_dropped(rig: GloveRig) -> None:
    for valid_ms, begun in ((198, []), (199, [(200, 50)])):
        rig.arm()
        rig.play((1 << 7, 195, 100, 100))
        rig.play((1 << 3, 195, 50, 0), valid_ms=valid_ms)
        assert spans(rig.run(400), 3) == begun
        assert rig.report.playing == 0


def test_only_one_queued_pattern_follows(rig: GloveRig) -> None:
    rig.arm()
    rig.play((1 << 7, 195, 50, 50))
    rig.play((1 << 3, 195, 50, 50))
    assert spans(rig.run(450), 3) == [(100, 50)]


def test_stop_rests_all_motors_and_forgets_the_queue(rig: GloveRig) -> None:
    rig.arm()
    rig.play((0b11, 195, 100, 100))
    rig.play((1 << 3, 195, 100, 100))
    rig.run(20)
    rig.send(StopPlaying())
    assert not rig.run(400).any()


def test_the_board_says_that_nobody_speaks_500_ms_after_the_last_frame_once(rig: GloveRig) -> None:
    rig.arm()
    levels = rig.run(1500)
    assert spans(levels, 0) == [(499, 200), (999, 200)]
    assert (levels[510, :9] == 255).all()
    assert not levels[:, 9:].any()
    assert rig.report.state == GloveState.LOST
    rig.send(Alive(1))
    rig.play(SHORT)
    assert not rig.run(2000).any()
    assert {report.cut for report in rig.reports} == {0}
    assert rig.report.rejected == 2


def test_a_pattern_in_play_and_the_queue_end_when_nobody_speaks(rig: GloveRig) -> None:
    rig.arm()
    rig.play((1 << 7, 195, 450, 300))
    rig.play((1 << 5, 195, 450, 300), valid_ms=5000)
    levels = rig.run(3000)
    assert spans(levels, 5) == [(501, 200), (1001, 200)]  # the second frame is heard a millisecond later
    assert spans(levels, 7) == [(0, 450), (501, 200), (1001, 200)]


def test_without_advice_the_board_goes_quiet_in_silence(rig: GloveRig) -> None:
    rig.greet()
    rig.play((1 << 7, 195, 300, 10), (1 << 7, 195, 300, 10))
    levels = rig.run(1000)
    assert spans(levels, 7) == [(0, 300), (310, 190)]
    assert rig.report.state == GloveState.WAITING
    rig.play(SHORT)
    assert not rig.run(100).any()
    rig.greet()
    rig.send(Alive(1), Alive(0))
    rig.run(2)
    assert rig.run(1000).any() == False
    assert rig.report.state == GloveState.WAITING


def test_silence_of_a_millisecond_less_is_no_silence(rig: GloveRig) -> None:
    rig.arm()
    for _ in range(5):
        assert not rig.run(499).any()
        rig.send(Alive(1))
        rig.run(1)
    assert rig.report.state == GloveState.ARMED


def test_every_accepted_frame_is_a_sign_of_life_and_a_stale_one_is_none(rig: GloveRig) -> None:
    rig.arm()
    for message in (StopPlaying(), Gain(bytes([255] * 16)), Alive(1)):
        rig.run(400)
        rig.send(message)
        assert not rig.run(1).any()
    rig.run(400)
    rig.sequence -= 1
    rig.send(Alive(1))
    assert rig.run(200).any()


def test_only_the_next_32_numbers_are_accepted(rig: GloveRig) -> None:
    for ahead, accepted in ((0, False), (1, True), (32, True), (33, False), (-1, False)):
        rig.start()
        rig.sequence = 0xFFF0
        rig.arm()
        rig.sequence += ahead - 1
        rig.play(SHORT)
        assert rig.run(10).any() == accepted, ahead


def test_a_greeting_during_a_pattern_ends_it(rig: GloveRig) -> None:
    rig.arm()
    rig.play(SHORT)
    rig.run(5)
    rig.play(SHORT, priority=1)
    assert rig.judged() == PlayRefusal.LOWER
    rig.send(glove_hello("A", 1))
    assert not rig.run(100).any()
    assert rig.report.state == GloveState.READY
    assert (rig.report.judged, rig.report.refused) == (0, 0)


def test_a_greeting_takes_the_board_out_of_silence_at_once(rig: GloveRig) -> None:
    rig.arm()
    assert rig.run(600).any()
    rig.send(glove_hello("A", 1))
    assert not rig.run(300).any()
    rig.play(SHORT)
    assert rig.run(10).any()


def test_each_kind_of_another_computer_is_refused_and_its_patterns_too(rig: GloveRig) -> None:
    ours = glove_hello("A", 1)
    strangers = {
        GloveRefusal.VERSION: replace(ours, version=GLOVE_PROTOCOL_VERSION + 1),
        GloveRefusal.TABLE: replace(ours, layout_hash=GLOVE_LAYOUT_HASH ^ 0x01000000),
        GloveRefusal.DEVICE: glove_hello("AB", 1),
        GloveRefusal.LAYOUT: glove_hello("A", 2),
    }
    for refused, stranger in strangers.items():
        rig.start()
        rig.arm()
        rig.send(stranger)
        rig.run(1)
        assert rig.replies[-1].refused == refused
        rig.play(SHORT)
        assert not rig.run(100).any()
        assert rig.report.state == GloveState.WAITING
        assert rig.report.rejected == 2
    rig.send(replace(glove_hello("B", 2), version=2, layout_hash=1))
    rig.run(1)
    assert rig.replies[-1].refused == sum(strangers)


def test_reports_come_every_50_ms_and_at_once_after_a_pattern(rig: GloveRig) -> None:
    rig.greet()
    count = len(rig.reports)
    rig.run_alive(100)
    assert len(rig.reports) - count == 2
    first, second = rig.reports[-2:]
    assert second.board_ms - first.board_ms == 50
    count = len(rig.reports)
    rig.send(Alive(0))
    rig.run(1)
    assert len(rig.reports) == count
    rig.play(SHORT)
    rig.run(1)
    assert len(rig.reports) == count + 1
    assert rig.numbers == list(range(len(rig.numbers)))


def test_a_greeting_is_a_sign_of_life(rig: GloveRig) -> None:
    rig.greet()
    rig.run(499)
    rig.send(Alive(1))
    rig.run(60)
    assert (rig.report.state, rig.report.rejected) == (GloveState.ARMED, 0)


def test_the_weakest_vibration_is_reported(rig: GloveRig) -> None:
    rig.arm()
    rig.play((1 << 2, 1, 50, 0))
    assert rig.run(1)[0, 2] == 1
    assert rig.report.on == 1 << 2


def test_the_hardware_is_started_with_its_number_of_motors(rig: GloveRig) -> None:
    assert rig.core.rig_motors() == 9


def test_a_queued_pattern_is_played_whole_after_a_late_step(rig: GloveRig) -> None:
    rig.arm()
    rig.play((1 << 7, 195, 50, 10))
    rig.run(1)
    rig.play((1 << 5, 195, 100, 0))
    rig.run(1)
    rig.run(40)
    rig.jump(40)
    assert spans(rig.run(200), 5) == [(0, 100)]


def test_the_watchdog_is_served_every_millisecond(rig: GloveRig) -> None:
    rig.run(123)
    assert rig.core.rig_kicks() == 123


def test_the_clock_may_pass_2_to_the_32_in_the_middle_of_a_pattern(rig: GloveRig) -> None:
    rig.start(now_ms=2**32 - 60)
    rig.arm()
    rig.play((1 << 7, 195, 100, 0), (1 << 4, 195, 100, 0))
    levels = rig.run(300)
    assert spans(levels, 7) == [(0, 100)]
    assert spans(levels, 4) == [(100, 100)]


def test_a_board_with_more_motors_than_a_mask_holds_drives_sixteen(rig: GloveRig) -> None:
    for motors in (16, 17):
        rig.start(motors=motors)
        rig.arm()
        rig.play((1 << 15, 195, 100, 0))
        assert spans(rig.run(200), 15) == [(0, 100)]


def test_a_burst_of_frames_takes_a_millisecond_each(rig: GloveRig) -> None:
    rig.greet()
    rig.play(SHORT)
    rig.send(StopPlaying())
    rig.play((1 << 3, 195, 100, 0))
    levels = rig.run(200)
    assert spans(levels, 2) == [(0, 1)]
    assert spans(levels, 3) == [(2, 100)]


def test_64_bytes_are_taken_in_a_millisecond(rig: GloveRig) -> None:
    for last, begun in ((256, 3), (257, 4)):
        rig.start()
        rig.greet()
        frame = encode_glove(Play(100, 500, (PlayStep(*SHORT),)), rig.sequence + 1)
        rig.feed(bytes(last - len(frame)) + frame)  # zeros between frames are padding
        assert spans(rig.run(10), 2)[0][0] == begun


def test_other_messages_are_counted_as_bad_and_do_nothing(rig: GloveRig) -> None:
    rig.greet()
    rig.send(rig.replies[0])
    rig.feed(b"\x05\x01\x02\x03\x04\x00")
    rig.run_alive(100)
    assert rig.report.bad_frames == 2
    rig.feed(encode_glove(Alive(2), rig.sequence + 1))
    rig.run(100)
    assert rig.report.bad_frames == 3
    assert rig.report.rejected == 0
