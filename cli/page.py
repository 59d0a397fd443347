"""The rider's page of a simulated chair, in one command."""

from __future__ import annotations

import signal
import socket
import sys
import time
from pathlib import Path

from waychair.cli.arguments import Count

_LOOK_S = 0.1


def page_command(
    *,
    sim: str = "small_clinic",
    map: Path | None = None,
    port: Count = 8000,
    lan: bool = False,
    token: str | None = None,
    people: bool = True,
    camera: bool = False,
    seed: Count = 0,
    box: Path | None = None,
    urgent: bool = False,
) -> None:
    """Drive a simulated chair, in real time, by a page in the browser; until Ctrl-C.

    Without ROS; `waychair up` gives the page of a chair's nodes, a real one's too.

    Parameters
    ----------
    sim
        World of the chair (see `waychair worlds`), or its file.
    map
        Map folder of a drive that began at the world's start; by default the world's own plan, and what is drawn on it
        is forgotten at the end.
    port
        Of the page.
    lan
        Let other computers on the network open the page, with the token.
    token
        What they have to show; by default one is made and printed.
    people
        With the world's people.
    camera
        With pictures of its camera to look at.
    seed
        Seed of the simulated chair, its sensors and its noise, and of the people.
    box
        Log what the chair is told and does in this folder, for `waychair why`.
    urgent
        Real-time priority for the chair, where the system grants it: on a computer that does other things, too.
    """
    from waychair.cli.page_process import page_address, page_token
    from waychair.cli.stack import WARNING
    from waychair.runtime.processes import signalled
    from waychair.trials.live_chair import LiveChair
    from waychair.ui.server import page_server

    secret = page_token(lan, token)
    ending = signalled(signal.SIGINT, signal.SIGTERM)
    print(WARNING, file=sys.stderr)
    with (
        LiveChair(sim, map, seed, people, camera=camera, box=box, urgently=urgent) as chair,
        page_server(
            chair,
            host="0.0.0.0" if lan else "127.0.0.1",
            http_port=port,
            token=secret,
            names=(socket.gethostname(),),
        ),
    ):
        print(f"waychair: the page is at {page_address(port, lan, secret)}; end with Ctrl-C", file=sys.stderr)
        while chair.alive and not ending():
            time.sleep(_LOOK_S)
