"""Commands for a running chair in a building of several storeys: travel, storey."""

from __future__ import annotations

import sys
import time

from waychair.cli.options.arguments import BadArgument
from waychair.cli.options.stack_options import ChairAddress

_ADDRESS = ChairAddress()

_ENDED = ("arrived", "failed", "refused")


def travel_command(
    goal: str,
    /,
    *,
    storey: str = "",
    yes: bool = False,
    wait: bool = True,
    timeout: float = 1800.0,
    address: ChairAddress = _ADDRESS,
) -> None:
    """Send the running chair to a goal of its building, by lifts where needed.

    Ctrl-C ends this command, not the journey; `waychair cancel` ends that.

    Parameters
    ----------
    goal
        Path of the goal, such as "First/Ward/Bed 1", or with --storey the name of a place there.
    storey
        Id or name of the storey.
    yes
        Confirm the journey, too: you watch the chair now.
    wait
        Wait until the chair has arrived, and print what it says; --no-wait ends the command once the journey is planned.
    timeout
        Time limit in seconds; the journey goes on after it.
    """
    from waychair.errors import RosError

    with address.client() as client:
        said = client.travel_to(goal, storey)
        print(said.sentence)
        if yes:
            begun, why = client.confirm(goal_id=client.drive_state().goal_id)
            if not begun:
                raise RosError(f"the journey did not begin: {why}")
        elif wait:
            print("waiting for the rider's confirmation: press Drive, or run `waychair confirm`", file=sys.stderr)
        ends = time.monotonic() + timeout
        while wait and said.phase not in _ENDED:
            if time.monotonic() > ends:
                raise RosError(f"'{goal}' was not reached within {timeout:g} s; the journey goes on: {said.sentence}")
            client.spin(0.2)
            now = client.journey()
            if now != said:
                asks = f" ({', '.join(now.asks)})" if now.asks else ""
                print(f"{now.phase}: {now.sentence}{asks}")
            said = now
    if wait and said.phase != "arrived":
        raise RosError(f"'{goal}' was not reached: {said.sentence}")


def directions_command(
    goal: str, /, *, storey: str = "", timeout: float = 1800.0, address: ChairAddress = _ADDRESS
) -> None:
    """Tell the rider of the running chair, who drives, the way to a goal of its building, one movement at a time.

    The chair's page must run. Ctrl-C ends guidance.

    Parameters
    ----------
    goal
        Path of the goal, such as "First/Ward/Bed 1", or with --storey the name of a room there.
    storey
        Name of the storey.
    timeout
        Time limit in seconds, after which guidance ends.
    """
    from waychair.errors import RosError

    with address.client() as client:
        client.guide_to(goal, storey)
        ends, heard = time.monotonic() + timeout, 0
        try:
            while (told := client.guidance(0.0)) is not None and not told.arrived:
                if time.monotonic() > ends:
                    raise RosError(f"the rider has not come to '{goal}' within {timeout:g} s: ask for directions again")
                if told.count > heard:
                    print(told.said, flush=True)
                heard = told.count
                client.spin(0.2)
            if told is None:
                raise RosError(f"guidance to '{goal}' was ended: ask for directions again")
            print(told.sentence)
        finally:
            if client.guidance(0.0) is not None:
                client.guide_to("")


def storey_command(name: str = "", /, *, place: str = "", address: ChairAddress = _ADDRESS) -> None:
    """Tell the running chair which storey it is on: when it asks in a lift, or after a restart on another storey.

    Parameters
    ----------
    name
        Id or name of the storey; none with a place whose path names it.
    place
        Place at which the chair stands: its name on that storey, or a path such as "First/Ward/Bed 1". The chair is
        localised anew there.
    """
    if not (name or place):
        raise BadArgument("give the storey, or with --place the place at which the chair stands")
    from waychair.errors import RosError

    with address.client() as client:
        done, sentence = client.say_storey(name, place)
    if not done:
        raise RosError(sentence)
    print(sentence)
