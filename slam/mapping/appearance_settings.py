"""Settings of loop closure by appearance, apart from it: they are read where there are no pictures, too."""

from __future__ import annotations

from dataclasses import dataclass, field

from waychair.config import Settings, setting
from waychair.slam.memory.memory_settings import MemorySettings
from waychair.slam.words.recognition_settings import RecognitionSettings


@dataclass(frozen=True, slots=True)
class AppearanceSettings(Settings):
    """The timing of pictures, and the parts' settings; RTAB-Map's names in brackets."""

    detection_rate: float = setting(
        1.0, "Hz",
        "rate of place recognition; larger: it recognises more places and takes more time [Rtabmap/DetectionRate]",
        low=0.01, high=30,
    )  # fmt: skip
    gap: float = setting(
        0.5, "s", "longest time between the scans before and after a picture; larger: a slower lidar will do",
        low=0.01, high=10.0,
    )  # fmt: skip
    places: RecognitionSettings = field(default_factory=RecognitionSettings)
    memory: MemorySettings = field(default_factory=MemorySettings)
