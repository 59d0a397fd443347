"""Strict YAML reading: every defect of a file raises the caller's error class, one sentence with the line."""

from __future__ import annotations

import reprlib
from pathlib import Path
from typing import Any

import yaml

from waychair.errors import WaychairError
from waychair.files import read_text

MAX_DEPTH = 50
"""Largest nesting depth of lists and mappings; unlimited nesting would overflow the stack."""

_TOO_DEEP = f"more than {MAX_DEPTH} nested lists or mappings"
"""Also used where libyaml, which reads ahead, hits its own limit of a thousand first (PyYAML >= 6.0.4)."""

_INTEGER_LIMIT = 2**63
"""Whole numbers stay below this, so that each can be converted to a float."""

_BASE: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class _Loader(_BASE):  # type: ignore[misc]
    """A safe loader that reports an invalid scalar with its position; PyYAML's raises ValueError or OverflowError."""

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        try:
            value = super().construct_object(node, deep)
        except (ValueError, OverflowError) as error:  # e.g. the date 2024-13-45
            raise _no_value(node) from error
        if isinstance(value, int) and abs(value) >= _INTEGER_LIMIT:
            raise _no_value(node)
        return value


def load_yaml(path: Path, failure: type[WaychairError], advice: str = "") -> Any:
    """Return the content of a YAML file, None when it is empty; `advice` is the advice for a file that is not text.

    Raises:
        WaychairError: of the type `failure`; the file cannot be read, is not YAML, or gives a key twice.
    """
    return yaml_from_text(read_text(path, failure, advice), str(path), failure)


def yaml_from_text(text: str, where: str, failure: type[WaychairError]) -> Any:
    """Return the content of a YAML text; `where` names its source in errors. Raises as `load_yaml`."""
    root = _composed(text, where, failure)
    return None if root is None else node_value(root, where, failure)


def compose_yaml(path: Path, failure: type[WaychairError]) -> yaml.Node | None:
    """Return the root node of a YAML file, with line numbers; None when the file is empty.

    Raises:
        WaychairError: as `load_yaml`.
    """
    return _composed(read_text(path, failure), str(path), failure)


def node_value(node: yaml.Node, where: str, failure: type[WaychairError]) -> Any:
    """Return the value of a node; `where` names its file in errors.

    Raises:
        WaychairError: of the type `failure`; the node has an unknown or invalid type.
    """
    loader = _Loader("")
    try:
        return loader.construct_document(node)
    except yaml.YAMLError as error:
        raise _refusal(where, error, failure) from error
    finally:
        loader.dispose()


def quoted(value: object) -> str:
    """Return a value as an error message quotes it, shortened if it is long."""
    return _QUOTES.repr(value)


def _composed(text: str, where: str, failure: type[WaychairError]) -> yaml.Node | None:
    try:
        _refuse_endless(text)
        loader = _Loader(text)
        try:
            root: yaml.Node | None = loader.get_single_node()
        finally:
            loader.dispose()
        _refuse_twice(root)
        return root
    except yaml.YAMLError as error:
        raise _refusal(where, error, failure) from error


def _refuse_endless(text: str) -> None:
    """Refuse deep nesting and self-reference before the recursive constructor runs."""
    above: list[str | None] = []
    for event in yaml.parse(text, Loader=_Loader):
        if isinstance(event, yaml.CollectionStartEvent):
            above.append(event.anchor)
        elif isinstance(event, yaml.CollectionEndEvent):
            above.pop()
        elif isinstance(event, yaml.AliasEvent) and event.anchor in above:
            raise _problem(f"'*{event.anchor}' contains itself", event.start_mark)
        if len(above) > MAX_DEPTH:
            raise _problem(_TOO_DEEP, event.start_mark)


def _refuse_twice(root: yaml.Node | None) -> None:
    """Refuse duplicate keys, of which PyYAML would silently keep the last."""
    ahead, known = [root], set()
    while ahead:
        node = ahead.pop()
        if not isinstance(node, yaml.CollectionNode) or id(node) in known:
            continue
        known.add(id(node))
        if not isinstance(node, yaml.MappingNode):
            ahead += node.value
            continue
        seen = set()
        for key, value in node.value:
            if isinstance(key, yaml.ScalarNode) and key.value in seen:
                raise _problem(f"'{key.value}' is given twice", key.start_mark)
            seen.add(key.value if isinstance(key, yaml.ScalarNode) else None)
            ahead += [key, value]


def _no_value(node: yaml.Node) -> yaml.MarkedYAMLError:
    return _problem(f"{quoted(node.value)} is not a valid value", node.start_mark)


def _problem(problem: str, mark: Any) -> yaml.MarkedYAMLError:
    return yaml.MarkedYAMLError(problem=problem, problem_mark=mark)


def _refusal(where: str, error: yaml.YAMLError, failure: type[WaychairError]) -> WaychairError:
    """Return the caller's error: the file, the line, the problem."""
    if isinstance(error, yaml.MarkedYAMLError):
        problem = _TOO_DEEP if "nesting depth" in (error.problem or "") else error.problem
        if "cannot start any token" in (problem or ""):
            problem = "a tab or another character stands where a value begins: indent by spaces"
        line = f", line {error.problem_mark.line + 1}" if error.problem_mark else ""
        context = f"{error.context}, " if (error.context or "").startswith("expected") else ""
        return failure(f"{where}{line}: {context}{problem}; correct the YAML there")
    if isinstance(error, yaml.reader.ReaderError):
        return failure(f"{where} is not YAML: it holds the character {error.character:#04x}; write it again")
    return failure(f"{where} is not YAML: {' '.join(str(error).split())}; write it again")


_QUOTES = reprlib.Repr()
_QUOTES.maxstring = _QUOTES.maxother = _QUOTES.maxlong = 60
