"""Environment variables of a chair's ROS processes: discovery range and transport.

Nodes are visible on this computer only, unless they are opened to the network on purpose: any program that can publish
on the motion topics can move the chair.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path

from waychair.errors import ConfigError

PROFILE = Path(__file__).resolve().parent / "config" / "fastdds.xml"
"""Fast DDS profile with shared memory for pictures, and fast announcements."""

_PROFILE_VARIABLES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
_OPENED = "WAYCHAIR_LAN"
"""Marks an environment as opened on purpose; the chair's processes, which set their own environment, respect it."""

_DOMAINS = range(102)  # the domains whose ports do not overlap Linux's ephemeral ports


def ros_environment(
    *, domain: int | None = None, lan: bool = False, base: Mapping[str, str] | None = None
) -> dict[str, str]:
    """Return all variables for a process of the chair, based on `base` (default: this process's environment).

    `domain` is the ROS domain, by default that of `base`. `lan` opens the nodes to the local network. A Fast DDS profile
    set by the user is kept.

    Raises:
        ConfigError: the domain is not in 0 to 101.
    """
    variables = dict(os.environ if base is None else base)
    wanted = variables.get("ROS_DOMAIN_ID", "") if domain is None else str(domain)
    if wanted and (not wanted.isdecimal() or int(wanted) not in _DOMAINS):
        raise ConfigError(f"ROS_DOMAIN_ID = {wanted} is impossible: choose 0 to {_DOMAINS[-1]}")
    if wanted:
        variables["ROS_DOMAIN_ID"] = wanted
    variables.pop("ROS_LOCALHOST_ONLY", None)  # deprecated, and it would override the next variable
    lan = lan or variables.get(_OPENED) == "1"
    variables["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "SUBNET" if lan else "LOCALHOST"
    if lan:
        variables[_OPENED] = "1"
    else:
        variables.pop("ROS_STATIC_PEERS", None)
    if not any(variables.get(name) for name in _PROFILE_VARIABLES):
        variables[_PROFILE_VARIABLES[0]] = str(PROFILE)
    return variables


def enter_ros_environment(*, domain: int | None = None, lan: bool = False) -> None:
    """Set this process's environment to `ros_environment`, before its first use of ROS.

    Raises:
        ConfigError: the domain is not in 0 to 101.
    """
    variables = ros_environment(domain=domain, lan=lan)
    for name in set(os.environ) - set(variables):
        del os.environ[name]
    os.environ.update(variables)


def namespace_arguments(namespace: str) -> tuple[str, ...]:
    """Return the arguments after `--ros-args` that put a node into a namespace; none if it is empty.

    As in Nav2, /tf and /tf_static move into the namespace too, which separates the transforms of several chairs.

    Raises:
        ConfigError: the name is not a valid ROS namespace.
    """
    name = namespace.strip("/")
    if not name:
        return ()
    if not re.fullmatch(r"[A-Za-z_]\w*(/[A-Za-z_]\w*)*", name, re.ASCII):
        raise ConfigError(f"the namespace '{namespace}' is impossible: use letters, digits and _, such as left_chair")
    return "-r", f"__ns:=/{name}", "-r", "/tf:=tf", "-r", "/tf_static:=tf_static"


def is_secured(variables: Mapping[str, str]) -> bool:
    """Return whether processes of this environment sign and check all messages, and refuse unsigned ones (SROS 2)."""
    enforced = variables.get("ROS_SECURITY_STRATEGY", "").lower() == "enforce"
    return (
        variables.get("ROS_SECURITY_ENABLE", "").lower() == "true"
        and enforced
        and bool(variables.get("ROS_SECURITY_KEYSTORE"))
    )
