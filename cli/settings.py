"""`waychair config`."""

from __future__ import annotations


def config_command(part: str | None = None, /) -> None:
    """Print all settings with defaults, units and meaning, as a YAML file for --config.

    Parameters
    ----------
    part
        Print only this part: map, chair, simulation or nodes.
    """
    from waychair.cli.options.configuration import configuration_text, part_from_text

    print(configuration_text(None if part is None else part_from_text(part)), end="")
