"""The wiring of a network is checked when it is made, and refused with the cells' names."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from waychair.control.behaviours.cell import Cell, Sensor, before
from waychair.control.behaviours.cell_network import Network, Node, wire
from waychair.control.behaviours.conditions import Active, AtLeast, Below, PortSource
from waychair.errors import WiringError


@dataclass(frozen=True)
class Range:
    metres: float
    name: str = ""


@dataclass(frozen=True)
class Memory:
    count: int = 0


def number(x: float | None) -> float:
    return x or 0.0


def ranged() -> Range:
    return Range(1.0)


def words(text: str) -> str:
    return text


def remember(dynamic: Memory) -> tuple[int, Memory]:
    return dynamic.count, dynamic


def unannotated(x, y: float) -> float:  # type: ignore[no-untyped-def]
    return y


A = Cell("a", number)
LOOP = Network("inner", [Cell("c", number, links={"x": "inner"})], output="c")


class _Endless:
    """A network that holds itself, which only a mistake can build."""

    def __new__(cls) -> Network:  # type: ignore[misc]
        cells: list[Node] = []
        network = Network("endless", cells)
        cells.append(network)
        return network


REFUSED: list[tuple[list[Node], str]] = [
    ([Cell("b", number, links={"x": "sonnar"})], "DI x of b reads sonnar, which there is not; did you mean sonar?"),
    ([Cell("b", number, links={"z": "sonar"})], "b has no port DI z: it has x"),
    ([Cell("b", words, links={"text": "sonar"})], "DI text of b takes str, and sonar gives float"),
    ([Network("n", [A]), Cell("a", number)], "two cells are named a"),
    ([A, A], "root holds a twice"),
    ([Cell("sonar", number)], "sonar is declared twice"),
    ([Network("n", [])], "the network n has no cells"),
    ([Network("n", [A], output="b")], "the output b of n is none of its cells: a"),
    ([_Endless()], "endless contains itself"),  # type: ignore[list-item]
    ([Network("n", [A]), Cell("b", number, links={"x": "n"})], "DI x of b reads n, which has no EO"),
    ([Cell("b")], "b has neither EO nor AO"),
    ([Cell("b", {}.get)], "annotat"),  # type: ignore[arg-type]
    ([Cell("b", unannotated)], "unannotated has no annotation for x"),
    ([Cell("b", remember)], "takes dynamic data, and the cell declares none"),
    ([Cell("b", remember, dynamic=Memory(), cleared=("sum",))], "a reset of b clears sum"),
    ([Cell("b", number, inhibited_output="null")], "the output for inhibition of b is of type str"),
    ([Cell("b", number, fresh_ns={"z": 1})], "b limits the age of DI z"),
    ([Cell("b", number, every_ns=5, triggers=("sonar",))], "b has a period of 5 ns and triggers"),
    ([Cell("b", number, every_ns=-5)], "b has a period of -5 ns"),
    ([Cell("b", number, excited_by=Active("sonar"))], "EB of b reads AB of the sensor sonar: use a threshold"),
    ([Cell("b", number, inhibited_by=Active("d"))], "IB of b reads d, which there is not"),
    ([Cell("r", ranged), Cell("b", number, excited_by=AtLeast("r", 1.0))], "compares r, a Range, with a number"),
    ([Cell("r", ranged), Cell("b", number, excited_by=Below("r", 1.0, of="feet"))], "EB of b reads feet of r"),
    ([Cell("b", number, links={"x": "b"})], "b need each other's values within one innervation"),
    ([Cell("b", number, links={"x": "d"}), Cell("d", number, links={"x": "b"})], "d, b need|b, d need"),
    ([LOOP], "c need each other's values|inner, c need|c, inner need"),
    ([Network("n", [A], excited_by=Active("a"))], "need each other's values within one innervation"),
    ([Cell("b", number, links={"x": "a"}), A], "b reads a, which runs after it: declare a first"),
    ([Cell("b", None, {"horn": number}), Cell("c", None, {"horn": number})], "b and c both write the effector horn"),
    ([Network("n", [A], cleared=("b",))], "n clears b, which is none of its cells"),
    ([Network("n", [A]), Cell("b", number, triggers=("n",))], "b is triggered by n, which has no EO"),
]


@pytest.mark.parametrize(("cells", "sentence"), REFUSED)
def test_an_impossible_wiring_is_refused_with_the_names_of_the_cells(cells: list[Node], sentence: str) -> None:
    with pytest.raises(WiringError, match=sentence.replace("?", r"\?")) as refused:
        wire(Network("root", cells), [Sensor("sonar", float)])
    assert "\n" not in str(refused.value)


def test_a_loop_through_the_value_before_is_allowed_and_a_number_may_be_a_whole_one() -> None:
    whole = Cell("whole", remember, dynamic=Memory())
    cells: list[Node] = [whole, Cell("b", number, links={"x": before("d")}), Cell("d", number, links={"x": "whole"})]
    wiring = wire(Network("root", cells))
    assert list(wiring.nodes) == ["root", "whole", "b", "d"]


def test_the_identity_of_a_wiring_changes_with_every_declared_fact() -> None:
    def identity(**declared: object) -> str:
        cells = [A, Cell("b", number, **{"links": {"x": "a"}, **declared})]  # type: ignore[arg-type]
        return wire(Network("root", cells)).identity()

    changed = [
        identity(),
        identity(links={}),
        identity(links={"x": PortSource("a", before=True)}),
        identity(excited_by=AtLeast("a", 1.0)),
        identity(excited_by=AtLeast("a", 1.5)),
        identity(constants=Memory(1)),
        identity(constants=Memory(2)),
        identity(every_ns=10),
    ]
    assert len(set(changed)) == len(changed)
    assert identity() == identity()
