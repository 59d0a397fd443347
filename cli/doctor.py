"""`waychair doctor`: find missing parts of this machine, their purpose, and the command that fixes each."""

from __future__ import annotations

import enum
import os
import platform
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path

from waychair.install_advice import pip_install

GIGABYTE = 1e9
LEAST_DISK = 2 * GIGABYTE
LEAST_MEMORY = 1.5 * GIGABYTE
"""Free bytes for mapping a building and recording a drive through it; pictures take about 1 GB a minute."""

LEAST_CORES = 2
"""One for the stack, one for the simulator."""


class PartState(enum.Enum):
    """The state of a part."""

    OK = "ok"
    MISSING = "missing"  # missing, and needed for mapping, planning or simulation
    OPTIONAL = "optional"  # missing, and needed only for its own purpose


@dataclass(frozen=True, slots=True)
class Check:
    """One part of the machine; `remedy` is the command that fixes it, empty if the part is OK."""

    part: str
    state: PartState
    purpose: str
    remedy: str = ""


def doctor_command(*, warm: bool = False) -> None:
    """List missing parts of this machine and the commands that fix them.

    Exits with 1 if a part is missing that mapping, planning or simulated driving needs; optional parts are only listed.

    Parameters
    ----------
    warm
        Also compile the program for this computer, so that the first map and the first drive need not wait.
    """
    from rich.markup import escape
    from rich.table import Column, Table

    from waychair.cli.options.tables import print_table

    found = examine()
    table = Table("part", "state", "for", Column("command", overflow="fold"))
    colours = {PartState.OK: "green", PartState.MISSING: "red", PartState.OPTIONAL: "yellow"}
    for check in found:
        state = f"[{colours[check.state]}]{check.state.value}[/]"
        table.add_row(escape(check.part), state, check.purpose, escape(check.remedy))
    print_table(table)
    if any(check.state is PartState.MISSING for check in found):
        sys.exit(1)
    if warm:
        _warm_up()


def _warm_up() -> None:
    """Compile all kernels with a short simulated drive, and print how long it took."""
    from waychair.cli.options.progress import told_stages
    from waychair.trials.kernels import compile_kernels

    began = time.monotonic()
    with told_stages() as show:
        compile_kernels(show)
    print(f"compiled for this computer, and tried in a short simulated drive, in {time.monotonic() - began:.0f} s")


def examine() -> tuple[Check, ...]:
    """Check all parts, in the order in which to fix them."""
    return tuple(check() for check in _CHECKS)


def _check(part: str, purpose: str, remedy: str, ok: bool, otherwise: PartState) -> Check:
    return Check(part, PartState.OK, purpose) if ok else Check(part, otherwise, purpose, remedy)


def _python() -> Check:
    part = f"Python {platform.python_version()}"
    return _check(part, "everything", "sudo apt-get install python3.11", sys.version_info >= (3, 11), PartState.MISSING)


def _core() -> Check:
    return _packages("packages", None, "everything", PartState.MISSING)


def _physics() -> Check:
    return _packages("packages [sim]", "sim", "simulated physics and camera", PartState.OPTIONAL)


def _web() -> Check:
    return _packages("packages [ui]", "ui", "the web page", PartState.OPTIONAL)


def _fleet() -> Check:
    return _packages("packages [fleet]", "fleet", "several chairs that talk", PartState.OPTIONAL)


def _fleet_ports() -> Check:
    """Check that the first ports of chairs on this computer are free."""
    import socket

    from waychair.runtime.fleet.fleet_file import FIRST_PORT

    taken = []
    for port in range(FIRST_PORT + 1, FIRST_PORT + 4):
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:
                taken.append(port)
    remedy = f"stop the program at port {taken[0]} (ss -ltnp), or give `listen` in fleet.yaml" if taken else ""
    return _check("ports of chairs", "several chairs on this computer", remedy, not taken, PartState.OPTIONAL)


def _ros() -> Check:
    purpose = "ROS 2 nodes (bags need none)"
    if find_spec("rclpy") is not None:
        return Check("ROS 2", PartState.OK, purpose)
    installed = sorted(Path("/opt/ros").glob("*/setup.bash"))
    if installed:
        return Check("ROS 2", PartState.OPTIONAL, purpose, f"source {installed[-1]}")
    if platform.machine() != "x86_64":
        return Check("ROS 2", PartState.OPTIONAL, purpose, "sudo apt-get install ros-jazzy-ros-base")
    return _packages("ROS 2", "ros", purpose, PartState.OPTIONAL)


def _packages(part: str, extra: str | None, purpose: str, otherwise: PartState) -> Check:
    """Check that all packages that waychair or one of its extras requires are installed."""
    missing = []
    for requirement in metadata.requires("waychair") or []:
        needed, _, marker = requirement.partition(";")
        of_extra = re.search(r"extra == ['\"](\w+)['\"]", marker)
        if (of_extra[1] if of_extra else None) == extra and not _installed(needed):
            missing.append(f"'{needed.strip()}'")
    return _check(part, purpose, f"{pip_install()} {' '.join(missing)}", not missing, otherwise)


