"""`waychair building tag`: AprilTags to print, and to hang up as beacons of a building."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from waychair.cli.options.arguments import NonNegativeInt, check_picture


def tag_command(number: NonNegativeInt, /, *, out: Annotated[Path, Parameter(name=["--out", "-o"])]) -> None:
    """Write an AprilTag as a picture to print. Hung on a wall, and set as a beacon in the editor, it tells a chair where it is.

    Parameters
    ----------
    number
        Number of the tag, 0 to 586: the id of the beacon.
    out
        PNG file to write; print it with a side of about 0.25 m, with its white edge.
    """
    from waychair.files import write_bytes
    from waychair.maps.building.april_tags import tag_picture
    from waychair.png import grey_png

    check_picture(out, "--out")
    write_bytes(out, grey_png(tag_picture(number)))
    print(f"wrote AprilTag {number} to {out}: hang it 1 to 1.5 m high, and set beacon '{number}' in the editor")
