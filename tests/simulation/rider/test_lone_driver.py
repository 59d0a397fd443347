"""The driver whom nobody tells anything: ahead until the chair stands, a little back, a turn by chance."""

from __future__ import annotations

from waychair.simulation.rider.hand import HandModel
from waychair.simulation.rider.lone_driver import LoneDriver
from waychair.types import JoystickInput, Twist

STEADY = HandModel(spread=0.0, bias=0.0, wander=0.0, drift=0.0)
TICK_S = 0.05


def _sticks(driver: LoneDriver, seconds: float, begin_s: float, blocked: bool) -> list[JoystickInput]:
    """Return the stick of a time in which the chair follows at once, or does not go ahead."""
    sticks, twist = list[JoystickInput](), Twist()
    for tick in range(round(seconds / TICK_S)):
        stick = driver.step(round((begin_s + tick * TICK_S) * 1e9), twist)
        v = stick.forward if stick.forward < 0.0 or not blocked else 0.0
        twist = Twist(v, 2.0 * stick.turn)
        sticks.append(stick)
    return sticks


def test_a_free_driver_goes_ahead_for_ever() -> None:
    sticks = _sticks(LoneDriver(STEADY), 20.0, 100.0, blocked=False)
    assert all(stick.forward > 0.2 and stick.turn == 0.0 for stick in sticks[10:])


def test_a_driver_who_is_stopped_backs_out_turns_by_chance_and_goes_on() -> None:
    sides = set()
    for seed in range(8):
        driver = LoneDriver(STEADY, seed)
        _sticks(driver, 5.0, 100.0, blocked=False)
        sticks = _sticks(driver, 8.0, 105.0, blocked=True)
        does = [
            "ahead" if s.forward > 0.1 else "back" if s.forward < -0.1 else "turn" for s in sticks
            if abs(s.forward) > 0.1 or abs(s.turn) > 0.1
        ]  # fmt: skip
        order = [each for k, each in enumerate(does) if k == 0 or each != does[k - 1]]
        assert order[:4] == ["ahead", "back", "turn", "ahead"]
        assert 0.9 < does.index("back") * TICK_S < 2.2
        sides |= {stick.turn > 0.0 for stick in sticks if abs(stick.turn) > 0.1}
    assert sides == {True, False}
