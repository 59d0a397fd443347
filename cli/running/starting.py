"""`waychair up`: the nodes of a chair, started and kept running."""

from __future__ import annotations

import signal
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from waychair.cli.options.arguments import BadArgument
from waychair.cli.options.stack_options import ChairAddress, StackChairOptions, StackFileOptions, StackPageOptions

if TYPE_CHECKING:
    from collections.abc import Mapping

    from waychair.cli.options.configuration import Configuration
    from waychair.ros.stack import Stack
    from waychair.runtime.processes import Process
    from waychair.types import Pose2

Pose = Annotated[str, Parameter(allow_leading_hyphen=True)]

_CHAIR, _FILES, _PAGE, _ADDRESS = StackChairOptions(), StackFileOptions(), StackPageOptions(), ChairAddress()

_WATCH_S = 0.05

WARNING = """\
waychair is research software, not a medical device. Modifying a wheelchair may void its approval. A person must walk
beside the chair, within reach of an emergency stop that cuts its motors. Test first in the simulator, then with the
wheels off the ground, then with a dummy load and a walking spotter, and only then with a rider."""


def up_command(
    *,
    chair: StackChairOptions = _CHAIR,
    map: Path | None = None,
    mapping: bool = False,
    start: Pose | None = None,
    files: StackFileOptions = _FILES,
    page: StackPageOptions = _PAGE,
    address: ChairAddress = _ADDRESS,
    lan: bool = False,
    fleet: Path | None = None,
    fleet_lan: bool = False,
    urgent: bool = False,
) -> None:
    """Start all ROS nodes of a chair, and keep them running until Ctrl-C or SIGTERM.

    Parameters
    ----------
    map
        Map folder to drive on; the default of a simulated chair is its world's plan.
    mapping
        Make a map during the drive.
    start
        The chair's pose as X,Y,YAW, or with --map a place of the map; default its last pose, else it relocalises.
    lan
        Let other computers on the network see the nodes; without security keys, velocity commands are then ignored.
    fleet
        The fleet's file of a chair that shares its building with others: it drives in their common order, to the places of
        the building's traffic graph.
    fleet_lan
        Talk to chairs on other computers; needs the keys of the fleet's file.
    urgent
        Real-time priority for the nodes, if the system grants it; useful on a busy computer.
    """
    from waychair.cli.options.configuration import load_configuration
    from waychair.cli.options.page_process import TOKEN, page_names, page_token
    from waychair.ros.environment import is_secured, ros_environment
    from waychair.ros.interface_types import interface_type
    from waychair.ros.stack import processes

    configured = load_configuration(files.config)
    environment = ros_environment(domain=address.domain, lan=lan)
    page_names(page.page_name, page.page_lan)  # refused here, before anything is started
    environment[TOKEN] = page_token(page.page_lan, page.token)
    deaf = lan and not is_secured(environment)
    stack = _stack(chair, map, mapping, start, files, page, address.namespace, urgent, deaf, configured)
    _check(stack, configured)
    if fleet is not None:
        from waychair.runtime.fleet.chair_fleet import fleet_environment

        environment |= fleet_environment(fleet, fleet_lan)
        stack = replace(stack, fleet=True)
    elif fleet_lan:
        raise BadArgument("--fleet-lan needs --fleet")
    table = processes(stack)
    interface_type("waychair_msgs/msg/DriveState")  # built here, else all nodes would wait for the first
    _print_begin(stack, page, lan, deaf, environment[TOKEN])
    _run(table, environment)


def _stack(
    chair: StackChairOptions,
    map: Path | None,
    mapping: bool,
    start: str | None,
    files: StackFileOptions,
    page: StackPageOptions,
    namespace: str,
    urgent: bool,
    deaf: bool,
    configured: Configuration,
) -> Stack:
    """Return the configuration of the run that the options describe."""
    from waychair.ros.stack import Stack, node_parameters

    if chair.unattended and chair.sim is None:
        raise BadArgument("--unattended needs --sim: the rider of a real chair confirms each goal")
    return Stack(
        folder=files.out,
        world=chair.sim or "",
        map_folder=map,
        mapping=mapping,
        calibration=chair.chair,
        cable=chair.cable,
        camera=chair.camera,
        people=chair.people,
        seed=chair.seed,
        unattended=chair.unattended,
        ignore_commands=deaf,
        start=None if start is None else _start_pose(start, map),
        parameters=files.params,
        urgent=urgent,
        box=files.black_box,
        page_port=page.port(),
        page_host=page.host,
        page_names=page.page_name,
        namespace=namespace,
        settings=node_parameters(configured.chair, configured.map, configured.simulation, configured.nodes),
    )


def _start_pose(text: str, map: Path | None) -> Pose2:
    """Return the pose that --start gives: a place of the map, or X,Y,YAW."""
    from waychair.cli.options.arguments import place_from_text, pose_from_text
    from waychair.maps.drawn.places import load_places

    if map is None:
        return pose_from_text(text, "--start")
    return place_from_text(load_places(map), text, "--start").pose


def _check(stack: Stack, configured: Configuration) -> None:
    """Refuse here what each node would refuse by itself."""
    from waychair.calibration.calibration_file import has_built_in_body
    from waychair.ros.stack_checks import check_stack

    calibration = check_stack(stack, configured.chair)
    if calibration is not None and not calibration.is_simulated and has_built_in_body(calibration):
        print(
            f"waychair: {stack.calibration} has the dimensions of the built-in chair {calibration.body.chair_id}: give this "
            "chair's own with `waychair calibrate body`",
            file=sys.stderr,
        )


def _print_begin(stack: Stack, page: StackPageOptions, lan: bool, deaf: bool, token: str) -> None:
    """Print the warning, who can see the nodes, and the page's address."""
    from waychair.cli.options.page_process import page_sentence

    print(WARNING, file=sys.stderr)
    if lan:
        print(
            "The whole network can see the nodes: map, pictures, scans and goals. "
            + ("Velocity commands are ignored, as there are no security keys." if deaf else "Messages are signed."),
            file=sys.stderr,
        )
    if stack.page_port is not None:
        said = page_sentence(stack.page_port, page.page_lan, token, page.page_name)
        print(f"waychair: {said}", file=sys.stderr)


def _run(table: tuple[Process, ...], environment: Mapping[str, str]) -> None:
    """Run the processes until SIGINT or SIGTERM; restart those that die, and clear the shared memory that they leave.

    Raises:
        RosError: a process cannot go on.
    """
    from waychair.errors import RosError
    from waychair.ros.shared_memory import remove_dead_segments
    from waychair.runtime.processes import Supervision, signalled

    remove_dead_segments()
    ending = signalled(signal.SIGINT, signal.SIGTERM)
    with Supervision(table, environment, lambda sentence: print(f"waychair: {sentence}", file=sys.stderr)) as running:
        known = dict(running.pids)
        while not ending():
            time.sleep(_WATCH_S)
            if over := running.watch():
                raise RosError(f"{over}: see its messages above")
            if running.pids != known:  # a process has died
                known = dict(running.pids)
                remove_dead_segments()
