"""The `waychair` program: its commands. A failure is one sentence on standard error and a non-zero exit code."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from typing import NoReturn

from cyclopts import App, Parameter

from waychair import __version__
from waychair.errors import WaychairError

app = App(
    name="waychair",
    help="Map a building, plan a path through it and drive an electric wheelchair along it.",
    version=__version__,
    help_format="plaintext",
    result_action="return_value",
    default_parameter=Parameter(negative_iterable=()),  # no --empty-goal beside --goal
    suppress_keyboard_interrupt=False,  # `main` prints the notes of an interrupt
)
app.command("waychair.cli.mapping.map_command:map_command", name="map", help="Make a map of a recording.")
app.command(
    "waychair.cli.mapping.map_all_command:map_all_command",
    name="map-all",
    help="Make maps of many recordings at once, on this computer or a cluster.",
)
app.command(
    "waychair.cli.places_command:places_command", name="places", help="List, add or change the named places of a map."
)
app.command(
    "waychair.cli.evaluating:localize_command", name="localize", help="Localise the chair of a recording on a map."
)
app.command("waychair.cli.evaluating:evaluate_command", name="evaluate", help="Evaluate a trajectory.")
app.command("waychair.cli.planning:plan_command", name="plan", help="Plan a path for the chair on a map.")
app.command(
    "waychair.cli.driving:navigate_command", name="navigate", help="Drive a simulated chair to places on a map."
)
app.command(
    "waychair.cli.driving:demo_command",
    name="demo",
    help="Map a simulated floor by joystick, then let the chair drive to three places.",
)
app.command(
    "waychair.cli.page:page_command",
    name="page",
    help="Drive a simulated chair in real time by a page in the browser.",
)
app.command(
    "waychair.cli.black_box_command:why_command",
    name="why",
    help="Explain the chair's last stop from its black box.",
)
app.command(
    "waychair.cli.running.starting:up_command", name="up", help="Start all ROS 2 nodes of a chair, real or simulated."
)
app.command("waychair.cli.running.stack_commands:goto_command", name="goto", help="Send the running chair to places.")
app.command(
    "waychair.cli.running.travel_commands:travel_command",
    name="travel",
    help="Send the running chair to another storey.",
)
app.command(
    "waychair.cli.running.travel_commands:directions_command",
    name="directions",
    help="Tell the rider of the running chair the way to a goal.",
)
app.command(
    "waychair.cli.running.travel_commands:storey_command",
    name="storey",
    help="Tell the running chair which storey it is on.",
)
app.command(
    "waychair.cli.running.record_commands:record_command",
    name="record",
    help="Record a running chair's topics into a bag.",
)
app.command(
    "waychair.cli.running.record_commands:save_command",
    name="save",
    help="Write the map of the running chair to a folder.",
)
app.command(
    "waychair.cli.running.stack_commands:confirm_command",
    name="confirm",
    help="Confirm the waiting goal for the rider.",
)
app.command("waychair.cli.running.stack_commands:pause_command", name="pause", help="Pause the running chair's drive.")
app.command("waychair.cli.running.stack_commands:go_on_command", name="go-on", help="Continue the paused drive.")
app.command(
    "waychair.cli.running.stack_commands:cancel_command", name="cancel", help="Cancel the running chair's drive."
)
app.command("waychair.cli.running.stack_commands:stop_command", name="stop", help="Stop the running chair at once.")
app.command(
    "waychair.cli.running.stack_commands:reset_command", name="reset", help="Reset latched faults, after their repair."
)
app.command(
    "waychair.cli.running.stack_commands:initial_pose_command",
    name="initial-pose",
    help="Tell the running chair where it stands.",
)
app.command(
    "waychair.cli.running.stack_commands:status_command",
    name="status",
    help="Print the running chair's pose and state.",
)
app.command(
    "waychair.cli.barn_command:barn_command",
    name="barn",
    help="Run the BARN benchmark (drives without a map), and print the score.",
)
app.command("waychair.cli.simulating:worlds_command", name="worlds", help="List the simulated worlds, or draw one.")
app.command(
    "waychair.cli.simulating:simulate_command",
    name="simulate",
    help="Drive a simulated chair along a route of a world, and record it.",
)
app.command(
    "waychair.cli.guiding.guide_command:guide_command",
    name="guide",
    help="Lead a simulated driver who cannot see to a place, by the motors of a glove.",
)
app.command(
    "waychair.cli.fleet_commands.fleet:fleet_app",
    name="fleet",
    help="Simulate several chairs in one building, and check its corridors.",
)
app.command(
    "waychair.cli.vocabulary_command:vocabulary_command",
    name="vocabulary",
    help="Make a vocabulary of visual words from pictures.",
)
app.command(
    "waychair.cli.reporting:report_command",
    name="report",
    help="Print the figures of a map's memory beside the published tables.",
)
app.command(
    "waychair.cli.exporting:export_command",
    name="export",
    help="Write the coloured point cloud of a recording or of a map.",
)
app.command(
    "waychair.cli.settings:config_command",
    name="config",
    help="Print all settings with their defaults, units and meaning.",
)
app.command(
    "waychair.cli.calibration.calibrating:calibrate_app",
    name="calibrate",
    help="Measure a chair and store the results in its calibration file.",
)
app.command(
    "waychair.cli.behaviours_command:behaviours_app",
    name="behaviours",
    help="Show the networks of behaviour cells, and read and replay their traces.",
)
app.command(
    "waychair.cli.haptics_commands.haptics:haptics_app",
    name="haptics",
    help="Play, check and tune the vibrations that guide a driver who cannot see.",
)
app.command(
    "waychair.cli.building.buildings:buildings_app",
    name="building",
    help="Make, check and route through buildings of several storeys.",
)
app.command(
    "waychair.cli.building.journeys_command:journeys_command",
    name="journeys",
    help="Let a simulated chair travel over several storeys, and count how it fares.",
)
app.command(
    "waychair.cli.doctor:doctor_command",
    name="doctor",
    help="List missing parts of this machine and the commands that fix them.",
)


def main() -> None:
    """Entry point of the `waychair` script."""
    try:
        try:
            app()
        finally:
            sys.stdout.flush()
    except WaychairError as error:
        _fail(str(error))
    except BrokenPipeError:
        _forget_output()
        sys.exit(1)
    except MemoryError:
        _fail("memory ran out: use a smaller map or recording, or close other programs")
    except OSError as error:
        from waychair.files import os_error_text

        _fail(f"cannot read or write {error.filename or 'a file'}: {os_error_text(error)}")
    except KeyboardInterrupt as stop:
        for note in getattr(stop, "__notes__", ()):  # such as the path of an interrupted recording
            print(f"waychair: stopped; {note}", file=sys.stderr)
        sys.exit(130)


def _fail(sentence: str) -> NoReturn:
    """Print a sentence on standard error and exit with 1."""
    _forget_output()
    print(f"waychair: {sentence}", file=sys.stderr)
    sys.exit(1)


def _forget_output() -> None:
    """Flush standard output; if that fails, discard it, so that the program's end does not fail again."""
    try:
        sys.stdout.flush()
    except OSError:
        with suppress(OSError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
