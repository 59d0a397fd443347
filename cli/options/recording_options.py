"""Options, progress bars and warnings shared by the commands that read a recording."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

if TYPE_CHECKING:
    from rich.console import Console

    from waychair.cli.options.progress import ShowStage
    from waychair.recordings.recording import InputSettings, Recording


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class RecordingOptions:
    """Options for reading a recording.

    Parameters
    ----------
    base_from_laser
        Mount of the lidar: X,Y,YAW in metres and radians, or X,Y,Z,YAW with the height of a lidar whose point clouds are
        mapped; with ",upside-down" appended for a hanging lidar; once per --scan. The default in a bag is its /tf. In a CARMEN log it also selects the robot's pose as odometry (by
        default the base is the laser).
    scan
        Topic of the laser scans or point clouds in a bag; several lidars are merged.
    odom
        Topic of the odometry in a bag; default /tf if there is none. "none" leaves the odometry of any recording out.
    imu
        Topic of the inertial unit in a bag; "none" leaves it out.
    camera
        Camera of a folder of pictures: fr1, fr2, fr3 (TUM RGB-D), or FX,FY,CX,CY[,K1,K2,P1,P2[,K3]] in pixels; default
        from a file in the folder or from the folder's name.
    depth_scale
        Units of the depth pictures in a metre, such as 1000 for millimetres; default 5000 for rgb/ and depth/, 1000 for
        numbered frames.
    register
        Colour and depth, of a folder or of a bag, that are not of the given camera: check tells it, with an estimate;
        auto maps with the estimated focal lengths, and depth as the colour sensor sees it. Default check.
    """

    base_from_laser: Annotated[tuple[str, ...], Parameter(allow_leading_hyphen=True)] = ()
    scan: tuple[str, ...] = ()
    odom: str | None = None
    imu: str | None = None
    camera: str | None = None
    depth_scale: float | None = None
    register: Literal["check", "auto"] | None = None

    def over(self, settings: InputSettings) -> InputSettings:
        """Return the settings, overridden by these options."""
        bag = settings.bag
        bag = replace(
            bag,
            scan_topics=self.scan or bag.scan_topics,
            odom_topic=self.odom or bag.odom_topic,
            imu_topic=self.imu or bag.imu_topic,
        )
        scale = settings.rgbd.depth_scale if self.depth_scale is None else self.depth_scale
        rgbd = replace(
            settings.rgbd,
            camera=self.camera or settings.rgbd.camera,
            depth_scale=scale,
            register=self.register or settings.rgbd.register,
        )
        return replace(settings, bag=bag, rgbd=rgbd, mounts=self.base_from_laser or settings.mounts)

    def without_pictures(self) -> tuple[str, ...]:
        """Return a sentence for each option that changes nothing, because the recording is no folder of pictures."""
        given = {"--camera": self.camera, "--depth-scale": self.depth_scale}
        unused = [option for option, value in given.items() if value is not None]
        return tuple(
            f"{option} changes nothing: it is about folders of pictures, and this is none" for option in unused
        )

    def without_colour_and_depth(self) -> tuple[str, ...]:
        """Return the sentence for --register, if it is given, where no pictures of colour and depth are used."""
        if self.register is None:
            return ()
        return ("--register changes nothing: no pictures of colour and depth are used here",)


class StageProgress:
    """Progress of each stage with its remaining time, and warnings, on standard error; without a console nothing is shown."""

    def __init__(self, console: Console | None, show: ShowStage) -> None:
        self._console, self._show = console, show

    def stage(self, name: str) -> Callable[[float], None]:
        """Return the callback for the share (0 to 1) of a stage that is done; the stage begins with its first call."""
        return partial(self._show, name)

    def warn(self, warnings: tuple[str, ...] | list[str]) -> None:
        """Print each warning on a line."""
        if self._console is None:
            return
        for warning in warnings:
            self._console.print(f"warning: {warning}", markup=False, highlight=False, soft_wrap=True)

    def read(self, path: Path | Sequence[Path], settings: InputSettings) -> Recording:
        """Read a recording of one or several files and print its warnings."""
        from waychair.recordings.recording import read_recording

        recording = read_recording(path, settings, progress=self.stage("reading"))
        self.warn(recording.warnings)
        return recording


@contextmanager
def stages(quiet: bool) -> Iterator[StageProgress]:
    """Show progress while the block runs; with `quiet` only errors."""
    from waychair.cli.options.progress import stage_bars, told_stages

    if quiet:
        with told_stages(quiet) as show:
            yield StageProgress(None, show)
        return
    from rich.console import Console

    console = Console(stderr=True)  # warnings come above its bars
    with stage_bars(console) as show:
        yield StageProgress(console, show)
