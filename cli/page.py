"""`waychair page`: the rider's page of a simulated chair."""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from waychair.cli.options.arguments import BadArgument, NonEmptyPath, NonNegativeInt
from waychair.errors import BuildingError

if TYPE_CHECKING:
    from waychair.ui.editor.session import Session

_LOOK_S = 0.1


def page_command(
    *,
    sim: Annotated[str, Parameter(name=["--sim", "--world"])] = "small_clinic",
    building: Path | None = None,
    map: Path | None = None,
    port: Annotated[NonNegativeInt, Parameter(name=["--port", "--page-port"])] = 8000,
    lan: Annotated[bool, Parameter(name=["--lan", "--page-lan"])] = False,
    page_name: tuple[str, ...] = (),
    token: str | None = None,
    people: bool = True,
    camera: bool = False,
    seed: NonNegativeInt = 0,
    box: Path | None = None,
    config: Path | None = None,
    urgent: bool = False,
    habits: Path | None = None,
    haptics: NonEmptyPath | None = None,
    glove: str | None = None,
    driver: str | None = None,
    stick: Path | None = None,
) -> None:
    """Drive a simulated chair in real time by a page in the browser, until Ctrl-C.

    It needs no ROS. For the page of a real chair, or of simulated ROS nodes, use `waychair up`.

    Parameters
    ----------
    sim
        World of the chair (see `waychair worlds`), or a plan's .yaml file. In a world of several levels the chair
        travels to all of them by lifts that move.
    building
        Folder of a building in whose maps the chair travels, instead of a world.
    map
        Map folder of a drive that began at the world's start; default the world's plan, on which drawings are lost at
        the end.
    port
        Port of the page.
    lan
        Let other computers on the network open the page, with the token.
    page_name
        Further host name by which --lan may be opened, such as chair.lan; may be repeated. Numbers and NAME.local always
        work.
    token
        Token for --lan; default a random one, which is printed.
    people
        Simulate the world's people.
    camera
        Show pictures of the chair's camera.
    seed
        Seed of the simulated chair, of its sensors and noise, and of the people.
    box
        Folder of a black box that logs the chair's inputs and actions, for `waychair why`.
    config
        YAML file with settings that differ from the defaults (see `waychair config chair` and `simulation`).
    urgent
        Real-time priority for the chair, if the system grants it; useful on a busy computer.
    habits
        File of the rider's own record of guided drives, which is off until the rider says yes on the page; default
        waychair/habits.jsonl in the user's data folder.
    haptics
        File of a rider without sight (see `waychair haptics tune`): the tab Touch, steps by glove and voice, and the record
        for the trainer, which is off until the rider says yes. The level of help that the rider chose last is kept there.
    glove
        The glove's port: /dev/ttyUSB1, pty:/dev/pts/N or tcp:HOST:PORT; default the glove's program on this computer.
    driver
        A simulated driver who feels the glove's program and moves the chair's own joystick, such as default or older (see
        `waychair guide`).
    stick
        A joystick of this computer (Linux), such as /dev/input/js0, which moves the chair's own; with --glove a person can
        practise being led.
    """
    from waychair.cli.options.configuration import load_configuration
    from waychair.cli.options.haptic_options import haptic_options
    from waychair.cli.options.page_process import check_page_port, page_names, page_sentence, page_token
    from waychair.cli.options.progress import prepare_kernels, told_time
    from waychair.cli.running.starting import WARNING
    from waychair.runtime.processes import signalled
    from waychair.runtime.rider.habits import Habits, default_path
    from waychair.runtime.rider.kept_level import KeptLevel
    from waychair.trials.live.live_building import live_building
    from waychair.trials.live.live_chair import LiveChair
    from waychair.ui.server import page_server

    check_page_port(port, "--port")
    names, secret = page_names(page_name, lan), page_token(lan, token)
    configured = load_configuration(config)
    record = Habits(habits or default_path())
    touch = haptic_options(haptics, glove, driver)
    if driver is not None and stick is not None:
        raise BadArgument("a simulated driver moves the chair's own joystick: leave --driver or --stick out")
    ending = signalled(signal.SIGINT, signal.SIGTERM)
    print(WARNING, file=sys.stderr)
    prepare_kernels()
    starting = ExitStack()
    starting.enter_context(told_time("starting the chair"))
    with (
        starting,
        _edited(building) as session,
        live_building(sim, building, map, people=people) as site,
        LiveChair(
            world=sim if site is None else site.levels[0],
            map_folder=map,
            seed=seed,
            people=people,
            camera=camera,
            box=box,
            urgently=urgent,
            settings=configured.chair,
            simulation=configured.simulation,
            building=site,
            habits=record,
            kept_level=KeptLevel(haptics),
            haptics=touch,
            stick=stick,
        ) as chair,
        page_server(
            chair,
            host="0.0.0.0" if lan else "127.0.0.1",
            http_port=port,
            token=secret,
            names=names,
            session=session,
            habits=record,
            session_log=None if touch is None else touch.session,
        ),
    ):
        starting.close()
        print(f"waychair: {page_sentence(port, lan, secret, page_name)}; end with Ctrl-C", file=sys.stderr)
        while chair.alive and not ending():
            time.sleep(_LOOK_S)


@contextmanager
def _edited(folder: Path | None) -> Iterator[Session | None]:
    """Yield the building in a folder for the page's building mode; None without one, or where another program edits it."""
    from waychair.files import is_file
    from waychair.maps.building.hgraph_files import GENERAL
    from waychair.ui.editor.session import Session

    if folder is None or not is_file(folder / GENERAL, BuildingError):
        yield None
        return
    try:
        session = Session(folder)
    except BuildingError as error:
        print(f"waychair: {error}; the page has no building mode", file=sys.stderr)
        yield None
        return
    with session:
        yield session
