"""Behaviour cells and networks: the five steps, networks, rates and triggers, faults."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import pytest

from waychair.control.behaviours.activations import bypass, gaussian, logic, sigmoid, weighted_sum
from waychair.control.behaviours.cell import Cell, Reading, Sensor, before
from waychair.control.behaviours.cell_network import Network, Node, wire
from waychair.control.behaviours.conditions import Active, AtLeast, Below
from waychair.control.behaviours.runtime import REST_NS, Innervation, Runtime
from waychair.errors import BehaviourError

S = 1_000_000_000


@dataclass(frozen=True)
class Count:
    runs: int = 0
    total: float = 0.0


def counted(x: float | None, dynamic: Count) -> tuple[int, Count]:
    new = Count(dynamic.runs + 1, dynamic.total + (x or 0.0))
    return new.runs, new


def one() -> float:
    return 1.0


def level(x: float) -> float:
    return x


SWITCH = Sensor("switch", float)


def switched(name: str, **declared: Any) -> Cell:
    """Return a cell that is excited while the switch is on."""
    return Cell(name, one, excited_by=AtLeast("switch", 1.0), **declared)


def run(cells: Sequence[Node], stamps: Mapping[int, Mapping[str, Any]], **options: Any) -> list[Innervation]:
    runtime = Runtime(wire(Network("root", cells), [SWITCH, Sensor("x", float)]), **options)
    return [runtime.innervate(stamp, heard) for stamp, heard in stamps.items()]


ON_OFF = {0: {"switch": 1.0}, 1: {"switch": 0.0}}


def test_a_cell_without_links_is_active_whenever_it_is_innervated() -> None:
    (done,) = run([Cell("a", one)], {0: {}})
    assert (done.ports["a"].ab, done.ports["a"].eo, done.ports["a"].eo_stamp_ns) == (True, 1.0, 0)


def test_a_cell_that_is_no_longer_excited_is_inactive_and_keeps_its_effect() -> None:
    _, done = run([switched("a")], ON_OFF)
    assert (done.ports["a"].ab, done.ports["a"].eo, done.ports["a"].eo_stamp_ns) == (False, 1.0, 0)


def test_the_printed_text_of_step_1_leaves_the_activation_as_it_was() -> None:
    _, done = run([switched("a")], ON_OFF, literal=True)
    assert done.ports["a"].ab
    assert done.ports["a"].eb is False


def test_an_inhibited_cell_is_inactive_and_writes_the_output_that_it_declares() -> None:
    cells = [
        Cell("plain", one, inhibited_by=AtLeast("switch", 1.0)),
        Cell("declared", one, inhibited_by=AtLeast("switch", 1.0), inhibited_output=-1.0),
    ]
    off, on = run(cells, {0: {"switch": 0.0}, 1: {"switch": 1.0}})
    assert (off.ports["plain"].ab, off.ports["plain"].eo) == (True, 1.0)
    assert (on.ports["plain"].ab, on.ports["plain"].eo, on.ports["plain"].eo_stamp_ns) == (False, 1.0, 0)
    assert (on.ports["declared"].ab, on.ports["declared"].eo) == (False, -1.0)


def test_a_cell_that_is_not_excited_does_not_look_at_its_inhibition() -> None:
    cell = Cell("a", one, excited_by=AtLeast("switch", 1.0), inhibited_by=Below("x", 9.0), inhibited_output=-1.0)
    (done,) = run([cell], {0: {"switch": 0.0, "x": 1.0}})
    assert (done.ports["a"].ib, done.ports["a"].eo) == (None, None)


def test_a_reset_clears_all_dynamic_data_or_those_that_are_named() -> None:
    links, reset = {"x": "x"}, AtLeast("switch", 1.0)
    cells = [
        Cell("all", counted, links=links, dynamic=Count(), reset_by=reset),
        Cell("named", counted, links=links, dynamic=Count(), reset_by=reset, cleared=("total",)),
    ]
    runs = run(cells, {0: {"switch": 0.0, "x": 1.0}, 1: {}, 2: {"switch": 1.0}})
    assert [done.ports["all"].eo for done in runs] == [1, 2, 1]
    assert [done.ports["named"].eo for done in runs] == [1, 2, 3]


def test_a_reset_that_comes_while_a_cell_is_not_excited_is_kept_until_it_is() -> None:
    cell = Cell("a", counted, dynamic=Count(), excited_by=AtLeast("x", 1.0), reset_by=AtLeast("switch", 1.0))
    stamps = {0: {"x": 1.0, "switch": 0.0}, 1: {}, 2: {"x": 0.0, "switch": 1.0}, 3: {"switch": 0.0}, 4: {"x": 1.0}}
    assert [done.ports["a"].eo for done in run([cell], stamps)] == [1, 2, 2, 2, 1]


def test_a_reset_by_a_cell_that_runs_later_is_taken_at_the_next_innervation_and_once() -> None:
    cells = [
        Cell("a", counted, dynamic=Count(), reset_by=Active("b", before=True)),
        switched("b"),
    ]
    stamps = {0: {"switch": 0.0}, 1: {"switch": 1.0}, 2: {"switch": 0.0}, 3: {}, 4: {}}
    assert [done.ports["a"].eo for done in run(cells, stamps)] == [1, 2, 1, 2, 3]


def test_a_reset_is_not_lost_while_the_network_of_a_cell_is_not_active() -> None:
    inner = Cell("a", counted, dynamic=Count(), reset_by=AtLeast("switch", 1.0))
    cells: list[Node] = [Network("n", [inner], excited_by=AtLeast("x", 1.0))]
    stamps = {0: {"x": 1.0, "switch": 0.0}, 1: {}, 2: {"x": 0.0, "switch": 1.0}, 3: {"switch": 0.0}, 4: {"x": 1.0}}
    assert [done.ports["a"].eo for done in run(cells, stamps)] == [1, 2, 2, 2, 1]


def test_a_network_hands_a_reset_on_to_its_cells() -> None:
    inner = [Cell("a", counted, dynamic=Count()), Cell("b", counted, dynamic=Count())]
    for cleared, expected in (((), (1, 1)), (("b",), (3, 1))):
        cells: list[Node] = [Network("n", inner, reset_by=AtLeast("switch", 1.0), cleared=cleared)]
        done = run(cells, {0: {"switch": 0.0}, 1: {}, 2: {"switch": 1.0}})[-1]
        assert (done.ports["a"].eo, done.ports["b"].eo) == expected


def test_an_action_is_written_after_the_effect_which_it_may_use() -> None:
    def act(x: float, effect: float) -> float:
        return x + effect

    cell = Cell("a", level, {"wheel": act}, links={"x": "x"})
    done, quiet = run([cell], {0: {"x": 2.0}, 1: {"x": None}})
    assert (done.ports["a"].eo, done.actions) == (2.0, {"wheel": 4.0})
    assert quiet.actions == {}


def test_a_cell_without_a_value_that_it_needs_has_no_effect() -> None:
    cells = [Cell("a", level, links={"x": "x"}), Cell("unlinked", level)]
    never, done = run(cells, {0: {}, 1: {"x": 1.0}})
    assert (never.ports["a"].ab, never.ports["a"].eo) == (True, None)
    assert done.ports["a"].eo == 1.0
    assert done.ports["unlinked"].eo is None


def test_a_value_older_than_its_port_allows_counts_as_missing() -> None:
    cell = Cell("a", level, links={"x": "x"}, fresh_ns={"x": S})
    runs = run([cell], {0: {"x": 1.0}, S: {}, S + 1: {}, S + 2: {"x": Reading(7.0, 5 * S)}})
    assert [done.ports["a"].eo for done in runs] == [1.0, 1.0, None, None]


def test_a_port_can_ask_for_the_stamp_of_its_value() -> None:
    def stamped(x: Reading[float], now_ns: int) -> int:
        return now_ns - x.stamp_ns

    _, done = run([Cell("a", stamped, links={"x": "x"})], {3: {"x": 1.0}, 10: {}})
    assert done.ports["a"].eo == 7


def test_a_network_is_a_cell_to_the_outside() -> None:
    inner = Network("n", [Cell("a", level, links={"x": "x"}), Cell("b", one)], output="a", excited_by=Below("x", 5.0))
    reader = Cell("reader", level, links={"x": "n"}, excited_by=Active("n"))
    inside, outside = run([inner, reader], {0: {"x": 2.0}, 1: {"x": 6.0}})
    assert (inside.ports["n"].ab, inside.ports["n"].eo, inside.ports["reader"].eo) == (True, 2.0, 2.0)
    assert (outside.ports["n"].ab, outside.ports["n"].eo, outside.ports["reader"].ab) == (False, 2.0, False)


def test_the_cells_of_a_network_that_is_not_active_are_not_active() -> None:
    deep: Node = Cell("deep", one)
    for k in range(3):
        deep = Network(f"n{k}", [deep])
    outer = Network("outer", [deep], excited_by=AtLeast("switch", 1.0))
    on, off = run([outer], ON_OFF)
    assert all(on.ports[name].ab for name in ("outer", "n2", "n1", "n0", "deep"))
    assert not any(off.ports[name].ab for name in ("outer", "n2", "n1", "n0", "deep"))
    assert off.ran == ("root", "outer")


def test_an_inhibited_network_hands_its_inhibition_on() -> None:
    finder = Cell("finder", one, inhibited_output=-1.0)
    outer = Network("outer", [Network("n", [finder], output="finder")], inhibited_by=AtLeast("switch", 1.0), output="n")
    free, inhibited = run([outer], {0: {"switch": 0.0}, 1: {"switch": 1.0}})
    assert (free.ports["outer"].eo, inhibited.ports["outer"].eo) == (1.0, -1.0)
    assert not inhibited.ports["finder"].ab


def test_a_cell_in_two_networks_runs_once_a_stamp_and_is_active_while_one_holds_it() -> None:
    shared = Cell("shared", counted, dynamic=Count())
    first = Network("first", [shared], excited_by=AtLeast("switch", 1.0))
    second = Network("second", [shared], excited_by=AtLeast("x", 1.0))
    stamps = {0: {"switch": 1.0, "x": 1.0}, 1: {"switch": 0.0}, 2: {"x": 0.0}, 3: {"switch": 1.0}}
    runs = run([first, second], stamps)
    assert [done.ports["shared"].eo for done in runs] == [1, 2, 2, 3]
    assert [done.ports["shared"].ab for done in runs] == [True, True, False, True]
    assert runs[0].ran.count("shared") == 1


def test_networks_nest_without_limit() -> None:
    node: Node = Cell("leaf", one)
    for k in range(3000):
        node = Network(f"n{k}", [node], output=node.name)
    (done,) = run([node], {0: {}})
    assert done.ports["n2999"].eo == 1.0


def test_a_cell_with_a_period_runs_once_in_each_of_its_periods() -> None:
    cell = Cell("slow", counted, dynamic=Count(), every_ns=100)
    runs = run([cell], {stamp: {} for stamp in (30, 60, 99, 100, 199, 350, 360)})
    assert [done.ports["slow"].eo for done in runs] == [1, 1, 1, 2, 2, 3, 3]
    assert not runs[1].ports["slow"].innervated


def test_a_cell_with_triggers_runs_after_one_of_them_has_written() -> None:
    cells = [switched("a"), Cell("reader", counted, dynamic=Count(), triggers=("a", "x"))]
    stamps: dict[int, dict[str, float]] = {0: {}, 1: {"switch": 1.0}, 2: {"switch": 0.0}, 3: {"x": 1.0}, 4: {}}
    assert [done.ports["reader"].eo for done in run(cells, stamps)] == [None, 1, 1, 2, 2]


def test_a_link_with_before_closes_a_loop() -> None:
    def more(x: float | None) -> float:
        return (x or 0.0) + 1.0

    cells = [Cell("a", more, links={"x": before("b")}), Cell("b", level, links={"x": "a"})]
    assert [done.ports["b"].eo for done in run(cells, {k: {} for k in range(3)})] == [1.0, 2.0, 3.0]


def test_a_second_innervation_at_a_stamp_finds_the_outputs_of_that_stamp() -> None:
    runtime = Runtime(wire(Network("root", [Cell("a", counted, dynamic=Count())])))
    assert runtime.innervate(5) == runtime.innervate(5)
    assert runtime.innervate(6).ports["a"].eo == 2


def test_a_stamp_that_goes_back_and_an_unknown_sensor_are_refused() -> None:
    runtime = Runtime(wire(Network("root", [Cell("a", one)])))
    runtime.innervate(5)
    with pytest.raises(BehaviourError, match="4 ns comes after one at 5 ns"):
        runtime.innervate(4)
    with pytest.raises(BehaviourError, match="no sensor sonar"):
        runtime.innervate(6, {"sonar": 1.0})


def broken(x: float, dynamic: Count) -> tuple[float, Count]:
    if x > 1.0:
        raise ValueError("the packet is cut short")
    return x, Count(dynamic.runs + 1)


def test_a_cell_that_raises_is_inactive_and_named_while_the_others_go_on() -> None:
    cells = [Cell("a", broken, links={"x": "x"}, dynamic=Count()), Cell("b", one)]
    runs = run(cells, {0: {"x": 1.0}, 1: {"x": 2.0}, 2: {"x": 1.0}})
    assert [done.ports["a"].eo for done in runs] == [1.0, None, 1.0]
    assert [done.ports["a"].ab for done in runs] == [True, False, True]
    assert [done.faults() for done in runs] == [{}, {"a": "ValueError: the packet is cut short"}, {}]
    assert all(done.ports["b"].ab for done in runs)


def test_a_cell_with_three_faults_in_a_row_rests_for_a_second_and_comes_back() -> None:
    cell = Cell("a", broken, links={"x": "x"}, dynamic=Count())
    stamps: dict[int, dict[str, float]] = {0: {"x": 2.0}, 1: {}, 2: {}, 3: {"x": 1.0}, REST_NS + 1: {}, REST_NS + 2: {}}
    runs = run([cell], stamps)
    assert [done.ports["a"].ab for done in runs] == [False] * 5 + [True]
    assert runs[4].faults()
    assert not runs[5].faults()


def test_a_value_of_another_type_than_declared_is_a_fault() -> None:
    def liar() -> float:
        return "free"  # type: ignore[return-value]

    (done,) = run([Cell("a", liar)], {0: {}})
    assert "gave a str" in done.faults()["a"]
    assert done.ports["a"].eo is None


def test_a_cell_that_takes_too_long_is_inactive_and_a_replay_needs_no_clock_for_it() -> None:
    times = iter([0, 1, 10, 1000])  # ns at the begin and the end of each cell
    cells = [Cell("quick", one), Cell("slow", one)]
    (done,) = run(cells, {0: {}}, timer=lambda: next(times), limit_ns=100)
    assert (done.late, done.faults()) == (("slow",), {"slow": "took too long"})
    again = Runtime(wire(Network("root", cells))).innervate(0, late=done.late)
    assert again == done


ACTIVATIONS: list[tuple[Any, dict[str, Any], Any]] = [
    (bypass(float), {"value": 3.0}, 3.0),
    (weighted_sum({"x": 2.0, "y": -1.0}, 0.5), {"x": 1.0, "y": 4.0}, -1.5),
    (sigmoid({"x": 1.0}), {"x": 0.0}, 0.5),
    (sigmoid({"x": 1.0}, slope=2.0), {"x": -1e9}, 0.0),
    (gaussian("x", 1.0, 2.0), {"x": 3.0}, 0.6065306597126334),
    (gaussian("x", 0.0, 1e-3), {"x": 1e9}, 0.0),
    (logic(("p", "q"), lambda p, q: p and not q), {"p": True, "q": None}, True),
]


@pytest.mark.parametrize(("behaviour", "values", "expected"), ACTIVATIONS)
def test_an_activation_function_has_its_closed_form(behaviour: Any, values: dict[str, Any], expected: Any) -> None:
    call: Callable[..., Any] = behaviour.call
    assert call(**values) == pytest.approx(expected, abs=1e-12)
