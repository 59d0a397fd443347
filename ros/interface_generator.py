"""Generating the C sources of ROS messages, services and actions from their definitions, with ROS's own generators.

It runs as a process of its own (`python -m waychair.ros.interface_generator TEXTS PACKAGE OUT PREFIX...`), because the
generators read the environment and take over standard output. In an installed ROS the same generators run under CMake;
the wheels lack the CMake packages, but have all of the Python code.
"""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path

DEPENDENCIES = (
    "builtin_interfaces",
    "std_msgs",
    "geometry_msgs",
    "nav_msgs",
    "service_msgs",
    "unique_identifier_msgs",
    "action_msgs",
)
"""Packages that the definitions may refer to; services and actions need the last three."""

INTROSPECTION = "introspection"
"""Folder of the introspection sources, apart from the others because file names repeat."""

_FASTRTPS, _INTROSPECTION = "rosidl_typesupport_fastrtps_c", "rosidl_typesupport_introspection_c"


def generate(texts: Path, package: str, out: Path, prefixes: list[Path]) -> None:
    """Generate the sources of `package` from the definitions in `texts`/`package` into `out`.

    `out` then holds `src` and `introspection` (C and C++, each with a folder of the package's name) and `py` (the
    Python package and its extension's C). `prefixes` are installations with share/DEPENDENCY.
    """
    os.environ["AMENT_PREFIX_PATH"] = os.pathsep.join(map(str, prefixes))  # the generators find their templates by it
    from rosidl_generator_c.cli import GenerateC
    from rosidl_generator_py.cli import GeneratePython
    from rosidl_generator_type_description.cli import HashTypeDescription
    from rosidl_typesupport_c.cli import GenerateCTypesupport
    from rosidl_typesupport_fastrtps_c.cli import GenerateFastRTPSCTypesupport
    from rosidl_typesupport_introspection_c.cli import GenerateIntrospectionCTypesupport

    definitions = _translated(texts / package, package, out / "idl")
    shares = [str(share) for name in DEPENDENCIES if (share := _share(name, prefixes)) is not None]
    c, introspection, python = (out / folder / package for folder in ("src", INTROSPECTION, "py"))
    hashes = HashTypeDescription("type_description").generate_type_hashes(package, definitions, shares, out / "hash")
    GenerateC("c").generate(package, definitions, shares, c, hashes)
    GenerateFastRTPSCTypesupport("fastrtps_c").generate(package, definitions, shares, c)
    GenerateIntrospectionCTypesupport("introspection_c").generate(package, definitions, shares, introspection)
    GenerateCTypesupport("c", typesupport_implementations=[_FASTRTPS]).generate(package, definitions, shares, c)
    GeneratePython("py", typesupport_implementations=["rosidl_typesupport_c"]).generate(
        package, definitions, shares, python
    )
    for dispatcher in c.glob("*/*__type_support.cpp"):
        _link_statically(dispatcher, package)
    (python / "__init__.py").touch()


def _translated(texts: Path, package: str, out: Path) -> list[str]:
    """Translate the definitions to IDL, and return them as FOLDER:FILE."""
    from rosidl_adapter.action import convert_action_to_idl
    from rosidl_adapter.msg import convert_msg_to_idl
    from rosidl_adapter.srv import convert_srv_to_idl

    converters = {"msg": convert_msg_to_idl, "srv": convert_srv_to_idl, "action": convert_action_to_idl}
    definitions = []
    for kind, convert in converters.items():
        for text in sorted((texts / kind).glob(f"*.{kind}")):
            (out / kind).mkdir(parents=True, exist_ok=True)
            convert(texts, package, Path(kind, text.name), out / kind)
            definitions.append(f"{out}:{kind}/{text.stem}.idl")
    return definitions


def _share(package: str, prefixes: list[Path]) -> Path | None:
    return next((share for prefix in prefixes if (share := prefix / "share" / package).is_dir()), None)


def _link_statically(dispatcher: Path, package: str) -> None:
    """Make a type's dispatcher answer for both implementations that rmw_fastrtps uses: fastrtps and introspection.

    The generated dispatcher knows only one, or opens shared libraries by name, which would need LD_LIBRARY_PATH. The
    returned handle becomes a copy whose lookup function answers for both.
    """

    def replacement(found: re.Match[str]) -> str:
        kind, names = found.group(1), found.group(2)
        handle = f"rosidl_{kind.lower()}_type_support_t"
        fast, fields = (
            f"ROSIDL_TYPESUPPORT_INTERFACE__{kind}_SYMBOL_NAME({implementation}, {names})"
            for implementation in (_FASTRTPS, _INTROSPECTION)
        )
        return (
            f"  static {handle} handle = *{fast}();\n"
            f"  handle.func = +[](const {handle} *, const char * wanted) -> const {handle} * {{\n"
            f"    if (!strcmp(wanted, {_INTROSPECTION}__identifier)) return {fields}();\n"
            f"    const {handle} * other = {fast}();\n"
            "    return other->func(other, wanted);\n"
            "  };\n"
            "  return &handle;"
        )

    pattern = rf"  return ROSIDL_TYPESUPPORT_INTERFACE__(MESSAGE|SERVICE)_SYMBOL_NAME\({_FASTRTPS}, ([^)]*)\)\(\);"
    text, replaced = re.subn(pattern, replacement, dispatcher.read_text())
    if not replaced:
        raise RuntimeError(f"{dispatcher.name} does not have the form of ROS Jazzy's generators 3.2")
    stem = dispatcher.name.removesuffix("__type_support.cpp")
    header = f"{package}/{dispatcher.parent.name}/detail/{stem}__{_INTROSPECTION}.h"
    includes = ("<cstring>", f'"{_INTROSPECTION}/identifier.h"', f'"{header}"')
    dispatcher.write_text("".join(f"#include {name}\n" for name in includes) + text)


if __name__ == "__main__":
    generate(Path(sys.argv[1]), sys.argv[2], Path(sys.argv[3]), [Path(prefix) for prefix in sys.argv[4:]])
