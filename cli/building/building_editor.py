"""`waychair building edit`: the page's building mode for a folder, without a chair."""

from __future__ import annotations

import signal
import sys
import time
from pathlib import Path

from waychair.cli.options.arguments import NonNegativeInt

_LOOK_S = 0.2


def edit_command(
    folder: Path,
    /,
    *,
    body: str = "A",
    port: NonNegativeInt = 8000,
    lan: bool = False,
    page_name: tuple[str, ...] = (),
    token: str | None = None,
) -> None:
    """Open the editor of a building: its page shows maps, graph and checks, and changes all of them.

    Where the folder holds no building yet, a new one is begun. Map folders beside it are offered as storeys.

    Parameters
    ----------
    folder
        Folder of the building.
    body
        The chair's body, whose doors and ways are checked: A, B, A_mid, A_front or robot.
    port
        Port of the page.
    lan
        Let other computers on the network open the page, with the token.
    page_name
        Name by which other computers may open the page; can be given more than once.
    token
        The token; without it, a random one is printed.
    """
    from waychair.cli.options.arguments import body_named
    from waychair.cli.options.page_process import check_page_port, page_addresses, page_names, page_token
    from waychair.cli.options.progress import prepare_kernels
    from waychair.runtime.processes import signalled
    from waychair.ui.editor.server import editor_server
    from waychair.ui.editor.session import Session

    chair = body_named(body)
    check_page_port(port, "--port")
    names, secret = page_names(page_name, lan), page_token(lan, token)
    ending = signalled(signal.SIGINT, signal.SIGTERM)
    prepare_kernels()
    host = "0.0.0.0" if lan else "127.0.0.1"
    with (
        Session(folder, chair) as session,
        editor_server(session, host=host, http_port=port, token=secret, names=names),
    ):
        told = "\n  or at ".join(page_addresses(port, lan, secret, page_name))
        print(f"waychair: edit the building at {told}; end with Ctrl-C", file=sys.stderr)
        while not ending():
            time.sleep(_LOOK_S)