def _installed(requirement: str) -> bool:
    name = re.match(r"[\w.-]+", requirement.strip())
    assert name is not None
    try:
        metadata.version(name[0])
    except metadata.PackageNotFoundError:
        return False
    return True


def _camera() -> Check:
    """Check rendering in a separate process, as a broken driver may crash it."""
    program = (
        "import sys; from waychair.simulation.sensors.renderer import renderer_problem; sys.exit(renderer_problem())"
    )
    purpose, remedy = "simulated camera", "sudo apt-get install libegl1 libgl1-mesa-dri"
    if find_spec("moderngl") is None:
        return Check("EGL", PartState.OPTIONAL, purpose, f"{pip_install()} moderngl")
    try:
        done = subprocess.run([sys.executable, "-c", program], capture_output=True, check=False, timeout=60)
    except subprocess.TimeoutExpired:
        return Check("EGL", PartState.OPTIONAL, purpose, remedy)
    return _check("EGL", purpose, remedy, done.returncode == 0, PartState.OPTIONAL)


def _compiler() -> Check:
    found = any(shutil.which(name) for name in ("cc", "gcc", "clang"))
    purpose = "driving in the simulator with the board's firmware"
    return _check("C compiler", purpose, "sudo apt-get install gcc libc6-dev", found, PartState.OPTIONAL)


def _speech() -> Check:
    found = any(shutil.which(name) for name in ("espeak-ng", "spd-say"))
    return _check("speech", "spoken advice", "sudo apt-get install espeak-ng", found, PartState.OPTIONAL)


def _serial_ports() -> Check:
    """Check the access to serial ports, which belong to the group dialout on Debian."""
    import grp

    try:
        allowed = os.geteuid() == 0 or grp.getgrnam("dialout").gr_gid in os.getgroups()
    except KeyError:
        allowed = False
    remedy = "sudo usermod -aG dialout $USER, then log in again"
    return _check("serial ports", "a real chair", remedy, allowed, PartState.OPTIONAL)


def _recordings() -> Check:
    folder = Path(os.environ.get("WAYCHAIR_DATA", "../shared/data"))
    there = (folder / "lidar_intel").is_dir()
    remedy = "export WAYCHAIR_DATA=/path/to/recordings (a folder that holds lidar_intel)"
    return _check("recordings", "the demo on a real building", remedy, there, PartState.OPTIONAL)


def _disk() -> Check:
    free = shutil.disk_usage(Path.cwd()).free
    remedy = f"free {LEAST_DISK / GIGABYTE:g} GB (du -h --max-depth=1 ~), or work in another folder"
    part = f"disk, {free / GIGABYTE:.1f} GB free here"
    return _check(part, "recordings and maps", remedy, free >= LEAST_DISK, PartState.MISSING)


def _memory() -> Check:
    free = os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    meminfo = Path("/proc/meminfo")
    if meminfo.exists():  # counts reclaimable caches as free
        available = re.search(r"MemAvailable:\s+(\d+) kB", meminfo.read_text(encoding="utf-8"))
        free = int(available[1]) * 1024 if available else free
    part = f"memory, {free / GIGABYTE:.1f} GB free"
    remedy = "close programs (top -o %MEM shows the largest)"
    return _check(part, "mapping", remedy, free >= LEAST_MEMORY, PartState.MISSING)


def _cores() -> Check:
    count = len(os.sched_getaffinity(0))
    purpose = "simulating in real time"
    remedy = "add a core to this machine (taskset -p $$ shows the allowed ones)"
    return _check(f"processor, {count} cores", purpose, remedy, count >= LEAST_CORES, PartState.OPTIONAL)


def _kernel_cache() -> Check:
    """Check the cache of compiled kernels: numba needs its own folder or the sources' folder to be writable."""
    import waychair.planning

    folders = [Path(folder) for folder in waychair.planning.__path__]
    if chosen := os.environ.get("NUMBA_CACHE_DIR"):
        folders = [Path(chosen)]
    elif "HOME" in os.environ:
        folders.append(Path.home() / ".cache")
    writable = any(os.access(_existing(folder), os.W_OK) for folder in folders)
    purpose, remedy = "compiled kernels (otherwise each start takes a minute)", "export NUMBA_CACHE_DIR=/tmp/numba"
    return _check("kernel cache", purpose, remedy, writable, PartState.MISSING)


def _existing(folder: Path) -> Path:
    """Return the folder, or its nearest existing parent."""
    return next(path for path in (folder, *folder.absolute().parents) if path.exists())


_CHECKS: tuple[Callable[[], Check], ...] = (
    _python,
    _core,
    _kernel_cache,
    _disk,
    _memory,
    _cores,
    _physics,
    _camera,
    _recordings,
    _compiler,
    _speech,
    _serial_ports,
    _ros,
    _web,
    _fleet,
    _fleet_ports,
)
