"""The options of a rider without sight, of commands with a chair that runs live."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from waychair.cli.options.arguments import BadArgument

if TYPE_CHECKING:
    from waychair.trials.guiding.live_haptics import HapticOptions


def haptic_options(profile: Path | None, glove: str | None, driver: str | None) -> HapticOptions | None:
    """Return the parts that `--haptics`, `--glove` and `--driver` ask for; None without them.

    Raises:
        BadArgument: a glove or a driver without --haptics, or a driver who cannot feel a glove on a port.
        ConfigError: the rider's file is impossible, or there is no such driver.
        GloveError: its fitting is for another layout.
        TransportError: the port's name has no known form.
    """
    if profile is None:
        if glove is not None or driver is not None:
            raise BadArgument("--glove and --driver need --haptics FILE, the rider's file")
        return None
    if glove is not None and driver is not None:
        raise BadArgument(
            "a simulated driver feels the glove's program on this computer: leave --glove or --driver out"
        )
    from waychair.control.haptics.profile import load_profile
    from waychair.firmware_bridge.transports import check_port
    from waychair.runtime.haptics.learnt_file import default_learnt
    from waychair.runtime.haptics.session_log import SessionLog, default_session_log
    from waychair.simulation.rider.driver_presets import driver_named
    from waychair.trials.guiding.live_haptics import HapticOptions

    if glove is not None:
        check_port(glove, "--glove")
    if driver is not None:
        driver_named(driver)
    learnt = default_learnt() if driver is None else None  # nothing of a simulated driver is kept as a person's
    session = SessionLog(default_session_log()) if driver is None else None
    return HapticOptions(load_profile(profile), learnt, session, glove, driver)
