"""`waychair why`: explain a stop from the chair's black box."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from waychair.cli.options.arguments import BadArgument, NonNegativeInt

DEFAULT_BOXES = (Path("out/up/box"), Path("out/box"))
"""Default black boxes: that of the nodes, and that of a simulated drive in the guides."""


def why_command(
    *,
    box: Path | None = None,
    last: NonNegativeInt = 1,
    json: bool = False,
    bag: Annotated[Path | None, Parameter(name=["--bag", "--out", "-o"])] = None,
) -> None:
    """Explain the chair's last stop: its state before, the cause, the consequences, and the remedy.

    Parameters
    ----------
    box
        The folder that --box named when the chair drove; default the latest of `out/up/box` (the nodes' black box) and
        `out/box`.
    last
        Number of stops to explain, the latest first.
    json
        Print JSON.
    bag
        Write the sensor messages round the last stop to this ROS 2 bag, for `waychair map`: a new .mcap or .db3 file,
        or a new folder.
    """
    import msgspec

    from waychair.runtime.black_box.box_store import last_written_s
    from waychair.runtime.black_box.why import explain, last_stops, sentences

    if last < 1:
        raise BadArgument(f"--last is {last}: give 1 or more")
    stops = last_stops(box or max(DEFAULT_BOXES, key=last_written_s), last)
    explained = [explain(stop) for stop in stops]
    if bag is not None:
        from waychair.runtime.black_box.box_to_bag import write_bag
        from waychair.simulation.sensors.sonar import SonarSettings
        from waychair.trials.record import mounts_of

        write_bag(bag, stops[0].log, lambda body: mounts_of(body, SonarSettings().height))
    for stop in stops:
        if stop.part is not None:
            stop.part.mark_read()
    if json:
        print(msgspec.json.format(msgspec.json.encode({"stops": explained}), indent=2).decode())
    else:
        print("\n\n".join("\n".join(sentences(each)) for each in explained))
