"""Settings of the detector of features, apart from it: a mapper of scans alone reads them without OpenCV."""

from __future__ import annotations

from dataclasses import dataclass

from waychair.config import Settings, setting
from waychair.errors import ConfigError

DETECTORS = ("gftt_orb", "orb", "sift")
"""The possible values of `FeatureSettings.detector`."""


@dataclass(frozen=True, slots=True)
class FeatureSettings(Settings):
    """The detector of features (RTAB-Map's Kp/*)."""

    detector: str = setting("gftt_orb", "", "detector of image features: gftt_orb, orb or sift")
    max_features: int = setting(
        500,
        "",
        "number of strongest features kept of an image; more: it recognises more places and takes more time",
        low=1,
        high=20_000,
    )
    upright: bool = setting(
        True,
        "",
        "true: gftt_orb describes images of a camera that does not roll; false: descriptors turn with the image",
    )

    def __post_init__(self) -> None:
        Settings.__post_init__(self)
        if self.detector == "surf":
            raise ConfigError("the detector 'surf' is not in OpenCV 5: choose sift, the closest alternative, or orb")
        if self.detector not in DETECTORS:
            raise ConfigError(f"there is no detector '{self.detector}': choose one of {', '.join(DETECTORS)}")

    @property
    def binary(self) -> bool:
        """Whether descriptors are bits (Hamming distance) and not floats (Euclidean distance)."""
        return self.detector != "sift"
