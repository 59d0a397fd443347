"""The runtime of a behaviour network: which cells run at a stamp, the five steps of each, and the ports after it.

The schedule is a pure function of the stamps and the declared order. There is no clock, thread or random number inside:
the same stamps and sensor values give the same ports. Time that a cell takes is measured by a `timer` of the caller, and
its verdict is part of the innervation (`late`), so that a replay needs no clock.

A cell that raises, gives a value of another type, or takes too long becomes inactive: AB = 0, EO has no value, its
dynamic data stay, and the fault is named. After three faults in a row it rests for a second. The other cells go on.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

from waychair.control.behaviours.cell import (
    UNSET,
    Behaviour,
    Cell,
    Reading,
    checked_classes,
    port_source,
)
from waychair.control.behaviours.cell_network import Network, Wiring
from waychair.control.behaviours.conditions import NEVER, Condition, Test, test_from
from waychair.errors import BehaviourError

FAULTS = 3
"""Faults in a row after which a cell rests: a single one may be a packet cut short."""

REST_NS = 1_000_000_000
"""Time for which a cell rests after a fault: long enough to be heard of, short enough to come back by itself."""

LIMIT_NS = 20_000_000
"""Time after which a run of a cell is too long: the part of a control tick of 50 ms that perception may take."""

NOTHING: Mapping[str, Any] = MappingProxyType({})


@dataclass(frozen=True, slots=True)
class PortState:
    """The ports of one cell or network after an innervation.

    `innervated`: IS fired at this stamp. EB, IB and RS are as checked then, None where no step checked them. EO is the
    latest value and its stamp. `fault`: why the cell is inactive; empty otherwise.
    """

    innervated: bool
    eb: bool | None
    ib: bool | None
    rs: bool | None
    ab: bool
    eo: Any
    eo_stamp_ns: int | None
    fault: str = ""


@dataclass(frozen=True, slots=True)
class Innervation:
    """The outcome of one stamp: the nodes in the order in which they ran, all ports, and the AO written.

    `late` are the cells that took too long.
    """

    stamp_ns: int
    ran: tuple[str, ...]
    ports: Mapping[str, PortState]
    actions: Mapping[str, Any]
    late: tuple[str, ...] = ()

    def faults(self) -> dict[str, str]:
        """Return the faults by cell."""
        return {name: port.fault for name, port in self.ports.items() if port.fault}


@dataclass(slots=True)
class _Node:
    """The state of one cell, network or sensor between stamps. `before_...` are the ports before this innervation."""

    ab: bool = False
    eo: Any = None
    eo_stamp_ns: int | None = None
    writes: int = 0
    before_ab: bool = False
    before_eo: Any = None
    before_stamp_ns: int | None = None
    due_ns: int | None = None
    reset_kept: bool = False
    rests_until_ns: int | None = None
    faults: int = 0
    fault: str = ""

    def write(self, value: Any, stamp_ns: int) -> None:
        """Write EO."""
        self.eo, self.eo_stamp_ns = value, stamp_ns
        self.writes += 1


@dataclass(slots=True)
class _Seen:
    """The state of one cell's inputs: its dynamic data, the writes of its triggers that it has seen, EB, IB and RS."""

    dynamic: Any = None
    triggers: list[int] = field(default_factory=list)
    eb: bool | None = None
    ib: bool | None = None
    rs: bool | None = None
    took_reset: bool = False


@dataclass(frozen=True, slots=True)
class _Input:
    """A DI port as it is read: its source, and the limits on its value."""

    port: str
    source: _Node
    before: bool
    needed: bool
    with_stamp: bool
    fresh_ns: int | None


@dataclass(frozen=True, slots=True)
class _Function:
    """A behavioural function with its inputs; `unlinked`: a DI port that needs a value has no source."""

    behaviour: Behaviour
    inputs: tuple[_Input, ...]
    optional: tuple[str, ...]
    unlinked: bool
    classes: tuple[type, ...] | None


