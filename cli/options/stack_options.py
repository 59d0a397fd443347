"""Options of the commands that start or use a chair's ROS nodes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from waychair.cli.options.arguments import NonNegativeInt

if TYPE_CHECKING:
    from waychair.ros.client import ChairClient


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class ChairAddress:
    """The ROS domain and namespace of a chair's nodes.

    Parameters
    ----------
    domain
        ROS domain of the chair, 0 to 101.
    namespace
        Namespace of the chair's nodes and topics, for several chairs in one domain.
    """

    domain: NonNegativeInt | None = None
    namespace: str = ""

    def client(self) -> ChairClient:
        """Return a client of these nodes."""
        from waychair.ros.client import ChairClient

        return ChairClient(domain=self.domain, namespace=self.namespace)


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class StackChairOptions:
    """The chair, simulated or real.

    Parameters
    ----------
    sim
        Simulate a chair in this world (see `waychair worlds`), in real time.
    chair
        A real chair's calibration file, which --cable needs (see `waychair calibrate`).
    cable
        Port of a real chair's board: /dev/ttyUSB0, pty:PATH or tcp:HOST:PORT.
    camera
        Simulate or use a camera.
    people
        Simulate the world's people.
    seed
        Seed of the simulated chair.
    unattended
        Let a simulated chair drive to goals without confirmation.
    """

    sim: Annotated[str | None, Parameter(name=["--sim", "--world"])] = None
    chair: Path | None = None
    cable: str = ""
    camera: bool = True
    people: bool = True
    seed: NonNegativeInt = 0
    unattended: bool = False


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class StackFileOptions:
    """The files that a run reads and writes.

    Parameters
    ----------
    config
        YAML file with settings that differ from the defaults (see `waychair config`).
    params
        A ROS parameter file, which overrides --config.
    out
        Folder for the run's files.
    box
        Folder of the black box for `waychair why`; default `box` in the run's folder.
    no_box
        Write no black box.
    """

    config: Path | None = None
    params: Path | None = None
    out: Annotated[Path, Parameter(name=["--out", "-o"])] = Path("out/up")
    box: Path | None = None
    no_box: Annotated[bool, Parameter(negative=())] = False

    @property
    def black_box(self) -> Path | None:
        """Folder of the black box; None for no log."""
        return None if self.no_box else self.box or self.out / "box"


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class StackPageOptions:
    """The rider's page of a run.

    Parameters
    ----------
    page
        Serve the rider's page; default if the extra [ui] is installed.
    page_port
        Port of the page; default 8000, or a free port if that is taken.
    page_lan
        Let other computers on the network open the page with the token; the nodes stay hidden.
    page_name
        Further host name by which --page-lan may be opened, such as chair.lan; may be repeated. Numbers and NAME.local
        always work.
    token
        Token for --page-lan; default a random one, which is printed.
    """

    page: bool | None = None
    page_port: NonNegativeInt | None = None
    page_lan: bool = False
    page_name: tuple[str, ...] = ()
    token: str | None = None

    def port(self) -> int | None:
        """Return the port of the page, None for no page.

        Raises:
            MissingExtra: the page is wanted and the extra [ui] is not installed.
            BadArgument: the port is taken or invalid.
        """
        from waychair.cli.options.page_process import has_ui, port_of_page
        from waychair.errors import MissingExtra
        from waychair.install_advice import install_command

        if self.page and not has_ui():
            raise MissingExtra(f"the page needs the extra [ui]: {install_command('ui')}")
        served = has_ui() if self.page is None else self.page
        return port_of_page(self.page_port) if served else None

    @property
    def host(self) -> str:
        """Address on which the page is served."""
        return "0.0.0.0" if self.page_lan else "127.0.0.1"
