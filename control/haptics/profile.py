"""How one rider is told: the device and its fitting, and the channels: touch, speech, tones, text, alone or together."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import yaml

from waychair.config import Settings, load, setting
from waychair.control.haptics.words import Wording
from waychair.errors import ConfigError
from waychair.files import write_text
from waychair.firmware_bridge.glove.fitting import Fitting
from waychair.firmware_bridge.glove.layouts import layout_named
from waychair.firmware_bridge.glove.messages import Hand
from waychair.types import HelpLevel


@dataclass(frozen=True, slots=True)
class HapticsProfile(Settings):
    """One rider's file. Nothing in it can move the chair, and no level of help begins by it: the last one is offered."""

    device_id: str = setting("A", "", "name of the rider's glove, as in its firmware")
    layout: str = setting("glove_3x3", "", "layout of its motors: glove_3x3, belt_8, bracelets or arm_rest_4")
    hand: str = setting("right", "", "hand that wears the glove: left, right, or none for a belt or an arm rest")
    turned: tuple[int, ...] = setting((), "places", "by how far each ring sits to the left (`waychair haptics tune`)")
    gains: tuple[int, ...] = setting((), "1/255", "strength of each motor; larger: stronger (`waychair haptics tune`)")
    touch: bool = setting(True, "", "whether advice is felt")
    speech: bool = setting(True, "", "whether advice is spoken")
    tones: bool = setting(False, "", "whether advice is heard as tones")
    advice: str = setting(
        "guide",
        "",
        "guide: the steps and symbols of this chair; paper: the signals of the source paper's cells, for comparison",
    )
    wording: str = setting("short", "", "short: a word or two; full: a sentence with the reason")
    rate: int = setting(175, "words/min", "rate of the speech; larger: faster", low=80, high=450)
    volume: float = setting(0.8, "", "volume of speech and tones; larger: louder", low=0.0, high=1.0)
    level: str = setting(
        "inform", "", "level of help that the rider chose last, which is offered: inform, guard or guide"
    )

    def __post_init__(self) -> None:
        Settings.__post_init__(self)
        _check_choice("advice", self.advice, ["guide", "paper"])
        if self.advice == "paper" and self.layout != "glove_3x3":
            raise ConfigError(f"the paper's signals have no code for the layout '{self.layout}': choose glove_3x3")
        _check_choice("hand", self.hand, [hand.name.lower() for hand in Hand])
        _check_choice("wording", self.wording, [wording.value for wording in Wording])
        _check_choice("level", self.level, [level.value for level in HelpLevel])

    @property
    def as_paper(self) -> bool:
        """Whether the rider feels the paper's own signals."""
        return self.advice == "paper"

    def fitting(self) -> Fitting:
        """Return the fitting of the device.

        Raises:
            GloveError: the layout is not known, or the fitting is for another one.
        """
        fitting = Fitting(Hand[self.hand.upper()], self.turned, self.gains)
        fitting.check(layout_named(self.layout))
        return fitting


def _check_choice(name: str, value: str, choices: list[str]) -> None:
    if value not in choices:
        raise ConfigError(f"{name} = '{value}' is impossible: choose among {', '.join(choices)}")


def load_profile(path: Path) -> HapticsProfile:
    """Return a rider's profile from a YAML file; missing lines keep their defaults.

    Raises:
        ConfigError: the file cannot be read, or holds something impossible.
        GloveError: its fitting is for another layout.
    """
    profile = load(HapticsProfile, path)
    profile.fitting()
    return profile


def save_profile(path: Path, profile: HapticsProfile) -> None:
    """Write a rider's profile.

    Raises:
        OutputError: the file cannot be written.
    """
    values = {name: getattr(profile, name) for name in HapticsProfile.__dataclass_fields__}
    plain = {name: list(value) if isinstance(value, tuple) else value for name, value in values.items()}
    write_text(path, yaml.safe_dump(plain, sort_keys=False))
