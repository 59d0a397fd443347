"""The options of a rider who cannot see: impossible ones are refused before anything starts."""

from __future__ import annotations

from pathlib import Path

import pytest

from waychair.cli.options.arguments import BadArgument
from waychair.cli.options.haptic_options import haptic_options
from waychair.control.haptics.profile import HapticsProfile, save_profile
from waychair.errors import ConfigError, TransportError


@pytest.fixture
def rider(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    save_profile(tmp_path / "rider.yaml", HapticsProfile(rate=200))
    return tmp_path / "rider.yaml"


def test_a_person_is_learnt_and_recorded_only_after_a_yes_and_a_simulated_driver_never(rider: Path) -> None:
    assert haptic_options(None, None, None) is None
    person = haptic_options(rider, "/dev/ttyUSB1", None)
    assert person is not None
    assert person.profile.rate == 200
    assert person.learnt == rider.parent / "data" / "waychair" / "learnt.json"
    assert person.session is not None
    assert not person.session.wanted
    assert not (rider.parent / "data").exists()
    driver = haptic_options(rider, None, "older")
    assert driver is not None
    assert (driver.learnt, driver.session, driver.driver) == (None, None, "older")


@pytest.mark.parametrize(
    ("glove", "driver", "error", "told"),
    [
        ("/dev/ttyUSB1", "older", BadArgument, "feels the glove's program on this computer"),
        ("ttyUSB1", None, TransportError, "--glove must be /dev/"),
        (None, "ghost", ConfigError, "there is no simulated driver 'ghost'"),
    ],
)
def test_impossible_gloves_and_drivers_are_refused(
    rider: Path, glove: str | None, driver: str | None, error: type[Exception], told: str
) -> None:
    with pytest.raises(error, match=told):
        haptic_options(rider, glove, driver)
    if told.startswith("feels"):
        with pytest.raises(BadArgument, match="need --haptics FILE"):
            haptic_options(None, glove, None)
