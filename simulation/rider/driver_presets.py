"""Drivers by name, with the source of each figure; everything marked so is our assumption.

| preset | figure | source |
|---|---|---|
| default | places on the back of the hand: 0.7 of a spacing of 25 mm, 2 of 9 static points | Chen et al., EuroHaptics 2008, 3 people |
| default | reaction 0.45 +- 0.12 s, to a warning 0.32 +- 0.07 s; all figures of the hand | assumption |
| waist | error of a place on the torso 20 mm | van Erp 2005: acuity 2 to 3 cm |
| older | reaction + 0.15 s, its spread half as large again | Bao et al. 2019: slower; by how much is an assumption |
| second_task | reaction + 0.13 s | Bao et al. 2019 |
| noisy_hand | bias and wander twice as large | assumption |
| sure_85, sure_70 | share of symbols understood | assumption |
| warnings_90 | share of warnings noticed | assumption |
| fast_swivel | turns on the spot at twice the rate | assumption |
| at_random, opposite, idle | does something else than each symbol asks for, its opposite, or nothing | made up: riders who cannot be led |
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

from waychair.errors import ConfigError
from waychair.simulation.rider.blind_driver import DriverModel
from waychair.simulation.rider.hand import HandModel
from waychair.simulation.rider.skin import SkinModel

_DEFAULT = DriverModel()
_HAND = _DEFAULT.hand

DRIVERS: Mapping[str, DriverModel] = MappingProxyType(
    {
        "default": _DEFAULT,
        "waist": replace(_DEFAULT, skin=SkinModel(common=15.0, single=13.0)),
        "older": replace(_DEFAULT, reaction_s=0.60, reaction_spread_s=0.18, startle_s=0.47, startle_spread_s=0.105),
        "second_task": replace(_DEFAULT, reaction_s=0.58, startle_s=0.45),
        "noisy_hand": replace(
            _DEFAULT, hand=replace(_HAND, bias=2.0 * _HAND.bias, wander=2.0 * _HAND.wander, drift=2.0 * _HAND.drift)
        ),
        "sure_85": replace(_DEFAULT, sure=0.85),
        "sure_70": replace(_DEFAULT, sure=0.70),
        "warnings_90": replace(_DEFAULT, warnings_felt=0.90),
        "fast_swivel": replace(_DEFAULT, hand=HandModel(swivel=0.38)),
        "at_random": replace(_DEFAULT, sure=0.0),
        "opposite": replace(_DEFAULT, obeys=-1.0),
        "idle": replace(_DEFAULT, obeys=0.0),
    }
)


def driver_named(name: str) -> DriverModel:
    """Return a driver.

    Raises:
        ConfigError: there is no such driver.
    """
    if name not in DRIVERS:
        raise ConfigError(f"there is no simulated driver '{name}': choose {', '.join(DRIVERS)}")
    return DRIVERS[name]
