"""What the part that tells and leads a rider hears in a tick, and its state afterwards: data of `haptic_guide`."""

from __future__ import annotations

from dataclasses import dataclass, field

from waychair.control.behaviours.commands import Signal
from waychair.control.haptics.guide_types import StickHold
from waychair.control.haptics.symbols import Advice
from waychair.firmware_bridge.glove.bridge import GloveReport
from waychair.runtime.senses.servo_camera_sight import ServoCameraTold
from waychair.types import GuardReport, HelpLevel, JoystickInput, Place, Pose2, Twist


@dataclass(frozen=True, slots=True)
class HapticInputs:
    """The chair in a tick. `pose` in map is None while the chair does not know where it is; `odom_from_base` by wheels and
    gyro alone is None without odometry.

    `level` is the level of help, `level_told` the last sentence about it. `stick` and `guard` are of the board's report,
    None without one. `own_caps` are those of the guard without the hold of the guidance, to the front, the rear, the left and the
    right; 1 where nobody tells. `signal` is that of the behaviour cells, `camera` the news of the camera on servos. `others` is
    advice of other programs. `computer_drives`: nobody is led meanwhile.
    """

    now_ns: int
    pose: Pose2 | None
    twist: Twist
    level: HelpLevel = HelpLevel.INFORM
    level_told: str = ""
    stick: JoystickInput | None = None
    guard: GuardReport | None = None
    signal: Signal | None = None
    camera: ServoCameraTold | None = None
    computer_drives: bool = False
    others: tuple[Advice, ...] = ()
    odom_from_base: Pose2 | None = None
    own_caps: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)


@dataclass(frozen=True, slots=True)
class RiderSurroundings:
    """The chair's facts about its place: `places` of the map, and sentences about free ways, doorways and things near."""

    places: tuple[Place, ...] = ()
    near: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class HapticState:
    """The rider's channels after a tick.

    `goal`: the place that the rider is led to, empty without one; `step`: the present step in words; `reason`: the guide's
    reason, or why leading has ended. `symbol`, `text`, `count`: the symbol said last, in words, and how many things have been
    told. `play`: its bursts on the skin, each (motors by their places, ms on, ms off). `unfelt`: why the last symbol was not
    felt. `speaks`: the chair itself speaks or plays a tone, or is about to. `withheld`: why nobody tells the steps now; the
    chair drives as without them. `offers`: the guide has fallen silent because the rider does not follow, and offers to
    repeat. `hold`: how the stick is best held meanwhile. `glove`: None without a glove. `notices`: all that is amiss.
    """

    stamp_ns: int
    level: HelpLevel = HelpLevel.INFORM
    goal: str = ""
    step: str = ""
    reason: str = ""
    arrived: bool = False
    symbol: str = ""
    text: str = ""
    count: int = 0
    play: tuple[tuple[tuple[int, ...], int, int], ...] = ()
    unfelt: str = ""
    speaks: bool = False
    withheld: str = ""
    offers: bool = False
    hold: StickHold = field(default_factory=StickHold)
    glove: GloveReport | None = None
    notices: tuple[str, ...] = ()
