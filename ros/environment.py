"""The environment variables of a chair's ROS processes: who is found, and by which transport.

A chair's nodes are found on this computer only, unless somebody opens them to the network: whoever reaches the topics
of motion can move the chair.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path

from waychair.errors import ConfigError

PROFILE = Path(__file__).resolve().parent / "config" / "fastdds.xml"
"""Fast DDS with shared memory for pictures, and fast announcements."""

_PROFILE_VARIABLES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
_OPENED = "WAYCHAIR_LAN"
"""Tells the processes of a chair, which enter their environment by themselves, that it was opened on purpose."""

_DOMAINS = range(102)  # those whose ports do not meet a Linux computer's ephemeral ones


def ros_environment(
    *, domain: int | None = None, lan: bool = False, base: Mapping[str, str] | None = None
) -> dict[str, str]:
    """All variables for a process of the chair, from those of `base` (this process's, unless given).

    `domain`: the ROS domain, else that of `base`. `lan` opens the nodes to the local network. A Fast DDS profile that
    the user has named stays.

    Raises:
        ConfigError: the domain is none of 0 to 101.
    """
    variables = dict(os.environ if base is None else base)
    wanted = variables.get("ROS_DOMAIN_ID", "") if domain is None else str(domain)
    if wanted and (not wanted.isdecimal() or int(wanted) not in _DOMAINS):
        raise ConfigError(f"ROS_DOMAIN_ID = {wanted} is impossible: take one of 0 to {_DOMAINS[-1]}")
    if wanted:
        variables["ROS_DOMAIN_ID"] = wanted
    variables.pop("ROS_LOCALHOST_ONLY", None)  # outdated, and stronger than what follows
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
    """Give this process those variables, before it first uses ROS.

    Raises:
        ConfigError: the domain is none of 0 to 101.
    """
    variables = ros_environment(domain=domain, lan=lan)
    for name in set(os.environ) - set(variables):
        del os.environ[name]
    os.environ.update(variables)


def namespace_arguments(namespace: str) -> tuple[str, ...]:
    """What a node is started with to live in a namespace, after `--ros-args`; nothing, where that is empty.

    Its transforms are told apart from those of other chairs as Nav2 does it: /tf and /tf_static lie in it, too.

    Raises:
        ConfigError: no namespace of ROS can be called so.
    """
    name = namespace.strip("/")
    if not name:
        return ()
    if not re.fullmatch(r"[A-Za-z_]\w*(/[A-Za-z_]\w*)*", name, re.ASCII):
        raise ConfigError(f"the namespace '{namespace}' is impossible: take letters, digits and _, such as left_chair")
    return "-r", f"__ns:=/{name}", "-r", "/tf:=tf", "-r", "/tf_static:=tf_static"


def is_secured(variables: Mapping[str, str]) -> bool:
    """Whether processes of this environment sign and check their messages, and refuse those who do not (SROS 2)."""
    enforced = variables.get("ROS_SECURITY_STRATEGY", "").lower() == "enforce"
    return (
        variables.get("ROS_SECURITY_ENABLE", "").lower() == "true"
        and enforced
        and bool(variables.get("ROS_SECURITY_KEYSTORE"))
    )
