"""The house itself: folders, links, wheel, lint bans and contracts agree, and a built wheel holds every room."""

from __future__ import annotations

import ast
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
ROOMS = {
    "recordings",
    "slam",
    "maps",
    "planning",
    "control",
    "firmware_bridge",
    "calibration",
    "simulation",
    "ros",
    "runtime",
    "offline",
    "ui",
    "trials",
    "cli",
}


def test_every_room_is_a_real_folder_with_a_relative_link() -> None:
    links = {path.name: path for path in (ROOT / "src" / "waychair").iterdir() if path.is_symlink()}
    assert set(links) == ROOMS
    for name, link in links.items():
        assert link.readlink() == Path("../..") / name
        assert (ROOT / name / "__init__.py").is_file()
        assert not (ROOT / name).is_symlink()


def test_wheel_sdist_and_lint_bans_name_exactly_the_rooms() -> None:
    targets = PYPROJECT["tool"]["hatch"]["build"]["targets"]
    assert set(targets["wheel"]["only-include"]) == ROOMS | {"src/waychair"}
    assert ROOMS | {"src/waychair"} <= set(targets["sdist"]["only-include"])
    assert targets["wheel"]["sources"] == {"src": "", **{room: f"waychair/{room}" for room in ROOMS}}
    bans = PYPROJECT["tool"]["ruff"]["lint"]["flake8-tidy-imports"]["banned-api"]
    assert bans == {room: {"msg": f"import waychair.{room}"} for room in ROOMS}


def test_every_module_is_in_one_layer() -> None:
    contract = PYPROJECT["tool"]["importlinter"]["contracts"][0]
    layered = {name.strip() for layer in contract["layers"] for name in layer.replace("|", ":").split(":")}
    modules = {path.stem for path in (ROOT / "src" / "waychair").glob("*.py")} - {"__init__"}
    inner = {f"calibration.{name}" for name in _inner_rooms("calibration")}  # its drives are above the rest of it
    assert layered == {f"waychair.{name}" for name in (ROOMS - {"calibration"}) | inner | modules}


def _inner_rooms(room: str) -> set[str]:
    """Return the names of a room's folders and modules."""
    folders = {path.parent.name for path in (ROOT / room).glob("*/__init__.py")}
    return folders | {path.stem for path in (ROOT / room).glob("*.py")} - {"__init__"}


def test_the_product_must_not_import_its_evaluation() -> None:
    linter = PYPROJECT["tool"]["importlinter"]
    forbidden = [contract for contract in linter["contracts"] if contract["type"] == "forbidden"]
    assert set(linter["root_packages"]) == {"waychair", "evaluation"}
    assert any(
        contract["source_modules"] == ["waychair"] and contract["forbidden_modules"] == ["evaluation"]
        for contract in forbidden
    )


def test_no_python_file_is_in_the_root() -> None:
    assert list(ROOT.glob("*.py")) == []


@pytest.mark.parametrize("folder", sorted(ROOMS | {"src", "tests", "evaluation"}))
def test_source_files_stay_under_500_lines(folder: str) -> None:
    for path in (ROOT / folder).rglob("*"):
        if path.suffix in {".py", ".c", ".h", ".js"} and "node_modules" not in path.parts:
            assert len(path.read_text().splitlines()) <= 500, path


MIRRORS = {
    "BoardTelemetry": "the board's message",
    "ChairBody": "a chair's file",
    "ChairView": "the page's message",
    "DriveReport": "the message DriveState",
    "FloorPlan": "a world's file",
    "GloveStatus": "the glove's message",
    "GuidedDriveRow": "a row of the trainer's table",
    "HapticState": "the page's message",
    "MujocoSettings": "settings",
    "PlantSettings": "settings",
    "Stack": "the options of `waychair up`",
    "State": "a peer's message",
    "Tick": "the black box's record",
    "VdaState": "a message of VDA 5050",
    "World": "a world's file",
}
"""Classes with more than fifteen attributes, and the thing whose fields each one repeats."""


def _stored(statement: ast.AST) -> Iterator[str]:
    """Yield the attributes of `self` that a statement sets."""
    for node in ast.walk(statement):
        if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store) and _is_self(node.value):
            yield node.attr


def _is_self(node: ast.expr) -> bool:
    return isinstance(node, ast.Name) and node.id == "self"


def _attributes(defined: ast.ClassDef) -> set[str]:
    """Return the names of a class's fields and of the attributes that its methods set."""
    fields = {
        line.target.id
        for line in defined.body
        if isinstance(line, ast.AnnAssign) and isinstance(line.target, ast.Name)
        if "ClassVar" not in ast.unparse(line.annotation)
    }
    return fields.union(*(_stored(method) for method in defined.body if isinstance(method, ast.FunctionDef)))


def _classes(block: ast.AST) -> Iterator[ast.ClassDef]:
    """Yield the classes in a block, in its functions, and within each other; no expression holds one."""
    for node in ast.iter_child_nodes(block):
        if isinstance(node, ast.ClassDef):
            yield node
        if isinstance(node, ast.stmt | ast.ExceptHandler | ast.match_case):
            yield from _classes(node)


def _code_files() -> Iterator[Path]:
    return (path for room in sorted(ROOMS | {"src", "tests", "evaluation"}) for path in (ROOT / room).rglob("*.py"))


def test_a_class_has_at_most_fifteen_attributes_unless_it_mirrors_a_file_or_a_message() -> None:
    texts = (path.read_text() for path in _code_files())
    defined = (node for text in texts if "class " in text for node in _classes(ast.parse(text)))
    assert {node.name for node in defined if len(_attributes(node)) > 15} == set(MIRRORS)


def _is_evaluation(name: str) -> bool:
    """Return whether a file of a wheel or sdist is evaluation code, not a test of it."""
    return "evaluation" in Path(name).parts and Path(name).parts[0] != "tests"


def test_the_wheel_built_from_the_sdist_holds_every_room_and_no_evaluation(tmp_path: Path) -> None:
    build = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(tmp_path), str(ROOT)]
    done = subprocess.run(build, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    wheel = next(tmp_path.glob("*.whl"))
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
        archive.extractall(tmp_path / "site")
    tracked = [
        path
        for room in ROOMS
        for path in (ROOT / room).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    ]
    assert {f"waychair/{path.relative_to(ROOT)}" for path in tracked} <= names
    assert {"waychair/types.py", "waychair/py.typed"} <= names
    with tarfile.open(next(tmp_path.glob("*.tar.gz"))) as archive:
        in_sdist = {name.partition("/")[2] for name in archive.getnames()}
    assert "src/waychair/types.py" in in_sdist
    assert not [name for name in names | in_sdist if _is_evaluation(name)]
    program = f"import sys; sys.path.insert(0, {str(tmp_path / 'site')!r})\n"
    program += "".join(f"import waychair.{room}\n" for room in sorted(ROOMS))
    program += f"import waychair; assert waychair.__file__.startswith({str(tmp_path)!r}), waychair.__file__"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
