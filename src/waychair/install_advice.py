"""Commands and paths for advice that are exact on this computer, for a clone and for an installed wheel."""

from __future__ import annotations

import json
import shlex
import shutil
import sys
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import unquote, urlparse


def install_command(extra: str) -> str:
    """Return the command that installs an extra, such as `pip install -e '.[ui]'`.

    A clone that was installed with `pip install -e` is named by its path, unless it is the current folder.
    """
    clone = _clone()
    if clone is None:
        return f"{pip_install()} {shlex.quote(f'waychair[{extra}]')}"
    folder = "." if clone == Path.cwd() else str(clone)
    return f"{pip_install()} -e {shlex.quote(f'{folder}[{extra}]')}"


def pip_install() -> str:
    """Return `pip install`, by the Python that runs this program if another one's pip is first on the path."""
    found, python = shutil.which("pip"), Path(sys.executable)
    if find_spec("pip") is None and shutil.which("uv"):
        return "uv pip install"
    return "pip install" if found and Path(found).parent == python.parent else f"{python} -m pip install"


def document(path: str) -> str:
    """Return where a document of the clone, such as `docs/hardware.md`, is on this computer."""
    bases = [Path(__file__).resolve().parent, *([clone] if (clone := _clone()) is not None else [])]
    for file in (base / path for base in reversed(bases)):
        if file.is_file():
            return str(file.relative_to(Path.cwd()) if file.is_relative_to(Path.cwd()) else file)
    return f"{path} in waychair's sources"


def _clone() -> Path | None:
    """Return the folder of the clone that this waychair was installed from with `pip install -e`, else None."""
    try:
        told = metadata.distribution("waychair").read_text("direct_url.json")
    except metadata.PackageNotFoundError:
        return Path(__file__).resolve().parents[2]  # not installed at all: run from its sources
    try:
        source = json.loads(told or "{}")
        if not source["dir_info"].get("editable"):
            return None
        return Path(unquote(urlparse(source["url"]).path)).resolve()
    except (ValueError, KeyError, TypeError, AttributeError):
        return None
