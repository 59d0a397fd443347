"""The shipped networks by name, with their settings as a trace holds them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import msgspec

from waychair.calibration.chair_body import CHAIR_A, ChairBody
from waychair.config import from_mapping
from waychair.control.behaviours.cell_network import Wiring
from waychair.control.behaviours.default import default_network
from waychair.control.behaviours.paper import PaperSettings, paper_network
from waychair.errors import BehaviourError

PRESETS = {"paper": paper_network, "default": default_network}
"""The shipped networks by name: the paper's, and the same cells with today's sensors."""


@dataclass(frozen=True, slots=True)
class Preset:
    """A shipped network: its name, its settings and chair as plain values, and its wiring."""

    name: str
    values: Mapping[str, Any]
    wiring: Wiring


def shipped(name: str, settings: PaperSettings, body: ChairBody) -> Preset:
    """Return a shipped network for a chair; raises as `preset_network`."""
    values: dict[str, Any] = msgspec.to_builtins({"settings": settings, "body": body})
    return Preset(name, values, preset_network(name, values))


def preset_network(name: str, values: Mapping[str, Any]) -> Wiring:
    """Return a shipped network from plain values; empty: its defaults, for chair A.

    Raises:
        BehaviourError: there is no such preset.
        ConfigError: the values are impossible.
    """
    if name not in PRESETS:
        raise BehaviourError(f"there is no preset '{name}': choose among {', '.join(PRESETS)}")
    body = from_mapping(ChairBody, values["body"], "the trace's chair") if "body" in values else CHAIR_A
    return PRESETS[name](from_mapping(PaperSettings, values.get("settings", {}), "the trace's settings"), body)
