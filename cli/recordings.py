"""What the commands that read a recording share: the options that say how, progress with the time left, warnings."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

if TYPE_CHECKING:
    from rich.progress import Progress

    from waychair.recording import InputSettings, Recording


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class RecordingOptions:
    """How a recording is read.

    Parameters
    ----------
    base_from_laser
        Where the lidar is mounted: X,Y,YAW in metres and radians, with ",upside-down" where it hangs so; once for each
        --scan. A bag's mounts are taken from its /tf without it; for a CARMEN log it also makes the robot's own pose
        the odometry (without it the base is the laser).
    scan
        Topic of the laser scans or point clouds in a bag; given more than once, these lidars are merged.
    odom
        Topic of the odometry in a bag; where there is none it is taken from /tf.
    imu
        Topic of the inertial unit in a bag.
    camera
        Camera of a folder of pictures: fr1, fr2, fr3 (TUM RGB-D), or FX,FY,CX,CY[,K1,K2,P1,P2[,K3]] in pixels; without
        it a file in the folder or the folder's name says it.
    """

    base_from_laser: Annotated[tuple[str, ...], Parameter(allow_leading_hyphen=True)] = ()
    scan: tuple[str, ...] = ()
    odom: str | None = None
    imu: str | None = None
    camera: str | None = None

    def over(self, settings: InputSettings) -> InputSettings:
        """The settings with what was said on the command line in their place."""
        bag = settings.bag
        bag = replace(
            bag,
            scan_topics=self.scan or bag.scan_topics,
            odom_topic=self.odom or bag.odom_topic,
            imu_topic=self.imu or bag.imu_topic,
        )
        rgbd = replace(settings.rgbd, camera=self.camera or settings.rgbd.camera)
        return replace(settings, bag=bag, rgbd=rgbd, mounts=self.base_from_laser or settings.mounts)


class Stages:
    """A bar with the time left for each stage of the work, and warnings, on standard error."""

    def __init__(self, bar: Progress) -> None:
        self._bar = bar

    def stage(self, name: str) -> Callable[[float], None]:
        """A new bar; it is told the share of the stage that is done."""
        task = self._bar.add_task(name, total=1.0)
        return lambda share: self._bar.update(task, completed=share)

    def warn(self, warnings: tuple[str, ...] | list[str]) -> None:
        """Each warning as a line."""
        for warning in warnings:
            self._bar.console.print(f"warning: {warning}", markup=False, highlight=False, soft_wrap=True)

    def read(self, path: Path, settings: InputSettings) -> Recording:
        """The recording, with its warnings told."""
        from waychair.recording import read_recording

        recording = read_recording(path, settings, progress=self.stage("reading"))
        self.warn(recording.warnings)
        return recording


@contextmanager
def stages(quiet: bool) -> Iterator[Stages]:
    """Progress while the block runs; nothing but errors when `quiet`."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        Progress,
        TaskProgressColumn,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    console = Console(file=sys.stderr, quiet=quiet)
    with Progress(
        *columns, TextColumn("so far"), TimeElapsedColumn(), console=console, transient=True, disable=quiet
    ) as bar:
        yield Stages(bar)