@dataclass(frozen=True, slots=True)
class _Program:
    """A cell or network ready to run."""

    name: str
    node: Cell | Network
    state: _Node
    seen: _Seen
    excited: Test
    inhibited: Test
    reset: Test
    triggers: tuple[_Node, ...]
    members: tuple[str, ...]
    parents: tuple[_Node, ...]
    functions: tuple[_Function, ...]
    can_reset: bool


class Runtime:
    """A network that runs. `innervate` is the only thing that happens to it."""

    def __init__(
        self,
        wiring: Wiring,
        *,
        timer: Callable[[], int] | None = None,
        limit_ns: int = LIMIT_NS,
        literal: bool = False,
    ) -> None:
        """`timer` reads a clock [ns] for cells that take too long; None: no cell is too long by itself.

        `literal` keeps the printed text of step 1: EB false leaves AB, and that of a network's cells, as it was.
        """
        self.wiring = wiring
        self._timer, self._limit_ns, self._literal = timer, limit_ns, literal
        self._stamp_ns: int | None = None
        self._sensors = {name: _Node() for name in wiring.sensors}
        self._states = {name: _Node() for name in wiring.nodes}
        self._programs = {name: self._program(name) for name in wiring.nodes}
        self._actions: dict[str, Any] = {}
        self._late: list[str] = []
        self._named_late: Collection[str] = ()
        self._ran: list[str] = []

    def innervate(self, stamp_ns: int, heard: Mapping[str, Any] = NOTHING, late: Collection[str] = ()) -> Innervation:
        """Let the innervation signal go through the network at a stamp, and return the ports after it.

        `heard` are the new values of sensors: plain ones have the stamp of the innervation, a `Reading` has its own.
        `late` names cells that count as too long, as an earlier run found them. A second innervation at a stamp finds
        the outputs of that stamp.

        Raises:
            BehaviourError: the stamp lies before the last one, or a sensor is unknown. Nothing has happened then.
        """
        last_ns = self._stamp_ns
        if last_ns is not None and stamp_ns < last_ns:
            raise BehaviourError(
                f"an innervation at {stamp_ns} ns comes after one at {last_ns} ns: the clock was set back, begin anew"
            )
        if unknown := [name for name in heard if name not in self._sensors]:
            raise BehaviourError(f"there is no sensor {unknown[0]}: the network has {', '.join(self._sensors)}")
        if stamp_ns != last_ns:
            self._begin(stamp_ns, heard, late)
            self._run()
            self._keep_resets()
        return Innervation(stamp_ns, tuple(self._ran), self._ports(), dict(self._actions), tuple(self._late))

    def _begin(self, stamp_ns: int, heard: Mapping[str, Any], late: Collection[str]) -> None:
        self._stamp_ns, self._ran, self._late, self._named_late = stamp_ns, [], [], late
        self._actions = {}
        for state in (*self._states.values(), *self._sensors.values()):
            state.before_ab, state.before_eo, state.before_stamp_ns = state.ab, state.eo, state.eo_stamp_ns
        for program in self._programs.values():
            seen = program.seen
            seen.eb = seen.ib = seen.rs = None
            seen.took_reset = False
        for name, value in heard.items():
            own = isinstance(value, Reading)
            self._sensors[name].write(value.value if own else value, value.stamp_ns if own else stamp_ns)

    def _run(self) -> None:
        """Run the due cells in their declared order; a node that has run at this stamp keeps its outputs."""
        ran: set[str] = set()
        stack: list[Iterator[str]] = [iter((self.wiring.root.name,))]
        while stack:
            name = next(stack[-1], None)
            if name is None:
                stack.pop()
            elif name not in ran and self._is_due(program := self._programs[name]):
                ran.add(name)
                self._ran.append(name)
                if not self._gates(program):
                    continue
                if program.members:
                    stack.append(iter(program.members))
                else:
                    self._compute(program)

    def _is_due(self, program: _Program) -> bool:
        """Return whether IS fires: at every innervation, once in each period, or after a trigger has written."""
        node, state, now_ns = program.node, program.state, self._now_ns
        if node.every_ns:
            due = state.due_ns is None or now_ns // node.every_ns != state.due_ns // node.every_ns
            state.due_ns = now_ns if due else state.due_ns
            return due
        if program.triggers:
            writes = [trigger.writes for trigger in program.triggers]
            due = writes != program.seen.triggers
            program.seen.triggers = writes
            return due
        return True

    @property
    def _now_ns(self) -> int:
        assert self._stamp_ns is not None  # only read while an innervation runs
        return self._stamp_ns

    def _gates(self, program: _Program) -> bool:
        """Run steps 1 to 3 of a cell, or the four inner cells of a network; return whether it goes on."""
        state, seen = program.state, program.seen
        if program.can_reset:
            seen.rs = program.reset()
            state.reset_kept |= seen.rs
            seen.took_reset = seen.rs
        seen.eb = program.excited()
        if not seen.eb:
            if not self._literal:
                self._deactivate(program, inhibits=False)
            return False
        state.ab = True
        seen.ib = program.inhibited()
        if seen.ib:
            self._deactivate(program, inhibits=True)
            return False
        if state.reset_kept:
            self._clear(program)
        return True

    def _clear(self, program: _Program) -> None:
        """Clear a cell's dynamic data, or hand a reset on to a network's cells, which keep it until they can."""
        program.state.reset_kept = False
        node = program.node
        if isinstance(node, Network):
            for member in node.cleared or program.members:
                self._programs[member].state.reset_kept = True
        elif node.dynamic is not None:
            program.seen.dynamic = node.reset_data(program.seen.dynamic)

    def _deactivate(self, program: _Program, inhibits: bool) -> None:
        """Set AB to 0, also of the cells that no other active network holds; an inhibition writes their outputs."""
        stack = [program]
        program.state.ab = False
        while stack:
            each = stack.pop()
            node = each.node
            if isinstance(node, Cell):
                if inhibits and node.inhibited_output is not UNSET:
                    each.state.write(node.inhibited_output, self._now_ns)
                continue
            if self._literal and not inhibits:
                continue
            for member in reversed(each.members):
                below = self._programs[member]
                if not any(parent.ab for parent in below.parents):
                    below.state.ab = False
                    stack.append(below)

    def _compute(self, program: _Program) -> None:
        """Run steps 4 and 5 of a cell."""
        state, cell, now_ns = program.state, program.node, self._now_ns
        assert isinstance(cell, Cell)
        if state.rests_until_ns is not None:
            if now_ns < state.rests_until_ns:
                state.ab = False
                return
            state.rests_until_ns = None
        begun = self._timer() if self._timer is not None else 0
        try:
            dynamic, effect, actions = self._outputs(program, cell)
        except Exception as error:  # noqa: BLE001 - a cell's own fault must not end the others
            self._fail(state, f"{type(error).__name__}: {error}")
            return
        overran = self._timer is not None and self._timer() - begun > self._limit_ns
        if overran or program.name in self._named_late:
            self._late.append(program.name)
            self._fail(state, "took too long")
            return
        program.seen.dynamic = dynamic
        state.faults, state.fault = 0, ""
        if cell.effect is not None:
            state.write(effect, now_ns)
        self._actions.update(actions)

    def _outputs(self, program: _Program, cell: Cell) -> tuple[Any, Any, dict[str, Any]]:
        """Return the new dynamic data, EO and AO of a cell, none of which is written yet."""
        dynamic, effect, functions = program.seen.dynamic, None, program.functions
        first = 0 if cell.effect is None else 1
        if first:
            effect, dynamic = self._value(functions[0], cell, dynamic, None)
        actions: dict[str, Any] = {}
        for effector, function in zip(cell.actions, functions[first:], strict=True):
            value, dynamic = self._value(function, cell, dynamic, effect)
            if value is not None:
                actions[effector] = value
        return dynamic, effect, actions

    def _value(self, function: _Function, cell: Cell, dynamic: Any, effect: Any) -> tuple[Any, Any]:
        """Return the output of a function and the dynamic data after it; None where a needed value is missing."""
        if function.unlinked or (effect is None and "effect" in function.behaviour.passes):
            return None, dynamic
        arguments: dict[str, Any] = dict.fromkeys(function.optional)
        for given in function.inputs:
            reading = self._reading(given)
            if reading is None and given.needed:
                return None, dynamic
            arguments[given.port] = reading
        for name in function.behaviour.passes:
            if name == "now_ns":
                arguments[name] = self._now_ns
            elif name == "effect":
                arguments[name] = effect
            else:
                arguments[name] = dynamic if name == "dynamic" else getattr(cell, name)
        value = function.behaviour.call(**arguments)
        if function.behaviour.keeps:
            value, dynamic = value
        if value is not None and function.classes is not None and not isinstance(value, function.classes):
            raise TypeError(f"the function of {cell.name} gave a {type(value).__name__}")
        return value, dynamic

    def _reading(self, given: _Input) -> Any:
        """Return the value of a DI port, or its `Reading`; None where there is none, or none that is fresh."""
        source = given.source
        value, stamp_ns, active = source.eo, source.eo_stamp_ns, source.ab
        if given.before:
            value, stamp_ns, active = source.before_eo, source.before_stamp_ns, source.before_ab
        if value is None or stamp_ns is None:
            return None
        if given.fresh_ns is not None and not 0 <= self._now_ns - stamp_ns <= given.fresh_ns:
            return None
        return Reading(value, stamp_ns, active) if given.with_stamp else value

    def _fail(self, state: _Node, fault: str) -> None:
        state.ab, state.fault, state.faults = False, fault, state.faults + 1
        if state.faults >= FAULTS:
            state.rests_until_ns = self._now_ns + REST_NS
        state.write(None, self._now_ns)

    def _keep_resets(self) -> None:
        """Keep the resets that came after their cell's turn, or while it was not innervated."""
        for program in self._programs.values():
            if program.can_reset and not program.seen.took_reset and program.reset():
                program.state.reset_kept = True

    def _ports(self) -> dict[str, PortState]:
        ran, ports = set(self._ran), {}
        for name, program in self._programs.items():
            state, seen, shown = program.state, program.seen, self.wiring.outputs[name]
            output = state if shown is None else self._states[shown]
            ports[name] = PortState(
                name in ran, seen.eb, seen.ib, seen.rs, state.ab, output.eo, output.eo_stamp_ns, state.fault
            )
        return ports

    def _program(self, name: str) -> _Program:
        wiring, node = self.wiring, self.wiring.nodes[name]
        state = self._states[name]
        return _Program(
            name=name,
            node=node,
            state=state,
            seen=_Seen(None if isinstance(node, Network) else node.dynamic, [0] * len(node.triggers)),
            excited=self._test(node.excited_by),
            inhibited=self._test(node.inhibited_by),
            reset=self._test(node.reset_by),
            triggers=tuple(self._source(each) for each in node.triggers),
            members=tuple(each.name for each in node.cells) if isinstance(node, Network) else (),
            parents=tuple(self._states[each] for each in wiring.parents[name]),
            functions=tuple(self._function(node, each) for each in wiring.functions[name])
            if isinstance(node, Cell)
            else (),
            can_reset=node.reset_by is not NEVER,
        )

    def _function(self, cell: Cell, behaviour: Behaviour) -> _Function:
        inputs, optional, unlinked = [], [], False
        for port, declared in behaviour.ports.items():
            if port not in cell.links:
                optional.append(port)
                unlinked |= declared.needed
                continue
            source = port_source(cell.links[port])
            inputs.append(
                _Input(
                    port=port,
                    source=self._source(source.name),
                    before=source.before,
                    needed=declared.needed,
                    with_stamp=declared.with_stamp,
                    fresh_ns=cell.fresh_ns.get(port),
                )
            )
        return _Function(behaviour, tuple(inputs), tuple(optional), unlinked, checked_classes(behaviour.gives))

    def _source(self, name: str) -> _Node:
        """Return the state whose EO a name shows."""
        if name in self._sensors:
            return self._sensors[name]
        return self._states[self.wiring.outputs[name] or name]

    def _test(self, condition: Condition) -> Test:
        def activation(name: str, before: bool) -> Test:
            state = self._states[name]
            return (lambda: state.before_ab) if before else (lambda: state.ab)

        def effect(name: str, before: bool) -> Callable[[], Any]:
            state = self._source(name)
            return (lambda: state.before_eo) if before else (lambda: state.eo)

        return test_from(condition, activation, effect)
