"""`waychair config`."""

from __future__ import annotations


def config_command() -> None:
    """Print all settings of `waychair map` with defaults, units and meaning, as YAML for --config."""
    from waychair import config
    from waychair.offline.mapping import MappingSettings

    print(config.dump(MappingSettings()), end="")
