"""Checkpoints: the state of a mapper, or of an object that holds one, as plain arrays and JSON, and back.

Nothing is pickled. Numbers, strings, containers, arrays, enumerations and waychair's own objects are written, and
reading creates objects of waychair classes only. Objects that are shared stay shared.
"""

from __future__ import annotations

import enum
import importlib
import json
from collections import Counter, defaultdict, deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import MISSING, fields, is_dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from waychair.slam.mapping.mapper import Mapper

State = Mapping[str, NDArray[Any]]
T = TypeVar("T")

_TREE = "tree"
_SMALL = 16  # arrays of at most so many numbers are written into the JSON
_PACKAGE = "waychair."
_FACTORIES: dict[str, Callable[[], Any]] = {"float": float, "int": int, "list": list, "dict": dict, "set": set}


def state_of(value: object) -> dict[str, NDArray[Any]]:
    """Return the state of a mapper, or of another waychair object, as named arrays for `numpy.savez`."""
    packer = _Packer()
    tree = json.dumps(packer.pack(value), separators=(",", ":"))
    return {**packer.arrays, _TREE: np.frombuffer(tree.encode(), np.uint8)}


def mapper_from_state(state: State) -> Mapper:
    """Return the mapper that had this state.

    Raises:
        ValueError: this is not the state of a mapper of this program version.
    """
    return object_from_state(state, Mapper)


def object_from_state(state: State, kind: type[T]) -> T:
    """Return the object of class `kind` that had this state.

    Raises:
        ValueError: this is not the state of such an object of this program version.
    """
    try:
        made = _Unpacker(state).unpack(json.loads(bytes(state[_TREE])))
        if not isinstance(made, kind):
            raise TypeError(f"it holds a {type(made).__name__}")
    except (KeyError, TypeError, AttributeError, IndexError, ImportError) as error:
        raise ValueError(
            f"this is not the state of a {kind.__name__.lower()} of this program version: {error}"
        ) from error
    return made


class _Packer:
    """Turns values into JSON: primitives unchanged, everything else as a list that begins with its kind."""

    def __init__(self) -> None:
        self.arrays: dict[str, NDArray[Any]] = {}
        self._seen: dict[int, int] = {}
        self._kept: list[Any] = []  # keeps the objects alive, so that no `id` is reused

    def pack(self, value: Any) -> Any:
        if isinstance(value, enum.Enum):
            return ["enum", _name(type(value)), value.name]
        if isinstance(value, np.generic):  # before float, because numpy's float64 is a float
            return self._array(np.asarray(value), "scalar")
        if value is None or isinstance(value, bool | int | float | str):
            return value
        if isinstance(value, tuple):
            return ["tuple", *map(self.pack, value)]
        if id(value) in self._seen:
            return ["again", self._seen[id(value)]]
        self._seen[id(value)] = len(self._kept)
        self._kept.append(value)
        return self._pack_new(value)

    def _pack_new(self, value: Any) -> list[Any]:
        if isinstance(value, np.ndarray):
            return self._array(value, "array")
        if isinstance(value, dict):
            kind, factory = "dict", ""
            if isinstance(value, Counter):
                kind = "counter"
            elif isinstance(value, defaultdict):
                kind, factory = "defaultdict", value.default_factory.__name__ if value.default_factory else ""
                if factory not in _FACTORIES:
                    raise TypeError(f"a checkpoint cannot hold a defaultdict of {factory}")
            return [kind, factory, *([self.pack(key), self.pack(item)] for key, item in value.items())]
        if isinstance(value, list | set | frozenset):
            return [type(value).__name__, *map(self.pack, value)]
        if isinstance(value, deque):
            return ["deque", value.maxlen, *map(self.pack, value)]
        if not type(value).__module__.startswith(_PACKAGE):
            raise TypeError(f"a checkpoint cannot hold a {type(value).__module__}.{type(value).__name__}")
        if hasattr(type(value), "__setstate__") and not is_dataclass(value):
            return ["stateful", _name(type(value)), self.pack(value.__getstate__())]
        names = [entry.name for entry in fields(value)] if is_dataclass(value) else list(vars(value))
        return ["object", _name(type(value)), {name: self.pack(getattr(value, name)) for name in names}]

    def _array(self, value: NDArray[Any], kind: str) -> list[Any]:
        if value.dtype.kind not in "biuf":
            raise TypeError(f"a checkpoint cannot hold an array of {value.dtype}")
        if value.size <= _SMALL:
            return [kind, value.dtype.str, list(value.shape), value.ravel().tolist()]
        key = f"a{len(self.arrays)}"
        self.arrays[key] = value
        return [kind, key]


