"""The level of help that one rider chose last, in the rider's file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from waychair.control.haptics.profile import HapticsProfile, load_profile, save_profile
from waychair.errors import ConfigError, WaychairError
from waychair.files import is_file
from waychair.types import HelpLevel


class KeptLevel:
    """The rider's file of `waychair haptics`; None: nothing is kept."""

    def __init__(self, path: Path | None = None) -> None:
        self._path = path

    def level(self) -> HelpLevel:
        """Return the level that the rider chose last; inform without a file.

        Raises:
            ConfigError: the file cannot be read, or holds something impossible.
            GloveError: its fitting is for another layout.
        """
        return HelpLevel(self._profile().level)

    def keep(self, level: HelpLevel) -> str:
        """Write a chosen level into the file; return why that failed, as a sentence, or an empty text."""
        if self._path is None:
            return ""
        try:
            rider = self._profile()
            if rider.level != level.value:
                save_profile(self._path, replace(rider, level=level.value))
        except WaychairError as error:
            return f"It is not kept for the next time: {error}."
        return ""

    def _profile(self) -> HapticsProfile:
        path = self._path
        return load_profile(path) if path is not None and is_file(path, ConfigError) else HapticsProfile()
