"""All settings for recordings in one class: of mapping, of localising, and of mapping by pictures alone."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import TypeVar

from waychair.config import Settings
from waychair.offline.mapping import MappingSettings
from waychair.slam.localising.localiser import LocaliserSettings
from waychair.slam.rgbd.rgbd_mapper import RgbdMapperSettings

S = TypeVar("S", bound=Settings)


@dataclass(frozen=True, slots=True)
class RecordingSettings(MappingSettings):
    """The settings of `waychair map`, with and without a lidar, and of `waychair localize`."""

    localiser: LocaliserSettings = field(default_factory=LocaliserSettings)
    rgbd: RgbdMapperSettings = field(default_factory=RgbdMapperSettings)

    def narrowed(self, kind: type[S]) -> S:
        """Return those of these settings that another class has; it has no others."""
        return kind(**{entry.name: getattr(self, entry.name) for entry in dataclasses.fields(kind)})
