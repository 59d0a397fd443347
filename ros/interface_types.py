"""Importing the Python classes of ROS messages, services and actions, from an installed ROS or from our own build."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from functools import cache
from typing import Any

from waychair.errors import MissingExtra
from waychair.install_advice import install_command
from waychair.ros.interface_builder import TEXTS, built_interfaces


@cache
def interface_type(name: str) -> Any:
    """Return the class of an interface, e.g. `tf2_msgs/msg/TFMessage`.

    Packages of an installed ROS take precedence over our own build; see `built_interfaces`.

    Raises:
        MissingExtra: ROS, or this package of it, is not installed.
        InterfaceBuildError: the package cannot be built.
    """
    package, kind, leaf = name.split("/")
    _make_importable(package)
    try:
        return getattr(importlib.import_module(f"{package}.{kind}"), leaf)
    except ImportError as error:
        raise MissingExtra(
            f"the ROS messages {package} cannot be loaded ({error}): `{install_command('ros')}` (x86_64), or install "
            "ROS 2 Jazzy and source its setup.bash"
        ) from error


def prepare() -> None:
    """Build the missing message packages in advance; do nothing if an installed ROS has them all.

    Raises:
        MissingExtra, InterfaceBuildError: as `interface_type`.
    """
    for texts in TEXTS.iterdir():
        _make_importable(texts.name)


def _make_importable(package: str) -> None:
    if (TEXTS / package).is_dir() and importlib.util.find_spec(package) is None:
        sys.path.append(str(built_interfaces()))  # last on the path, so that installed packages are found first
        importlib.invalidate_caches()
