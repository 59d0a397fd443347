"""Settings of place recognition, apart from it: a mapper of scans alone reads them without vocabulary and OpenCV."""

from __future__ import annotations

from dataclasses import dataclass, field

from waychair.config import Settings, setting
from waychair.slam.camera.feature_settings import FeatureSettings


@dataclass(frozen=True, slots=True)
class RecognitionSettings(Settings):
    """Settings of place recognition."""

    accept: float = setting(
        0.11, "", "least probability of a known place for a loop closure; larger: fewer, safer loops [Rtabmap/LoopThr]",
        low=0, high=1,
    )  # fmt: skip
    features: FeatureSettings = field(default_factory=lambda: FeatureSettings(detector="orb"))