class _Unpacker:
    def __init__(self, state: State) -> None:
        self._state = state
        self._made: list[Any] = []

    def unpack(self, node: Any) -> Any:
        if not isinstance(node, list):
            return node
        kind, *rest = node
        if kind == "tuple":
            return tuple(map(self.unpack, rest))
        if kind == "enum":
            return _class(rest[0])[rest[1]]
        if kind == "scalar":
            return self._array(rest)[()]
        if kind == "again":
            return self._made[rest[0]]
        place = len(self._made)
        self._made.append(None)
        if kind == "array":
            self._made[place] = self._array(rest)
        elif kind == "frozenset":
            self._made[place] = frozenset(map(self.unpack, rest))
        else:
            self._fill(place, kind, rest)
        return self._made[place]

    def _fill(self, place: int, kind: str, rest: list[Any]) -> None:
        """Create a container first and its contents afterwards, because the contents may refer to it."""
        if kind == "object":
            made = self._made[place] = object.__new__(_class(rest[0]))
            for name, node in rest[1].items():
                object.__setattr__(made, name, self.unpack(node))
            for name, value in _newer_fields(type(made), rest[1]):
                object.__setattr__(made, name, value)
        elif kind == "stateful":
            made = self._made[place] = object.__new__(_class(rest[0]))
            made.__setstate__(self.unpack(rest[1]))
        elif kind == "list":
            self._made[place] = []
            self._made[place].extend(map(self.unpack, rest))
        elif kind == "set":
            self._made[place] = set(map(self.unpack, rest))
        elif kind == "deque":
            self._made[place] = deque(maxlen=rest[0])
            self._made[place].extend(map(self.unpack, rest[1:]))
        else:
            empty: dict[str, Callable[[], Any]] = {"dict": dict, "counter": Counter}
            made = empty[kind]() if kind in empty else defaultdict(_FACTORIES[rest[0]])
            self._made[place] = made
            for key, item in rest[1:]:
                made[self.unpack(key)] = self.unpack(item)

    def _array(self, rest: list[Any]) -> NDArray[Any]:
        if len(rest) == 1:
            return np.array(self._state[rest[0]])
        dtype, shape, values = rest
        return np.array(values, np.dtype(dtype)).reshape(shape)


def _newer_fields(kind: type, known: Iterable[str]) -> Iterator[tuple[str, Any]]:
    """Yield the defaults of a dataclass's fields that an earlier version did not write.

    Raises:
        KeyError: such a field has no default.
    """
    for entry in fields(kind) if is_dataclass(kind) else ():
        if entry.name in known:
            continue
        if entry.default_factory is not MISSING:
            yield entry.name, entry.default_factory()
        elif entry.default is not MISSING:
            yield entry.name, entry.default
        else:
            raise KeyError(f"{kind.__name__} has no {entry.name}")


def _name(kind: type) -> str:
    return f"{kind.__module__}:{kind.__qualname__}"


def _class(name: str) -> Any:
    module, _, qualified = name.partition(":")
    if not module.startswith(_PACKAGE):
        raise ValueError(f"{name} is not a waychair class")
    found: Any = importlib.import_module(module)
    for part in qualified.split("."):
        found = getattr(found, part)
    return found
