"""`waychair haptics play|check|tune|learn`: the vibrations that guide a driver without sight."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

from cyclopts import App

from waychair.cli.options.arguments import BadArgument, NonEmptyPath

if TYPE_CHECKING:
    from waychair.control.haptics.profile import HapticsProfile
    from waychair.control.haptics.symbols import Advice
    from waychair.firmware_bridge.glove.levels import MotorLevels

haptics_app = App(
    name="haptics",
    help="Play, check and tune the vibrations that guide a driver who cannot see.",
    help_format="plaintext",
    result_action="return_value",
)

haptics_app.command(
    "waychair.cli.haptics_commands.learn_command:learn_command",
    name="learn",
    help="Get to know a rider's touch by a game at rest: feel a symbol, answer by stick.",
)

LayoutName = Literal["glove_3x3", "belt_8", "bracelets", "arm_rest_4"]


@haptics_app.command(name="play", help="Play a symbol on a glove, or show what its motors would do.")
def play_command(
    symbol: str,
    /,
    *,
    direction: float | None = None,
    profile: NonEmptyPath | None = None,
    patterns: NonEmptyPath | None = None,
    port: str | None = None,
    aloud: bool = False,
) -> None:
    """Play a symbol on the glove of a port; without one, print the motors' levels in the glove's program.

    Parameters
    ----------
    symbol
        forward, back, swivel_left, swivel_right, nudge_left, nudge_right, warning, arrived, obstacle_at or attention.
    direction
        Where the obstacle is, in degrees to the left of straight ahead.
    profile
        The rider's file, with layout and fitting.
    patterns
        A file of patterns in place of the shipped one.
    port
        The glove's port: /dev/ttyUSB1, pty:/dev/pts/N or tcp:HOST:PORT.
    aloud
        Speak the symbol as well, with the rider's rate and volume.
    """
    import math

    from waychair.control.haptics.patterns import PATTERNS_FILE, vocabulary
    from waychair.control.haptics.symbols import Advice, Symbol
    from waychair.runtime.haptics.bench import open_bench, played_levels

    known = [each.value for each in Symbol]
    if symbol not in known:
        raise BadArgument(f"there is no symbol '{symbol}': choose among {', '.join(known)}")
    if direction is not None and not math.isfinite(direction):
        raise BadArgument(f"--direction is {direction}: give degrees")
    rider = _profile(profile)
    advice = Advice(Symbol(symbol), 1, 0, None if direction is None else math.radians(direction))
    steps = vocabulary(rider.layout, patterns or PATTERNS_FILE).pattern(advice).steps()
    if port is None:
        print(_spans_text(played_levels(rider, steps)))
    else:
        with open_bench(port, rider, rider.fitting()) as bench:
            bench.play(steps)
    if aloud:
        _speak(rider, advice)


def _profile(path: Path | None) -> HapticsProfile:
    from waychair.control.haptics.profile import HapticsProfile, load_profile

    return HapticsProfile() if path is None else load_profile(path)


def _spans_text(levels: MotorLevels) -> str:
    """Return a line for each vibration, in the order of their beginnings."""
    import numpy as np

    on = np.pad((levels.levels > 0).astype(np.int8), ((1, 1), (0, 0)))
    lines = []
    first = int(np.flatnonzero(levels.levels.any(axis=1))[0])
    for motor in range(on.shape[1]):
        edges = np.flatnonzero(np.diff(on[:, motor]))
        for begin, end in zip(edges[::2], edges[1::2], strict=True):
            lines.append((int(begin) - first, motor, int(end) - first, int(levels.levels[begin, motor])))
    return "\n".join(
        f"{begin:4d} to {end:4d} ms: motor {motor} at {100 * level / 255:.0f} %"
        for begin, motor, end, level in sorted(lines)
    )


def _speak(rider: HapticsProfile, advice: Advice) -> None:
    """Speak advice to its end, and print why it cannot be spoken."""
    import time

    from waychair.control.haptics.words import Wording, advice_words
    from waychair.runtime.haptics.sounds import Sounds

    sounds = Sounds(rider)
    sounds.tell(advice_words(advice, Wording(rider.wording)), advice, 0, interrupts=False)
    while sounds.sounding:
        time.sleep(0.05)
        sounds.tick(0)
    sounds.tick(0)
    sounds.close()
    for notice in sounds.notices:
        print(notice)


@haptics_app.command(name="check", help="Check patterns against the limits of touch.")
def check_command(patterns: NonEmptyPath | None = None, /, *, layout: LayoutName | None = None) -> None:
    """Check patterns against the limits of touch; every broken limit is told with its place, amount and source.

    Parameters
    ----------
    patterns
        A file of patterns; without one, the shipped patterns are checked.
    layout
        Check only this layout of motors.
    """
    from waychair.control.haptics.limits import broken_limits, every_pattern
    from waychair.control.haptics.patterns import PATTERNS_FILE, vocabularies, vocabulary
    from waychair.errors import PatternError

    path = patterns or PATTERNS_FILE
    chosen = [vocabulary(layout, path)] if layout is not None else list(vocabularies(path).values())
    broken = [each.sentence() for words in chosen for each in broken_limits(words)]
    for sentence in broken:
        print(sentence)
    if broken:
        raise PatternError(
            f"{len(broken)} limits of touch are broken in {path}: change the patterns that are named above"
        )
    count = sum(len(list(every_pattern(words))) for words in chosen)
    print(f"{count} patterns of {', '.join(words.layout.name for words in chosen)} keep all limits of touch")


@haptics_app.command(name="tune", help="Fit a glove to a rider: how it sits, and how strong each motor is.")
def tune_command(
    profile: NonEmptyPath,
    /,
    *,
    port: str,
    layout: LayoutName | None = None,
    hand: Literal["left", "right", "none"] | None = None,
) -> None:
    """Play motors and ask for answers, then write the fitting into the rider's file. The chair must be at rest.

    Parameters
    ----------
    profile
        The rider's file; it is made if it is not there.
    port
        The glove's port: /dev/ttyUSB1, pty:/dev/pts/N or tcp:HOST:PORT.
    layout
        Layout of the motors, where the file has none.
    hand
        Hand that wears the glove: left, right or none.
    """
    from dataclasses import replace

    from waychair.control.haptics.profile import HapticsProfile, load_profile, save_profile
    from waychair.errors import ConfigError
    from waychair.files import is_file
    from waychair.runtime.haptics.bench import fit

    rider = load_profile(profile) if is_file(profile, ConfigError) else HapticsProfile()
    rider = replace(rider, layout=layout or rider.layout, hand=hand or rider.hand, turned=(), gains=())
    fitted = fit(port, rider, _ask)
    save_profile(profile, fitted)
    print(f"written to {profile}: turned {list(fitted.turned)}, gains {list(fitted.gains)}")


def _ask(question: str) -> str:
    try:
        return input(question)
    except EOFError as error:
        raise BadArgument("the answers ended before the questions: run the command in a terminal") from error
