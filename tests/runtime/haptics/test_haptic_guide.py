"""A chair leads its rider by the glove's program; a channel that fails is named, and nothing wrong is ever felt."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from tests.runtime.haptics.guided_rider import DESK, START, TICK_MS, GuidedRider
from waychair.control.behaviours.commands import Move, Signal, SignalKind
from waychair.control.behaviours.sonar import Obstacle
from waychair.control.haptics.profile import HapticsProfile
from waychair.control.haptics.symbols import Advice, Symbol
from waychair.control.haptics.turned_device import IN_A_ROW
from waychair.control.safety.guard import GUARD_ENDED, SPOKEN
from waychair.firmware_bridge.glove.bridge import SILENT
from waychair.firmware_bridge.glove.program import GloveConfig, GloveInputs
from waychair.runtime.haptics.haptic_guide import AS_PAPER, LOST, OVERRIDE_BEGINS, UNGUARDED
from waychair.runtime.haptics.haptic_state import HapticInputs, RiderSurroundings
from waychair.types import GuardReport, HelpLevel, JoystickInput, Place, Pose2, Twist

FORWARD = {7, 4, 1}
FREE = GuardReport((1.0, 1.0, 1.0, 1.0))


@pytest.fixture
def rider() -> Iterator[GuidedRider]:
    with GuidedRider() as led:
        yield led


@pytest.fixture
def voice(tmp_path: Path) -> Path:
    """A speech program that writes down what it has said to the end."""
    program = tmp_path / "espeak-ng"
    program.write_text(f'#!/bin/sh\nsleep 0.3\necho "$6" >> {tmp_path}/spoken\n')
    program.chmod(0o755)
    return program


def has_spoken(voice: Path, sentence: str) -> bool:
    """Wait for a sentence to be spoken to its end, as the speech program runs beside the test; False after 10 s."""
    log, end_s = voice.parent / "spoken", time.monotonic() + 10.0
    while time.monotonic() < end_s:
        if log.exists() and sentence in log.read_text().splitlines():
            return True
        time.sleep(0.01)
    return False


def test_a_rider_who_only_feels_is_called_to_attention_when_leading_ends_once_the_chair_is_at_rest(
    rider: GuidedRider,
) -> None:
    rider.guide.lead(DESK)
    rider.run(1500)
    rider.twist = Twist(0.3)
    rider.guide.end("a test has ended it")
    began, count = rider.now_ms, rider.states[-1].count
    assert rider.run(1000).symbol == ""  # the sentence alone while the chair moves
    assert rider.felt(began) == set()
    rider.twist = Twist()
    state = rider.run(1500)
    assert (state.symbol, state.text) == ("attention", "You are no longer led: a test has ended it.")
    assert rider.felt(began) == {4}
    assert state.count == count + 2  # once


def test_nobody_who_stands_is_sent_ahead_while_the_guard_itself_lets_nothing_pass(rider: GuidedRider) -> None:
    rider.guide.lead(DESK)
    said = dict[float, list[str]]()
    for front in (0.0, 1.0):
        began = len(rider.states)
        for _ in range(4000 // TICK_MS):
            now = HapticInputs(
                rider.now_ms * 1_000_000, START, Twist(), HelpLevel.GUIDE, "", JoystickInput(0), FREE,
                own_caps=(front, 1.0, 1.0, 1.0),
            )  # fmt: skip
            rider.states.append(rider.guide.step(now))
            rider.now_ms += TICK_MS
            rider.glove.step(rider.now_ms, rider.inputs)
        said[front] = rider.said(began)
    assert "forward" not in said[0.0]
    assert "forward" in said[1.0]


def test_nobody_is_led_at_the_level_guide_before_the_board_guards_and_the_rider_is_told_how_it_begins(
    rider: GuidedRider,
) -> None:
    rider.guard = None
    rider.guide.lead(DESK)
    state = rider.run(3000)
    assert state.withheld == UNGUARDED
    assert (state.symbol, state.text) == ("attention", f"Wait: {UNGUARDED}.")
    assert set(rider.said()) <= {"attention", ""}
    rider.guard = FREE
    assert rider.run(1000).symbol == "forward"
    rider.level = HelpLevel.INFORM
    assert rider.run(3000).withheld == ""


def test_yes_on_the_glove_takes_the_offer_to_say_it_again_and_means_nothing_without_one(rider: GuidedRider) -> None:
    rider.guide.lead(DESK)
    count = rider.run(800).count
    rider.press(yes=True)
    assert rider.run(100).count == count
    while not rider.run(500).offers:
        assert rider.now_ms < 60_000
    rider.run(2000)  # attention has been felt
    count = rider.states[-1].count
    assert rider.run(1000).count == count  # the guide is silent
    rider.press(yes=True)
    state = rider.run(600)
    assert (state.symbol, state.count) == ("forward", count + 1)


def test_attention_cuts_no_sentence_short(voice: Path) -> None:
    with GuidedRider(voice=voice) as rider:
        rider.guide.lead(DESK)
        rider.run(1500)
        rider.guide.end("a test has ended it")
        assert rider.run(1500).symbol == "attention"
        assert has_spoken(voice, "You are no longer led: a test has ended it.")


def test_a_rider_who_is_led_feels_the_first_step_and_the_state_names_it(rider: GuidedRider) -> None:
    began = rider.now_ms
    assert rider.run(200).count == 0  # nobody is led yet
    rider.guide.lead(DESK)
    state = rider.run(700)
    assert rider.felt(began) == FORWARD
    assert (state.goal, state.symbol, state.unfelt, state.withheld) == ("desk", "forward", "", "")
    assert state.step == "straight 4.0 m"
    assert state.play == (((7,), 150, 0), ((4,), 150, 0), ((1,), 150, 400))
    assert state.glove is not None
    assert (state.glove.alive, state.glove.problem, state.glove.broken) == (True, "", ())


def test_a_rider_who_obeys_is_told_the_end_ahead_of_time_and_arrives(rider: GuidedRider) -> None:
    rider.guide.lead(DESK)
    rider.run(1100)
    rider.twist = Twist(0.5, 0.0)
    for _ in range(400):
        state = rider.run(50)
        if state.symbol == "arrived":
            break
    assert rider.pose is not None
    ahead = DESK.pose.x - rider.pose.x
    assert 0.4 < ahead < 0.8  # the pattern and the rider's lag at 0.5 m/s
    rider.run(1000)
    rider.twist = Twist()
    state = rider.run(1000)
    assert (state.arrived, state.goal) == (True, "")


def test_a_glove_that_is_unplugged_is_named_and_the_steps_are_withheld_until_it_is_back(rider: GuidedRider) -> None:
    rider.guide.lead(DESK)
    rider.run(1000)
    rider.inputs = GloveInputs(powered=False)
    state = rider.run(1000)
    assert (state.withheld, state.goal, state.level) == (SILENT, "desk", HelpLevel.GUIDE)
    assert state.glove is not None
    assert not state.glove.alive
    assert SILENT in state.notices
    count = state.count
    assert rider.run(4000).count == count  # it says nothing, and pretends nothing
    rider.inputs = GloveInputs()  # the board boots again
    began = rider.now_ms
    state = rider.run(2500)
    assert (state.withheld, state.symbol) == ("", "forward")
    assert rider.felt(began) == FORWARD


def test_a_glove_that_dies_leaves_the_voice(voice: Path) -> None:
    with GuidedRider(voice=voice) as rider:
        rider.glove.kill()
        rider.run(1000)
        rider.guide.lead(DESK)
        state = rider.run(1000)
        assert (state.withheld, state.symbol) == ("", "forward")
        assert state.unfelt.startswith("the glove cannot be reached")
        assert has_spoken(voice, "forward")


@pytest.mark.parametrize(
    ("config", "named"),
    [
        (GloveConfig(device_id="B"), "this is the glove 'B'"),
        (GloveConfig(layout="belt_8"), "the glove has the layout 'belt_8'"),
    ],
)
def test_another_glove_is_refused_by_its_name_and_feels_like_none(config: GloveConfig, named: str) -> None:
    with GuidedRider(config) as rider:
        rider.guide.lead(DESK)
        state = rider.run(1500)
        assert state.withheld.startswith(named)
        assert (rider.felt(0), state.count) == (set(), 0)


def test_an_open_motor_is_named_and_a_symbol_that_needs_it_is_never_felt_in_part(rider: GuidedRider) -> None:
    rider.inputs = GloveInputs(open_motors=1 << 4)
    rider.run(200)
    began = rider.now_ms
    rider.guide.lead(DESK)
    state = rider.run(3000)
    assert rider.felt(began) == set()
    assert state.glove is not None
    assert state.glove.broken == (4,)
    assert state.unfelt.startswith("motor 4 of the glove does not vibrate")
    assert state.play == ()


def test_a_press_repeats_the_step_and_two_presses_ask_where_the_chair_is(rider: GuidedRider) -> None:
    rider.guide.around = lambda: RiderSurroundings((DESK,), ("Free straight ahead.",))
    rider.guide.lead(DESK)
    rider.run(1200)
    first = len(rider.states)
    rider.press()
    rider.run(800)
    assert rider.said(first) == ["forward"]
    rider.run(1500)
    rider.press()
    rider.press()
    state = rider.run(200)
    assert state.text == "desk is 4 m away, ahead. Free straight ahead. Now: straight 4.0 m."


def test_the_page_asks_the_same_and_a_rider_who_is_not_led_gets_an_answer(rider: GuidedRider) -> None:
    rider.guide.say_again()
    assert rider.run(100).text == "Nothing has been said yet."
    rider.guide.say_where()
    assert rider.run(100).text == "No place with a name is near."


def test_advice_of_another_program_is_felt_by_a_rider_who_is_not_led(rider: GuidedRider) -> None:
    began, now_ns = rider.now_ms, rider.now_ms * 1_000_000
    sent = Advice(Symbol.FORWARD, 5, now_ns + 10**9)
    state = rider.guide.step(HapticInputs(now_ns, None, Twist(), others=(sent,)))
    assert (state.symbol, state.goal) == ("forward", "")
    rider.run(700)
    assert rider.felt(began) == FORWARD


@pytest.mark.parametrize("profile", [HapticsProfile(), HapticsProfile(advice="paper")])
def test_an_override_by_a_long_push_is_warned_on_the_skin_and_said_when_it_begins(profile: HapticsProfile) -> None:
    with GuidedRider(profile=profile) as rider:
        rider.guard = replace(FREE, warns=True)
        began = rider.now_ms
        state = rider.run(500)
        assert state.symbol == "warning"
        assert rider.felt(began) == set(range(9))
        assert rider.said() == ["warning"], "once for one push"
        rider.guard = replace(FREE, overridden=True)
        assert rider.run(200).text == OVERRIDE_BEGINS
        rider.guard = FREE
        assert rider.run(200).count == 2


def test_a_pose_lost_in_the_middle_of_a_leg_warns_once_moving_and_goes_on_when_it_is_found(rider: GuidedRider) -> None:
    rider.guide.lead(DESK)
    rider.run(1100)
    rider.twist = Twist(0.3, 0.0)
    rider.run(500)
    kept, rider.pose = rider.pose, None
    first = len(rider.states)
    state = rider.run(500)
    assert (state.withheld, rider.said(first)) == (LOST, ["warning"])
    rider.twist = Twist()
    first = len(rider.states)
    rider.run(3000)
    assert rider.said(first) == []
    rider.pose = kept
    state = rider.run(600)
    assert (state.symbol, state.withheld) == ("forward", "")


def test_leading_ends_with_the_guard_and_both_are_told(rider: GuidedRider) -> None:
    rider.guide.lead(DESK)
    rider.run(200)
    first = len(rider.states)
    rider.level, rider.level_told = HelpLevel.INFORM, f"{GUARD_ENDED}the cable was pulled."
    state = rider.run(1500)
    assert (state.goal, state.level) == ("", HelpLevel.INFORM)
    told = list(dict.fromkeys(each.text for each in rider.states[first:]))
    assert told[-2:] == [rider.level_told, "You are no longer led: the guard has ended."]
    assert state.symbol == "attention"


def test_who_chooses_the_guard_alone_is_led_no_longer_and_told_so(rider: GuidedRider) -> None:
    rider.guide.lead(DESK)
    rider.run(200)
    rider.level, rider.level_told = HelpLevel.GUARD, SPOKEN[HelpLevel.GUARD]
    state = rider.run(1500)
    assert (state.goal, state.reason) == ("", "you have chosen the guard alone")
    assert state.text == "You are no longer led: you have chosen the guard alone."


def test_a_rider_who_pulls_back_whenever_ahead_is_asked_for_is_told_that_the_glove_sits_the_wrong_way_round(
    rider: GuidedRider,
) -> None:
    rider.guide.lead(DESK)
    rider.guard = FREE
    for count in range(1, IN_A_ROW + 1):
        rider.stick = JoystickInput(0)
        while rider.said().count("forward") < count:
            rider.run(50)
        rider.stick = JoystickInput(0, -0.25, 0.0)
        state = rider.run(1_450)
    assert state.goal == ""
    assert state.text.startswith("You are no longer led: ahead and back were answered as each other")
    assert "put it on anew" in state.text
    assert rider.said().count("forward") == IN_A_ROW


def test_a_goal_that_no_steps_lead_to_is_told_with_its_reason(rider: GuidedRider) -> None:
    rider.guide.lead(Place("wall", Pose2(5.95, 0.05), 0.3, 0.3))
    state = rider.run(200)
    assert state.goal == ""
    assert state.text == f"You are no longer led: {state.reason}."
    assert "wall" not in state.reason


def test_obstacles_are_told_on_change_while_the_chair_moves_and_a_warning_comes_first(rider: GuidedRider) -> None:
    classes = [Obstacle.FAR] * 8
    classes[2] = Obstacle.CLOSE
    rider.signal = Signal(SignalKind.SPACE, "close on the left", classes=tuple(int(each) for each in classes))
    began = rider.now_ms
    rider.run(500)
    assert rider.felt(began) == set()  # it stands
    rider.twist = Twist(0.1, 0.0)
    rider.run(1500)
    assert (rider.felt(began), rider.said()) == ({3}, ["obstacle_at"])  # once, as long as nothing changes
    rider.signal = Signal(SignalKind.WARNING, "no way is free")
    state = rider.run(100)
    assert (state.symbol, state.text) == ("warning", "stop the chair: no way is free")


def test_a_rider_who_chose_the_papers_signals_feels_its_codes_and_is_led_to_no_place() -> None:
    with GuidedRider(profile=HapticsProfile(advice="paper")) as rider:
        rider.signal = Signal(SignalKind.DIRECTION, "door", Move.GO, 0.8)
        began = rider.now_ms
        state = rider.run(700)
        assert rider.felt(began) == {8, 4, 0}  # through the centre, to the front left
        assert (state.text, state.unfelt, state.count) == ("go front-left", "", 1)
        assert state.play == (((8,), 150, 0), ((4,), 150, 0), ((0,), 150, 0))
        rider.signal = Signal(SignalKind.WARNING, "no way is free")
        assert rider.run(200).text == "stop the chair: no way is free"
        rider.guide.lead(DESK)
        state = rider.run(100)
        assert (state.goal, state.reason) == ("", AS_PAPER)
        assert state.text == f"You are no longer led: {AS_PAPER}."
