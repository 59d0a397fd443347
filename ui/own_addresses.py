"""The names and addresses by which other computers reach this one."""

from __future__ import annotations

import ipaddress
import socket
import struct

_GET_FLAGS, _GET_ADDRESS = 0x8913, 0x8915
"""Linux's SIOCGIFFLAGS and SIOCGIFADDR (netdevice(7))."""

_RUNNING = 0x40
_ADDRESS_AT = slice(20, 24)
"""An interface's IPv4 address in the answer to SIOCGIFADDR, behind name, family and port."""

_ELSEWHERE = ("192.0.2.1", 9)
"""An address of no computer (RFC 5737), for the question which of ours leads there; nothing is sent."""


def own_names(name: str = "") -> tuple[str, ...]:
    """Return this computer's host name, its first part, and that in multicast DNS (NAME.local, RFC 6762).

    `name`: the host name, by default the system's.
    """
    name = (name or socket.gethostname()).rstrip(".").lower()
    first = name.partition(".")[0]
    if first in ("", "localhost"):
        return ()
    return tuple(dict.fromkeys((name, first, f"{first}.local")))


def own_addresses() -> tuple[str, ...]:
    """Return the IPv4 addresses of this computer on its networks, that of the default route first; empty without any."""
    found = [_on_default_route(), *(_of_interface(name) for _, name in socket.if_nameindex())]
    return tuple(dict.fromkeys(each for each in found if each and not ipaddress.ip_address(each).is_loopback))


def _on_default_route() -> str:
    """Return the address of the default route; empty without one."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asked:
        try:
            asked.connect(_ELSEWHERE)
        except OSError:
            return ""
        return str(asked.getsockname()[0])


def _of_interface(name: str) -> str:
    """Return the address of a network interface; empty if it has none, or nothing is plugged in."""
    try:
        import fcntl
    except ImportError:  # not on every system
        return ""
    request = struct.pack("256s", name.encode()[:15])
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asked:
        try:
            (flags,) = struct.unpack_from("H", fcntl.ioctl(asked.fileno(), _GET_FLAGS, request), 16)
            if not flags & _RUNNING:
                return ""
            return socket.inet_ntoa(fcntl.ioctl(asked.fileno(), _GET_ADDRESS, request)[_ADDRESS_AT])
        except OSError:
            return ""
