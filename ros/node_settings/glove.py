"""The settings of the glove node."""

from __future__ import annotations

from dataclasses import dataclass

from waychair.config import Settings, setting


@dataclass(frozen=True, slots=True)
class GloveNodeSettings(Settings):
    """The glove and its rider."""

    port: str = setting("", "", "port of the glove: /dev/ttyUSB1, pty:/dev/pts/N or tcp:HOST:PORT; empty: no glove")
    profile: str = setting(
        "", "", "file of the rider who is told (`waychair haptics tune`); empty: a right hand, untuned"
    )
