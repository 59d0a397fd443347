"""Checks of `waychair up` before it starts any node, so that one sentence tells a fault that each node would tell again."""

from __future__ import annotations

import numpy as np

from waychair.calibration.calibration_file import ChairCalibration, load_calibration
from waychair.errors import CalibrationMismatch, ConfigError, OutputError
from waychair.files import is_folder, path_exists
from waychair.firmware_bridge.bridge import with_family_of
from waychair.firmware_bridge.real_boards import check_cable
from waychair.firmware_bridge.transports import check_port
from waychair.install_advice import document
from waychair.maps.drawn.erased import load_erased
from waychair.maps.drawn.places import load_places
from waychair.maps.drawn.zones import check_zones, load_zones
from waychair.maps.folders.depth_layer import load_depth_layer
from waychair.maps.folders.map_files import load_map
from waychair.maps.grid.cells import cells_from_points, inside
from waychair.ros.stack import Stack
from waychair.runtime.chair import ChairSettings
from waychair.simulation.plant.chair_file import load_chair


def check_stack(stack: Stack, settings: ChairSettings) -> ChairCalibration | None:
    """Check chair, map and folders of a run; return the content of the chair's file, if one is named.

    Raises:
        WaychairError: see `check_chair`, `check_map` and `check_folders`.
    """
    calibration = check_chair(stack, settings)
    check_map(stack)
    check_folders(stack)
    return calibration


def check_chair(stack: Stack, settings: ChairSettings) -> ChairCalibration | None:
    """Check that the chair can be driven by the file that is named; return the content of that file.

    Raises:
        ConfigError: no chair is named, or a real chair's file or cable is missing, or both chairs are named.
        CalibrationError: the file is missing or damaged, or the joystick was not measured.
        CalibrationMismatch: it is of another chair than the simulated one, of a simulated chair at a real board, or of
            another joystick family than the settings name.
        TransportError: the cable is none.
    """
    if stack.world and stack.cable:
        raise ConfigError("--sim and --cable exclude each other: a simulated chair has a simulated board")
    if stack.cable and stack.calibration is None:
        raise ConfigError(
            "--cable needs --chair: a real chair is driven by its own file only, which `waychair calibrate` makes "
            f"({document('docs/hardware.md')})"
        )
    if stack.calibration is not None and not stack.world and not stack.cable:
        raise ConfigError("--chair needs --cable, the port of the chair's board, such as /dev/ttyUSB0")
    if stack.calibration is None:
        return None
    calibration = load_calibration(stack.calibration)
    with_family_of(settings.bridge, calibration)
    if stack.cable:
        check_port(stack.cable, "--cable")
        check_cable(stack.cable, calibration, str(stack.calibration))
    elif calibration.chair_id != (simulated := load_chair().body.chair_id):
        raise CalibrationMismatch(
            f"{stack.calibration} is the file of chair '{calibration.chair_id}', and the simulated chair is '{simulated}': "
            "omit --chair, or give --cable instead of --sim"
        )
    return calibration


def check_map(stack: Stack) -> None:
    """Check the map with all that was drawn on it.

    Raises:
        MapError: the map cannot be read.
        PlaceError, ZoneError: its places or zones are broken, or a zone lies outside the map.
        ConfigError: the start lies outside the map.
    """
    folder = stack.map_folder
    if folder is None:
        return
    grid = load_map(folder, lambda _: None)  # the mapper tells the warnings
    check_zones(load_zones(folder), grid)
    load_places(folder)
    load_erased(folder)
    load_depth_layer(folder, grid)
    start = stack.start
    if start is not None and not inside(grid, cells_from_points(grid, np.array([[start.x, start.y]])))[0]:
        raise ConfigError(f"--start {start.x:g},{start.y:g} lies outside the map: give a pose on it")


def check_folders(stack: Stack) -> None:
    """Check that the folders of the run and of its black box are folders, or can be made.

    Raises:
        OutputError: there is a file in the place of one of them.
    """
    for option, folder in (("--out", stack.folder), ("--box", stack.box)):
        if folder is None:
            continue
        above = next(each for each in (folder, *folder.absolute().parents) if path_exists(each, OutputError))
        if not is_folder(above, OutputError):
            raise OutputError(f"{option} {folder} cannot be a folder, since {above} is a file: name another one")
