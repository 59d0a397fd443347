"""`waychair haptics learn`: the game at rest by which the chair gets to know its rider's touch."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from waychair.cli.options.arguments import BadArgument, Minutes, NonEmptyPath, NonNegativeInt

if TYPE_CHECKING:
    from waychair.runtime.haptics.learning_game import GameAnswer, Player


def learn_command(
    *,
    profile: NonEmptyPath | None = None,
    learnt: NonEmptyPath | None = None,
    port: str | None = None,
    stick: Path = Path("/dev/input/js0"),
    driver: str | None = None,
    minutes: Minutes = 5.0,
    seed: NonNegativeInt = 0,
    reset: bool = False,
    export: NonEmptyPath | None = None,
    quiet: bool = False,
) -> None:
    """Play the game at rest, and keep the learnt figures on this computer.

    The rider feels a symbol and answers by a joystick that moves no chair: held pushes for forward, back and turns, a short
    push for a nudge. The guidance uses the delay of the answers. Symbols that are mixed up are printed, and whether the
    device seems to sit the wrong way round.

    Parameters
    ----------
    profile
        The rider's file (see `waychair haptics tune`).
    learnt
        File of the learnt figures; default waychair/learnt.json in the user's data folder. With --driver nothing is kept
        unless this is given.
    port
        The glove's port: /dev/ttyUSB1, pty:/dev/pts/N or tcp:HOST:PORT.
    stick
        A joystick of this computer (Linux).
    driver
        A simulated driver in place of a person, such as default or older (see `waychair guide`).
    minutes
        Length of the game.
    seed
        Seed of the order of the symbols, and of the simulated driver.
    reset
        Forget the rider before anything else; without --port and --driver only this is done.
    export
        Copy what was learnt into this file.
    quiet
        Print nothing but errors.
    """
    from waychair.cli.options.progress import prepare_kernels, told_share
    from waychair.control.haptics.patterns import vocabulary
    from waychair.control.haptics.profile import HapticsProfile, load_profile
    from waychair.runtime.haptics.learning_game import play_game, summary
    from waychair.runtime.haptics.learnt_file import default_learnt, forget_learnt, load_learner, save_learner
    from waychair.simulation.rider.driver_presets import driver_named
    from waychair.trials.guiding.game_players import live_player, simulated_player

    if port is not None and driver is not None:
        raise BadArgument("a simulated driver feels the glove's program on this computer: leave --port or --driver out")
    plays = port is not None or driver is not None
    if not (plays or reset or export):
        raise BadArgument("there is no rider: name the glove's --port, or a simulated --driver")
    path = learnt or (None if driver is not None else default_learnt())
    if reset and path is not None:
        forget_learnt(path)
    learner = load_learner(path)
    rider = HapticsProfile() if profile is None else load_profile(profile)
    words = vocabulary(rider.layout)

    def play(player: Player) -> list[GameAnswer]:
        heard: list[GameAnswer] = []
        began_ns = player.now_ns
        with told_share("playing", quiet) as show:
            for answer in play_game(player, words, learner, 60.0 * minutes, seed):
                heard.append(answer)
                show(min(1.0, (player.now_ns - began_ns) / (60e9 * minutes)))
        return heard

    prepare_kernels(quiet)
    answers: list[GameAnswer] = []
    if driver is not None:
        with simulated_player(rider, words, driver_named(driver), seed) as simulated:
            answers = play(simulated)
    elif port is not None:
        with live_player(rider, port, stick) as live:
            if not quiet:
                print("waychair: the chair must stand; the game uses a joystick that moves no chair", file=sys.stderr)
            answers = play(live)
    if plays:
        save_learner(path, learner)
    if export is not None:
        save_learner(export, learner)
    if plays and not quiet:
        print(summary(answers, learner))
