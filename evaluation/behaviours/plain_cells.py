"""A plain interpreter of behaviour networks that follows the paper's text line by line, as a reference.

It is written from the text (2.1.1 and 2.1.2) and from our readings of its unclear points, recursive and slow, and shares
no code with `control/behaviours/runtime.py` but the declarations. Ports are dictionaries by name.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from waychair.control.behaviours.cell import UNSET, Cell, Reading, Sensor, behaviour_from
from waychair.control.behaviours.cell_network import Network
from waychair.control.behaviours.conditions import Condition, PortSource

FAULTS_IN_A_ROW, REST_NS = 3, 1_000_000_000


@dataclass
class _Stamp:
    """The ports of one innervation, and AB, EO and its stamps before it."""

    now: int
    order: list[str] = field(default_factory=list)
    EB: dict[str, bool] = field(default_factory=dict)
    IB: dict[str, bool] = field(default_factory=dict)
    RS: dict[str, bool] = field(default_factory=dict)
    AO: dict[str, Any] = field(default_factory=dict)
    old: tuple[dict[str, bool], dict[str, Any], dict[str, int | None]] = field(default_factory=lambda: ({}, {}, {}))


@dataclass
class _Trouble:
    """The faults of one cell."""

    in_a_row: int = 0
    fault: str = ""
    rests_until: int = -1


class PlainCells:
    """A network, its ports and its memories, interpreted."""

    def __init__(self, root: Network, sensors: tuple[Sensor, ...], literal: bool = False) -> None:
        self.root, self.literal, self.at = root, literal, _Stamp(-1)
        self.all: dict[str, Cell | Network] = {}
        self._find(root)
        self.sensors = {sensor.name for sensor in sensors}
        self.AB = dict.fromkeys(self.all, False)
        self.EO: dict[str, Any] = dict.fromkeys([*self.all, *self.sensors])
        self.written: dict[str, int | None] = dict.fromkeys(self.EO)
        self.writes = dict.fromkeys(self.EO, 0)
        self.memory = {name: cell.dynamic for name, cell in self.all.items() if isinstance(cell, Cell)}
        self.reset_waits = dict.fromkeys(self.all, False)
        self.last_period: dict[str, int] = {}
        self.seen_writes: dict[str, list[int]] = {}
        self.trouble = {name: _Trouble() for name in self.all}

    def _find(self, node: Cell | Network) -> None:
        self.all[node.name] = node
        if isinstance(node, Network):
            for member in node.cells:
                self._find(member)

    def innervate(self, now: int, heard: Mapping[str, Any]) -> None:
        """Send an innervation signal into the network."""
        self.at = _Stamp(now, old=(dict(self.AB), dict(self.EO), dict(self.written)))
        for name, value in heard.items():
            own = isinstance(value, Reading)
            self._write(name, value.value if own else value, value.stamp_ns if own else now)
        self._signal(self.root)
        for name, node in self.all.items():  # a reset that nobody has looked at yet, or that came later, waits
            if not self.at.RS.get(name, False) and self._value(node.reset_by):
                self.reset_waits[name] = True

    def _signal(self, node: Cell | Network) -> None:
        """IS of a cell or network receives a signal."""
        if node.name in self.at.order or not self._is_its_turn(node):
            return
        self.at.order.append(node.name)
        self.at.RS[node.name] = self._value(node.reset_by)
        if self.at.RS[node.name]:
            self.reset_waits[node.name] = True
        if isinstance(node, Network):
            self._network(node)
        else:
            self._cell(node)

    def _is_its_turn(self, node: Cell | Network) -> bool:
        if node.every_ns > 0:
            period = self.at.now // node.every_ns
            before = self.last_period.get(node.name)
            self.last_period[node.name] = period
            return before is None or period != before
        if node.triggers:
            writes = [self.writes[self.shown(name)] for name in node.triggers]
            before_writes = self.seen_writes.get(node.name, [0] * len(writes))
            self.seen_writes[node.name] = writes
            return writes != before_writes
        return True

    def _cell(self, cell: Cell) -> None:
        name = cell.name
        # 1) Check the value of the Excitatory Inputs. If true, set AB to 1 and go to the next step, otherwise return.
        self.at.EB[name] = self._value(cell.excited_by)
        if self.at.EB[name]:
            self.AB[name] = True
        else:
            if not self.literal:
                self.AB[name] = False
            return
        # 2) Check the value of the Inhibitory Inputs. If false, go to the next step, otherwise set AB to 0 and return.
        self.at.IB[name] = self._value(cell.inhibited_by)
        if self.at.IB[name]:
            self.AB[name] = False
            if cell.inhibited_output is not UNSET:
                self._write(name, cell.inhibited_output, self.at.now)
            return
        # 3) Check the value of the Reset input, and if true, clear the dynamic data.
        if self.reset_waits[name]:
            self.reset_waits[name] = False
            if cell.dynamic is not None:
                if cell.cleared:
                    kept = {
                        each: getattr(cell.dynamic if each in cell.cleared else self.memory[name], each)
                        for each in type(cell.dynamic).__dataclass_fields__
                    }
                    self.memory[name] = type(cell.dynamic)(**kept)
                else:
                    self.memory[name] = cell.dynamic
        if self.at.now < self.trouble[name].rests_until:
            self.AB[name] = False
            return
        # 4) and 5) Derive the values from the behavioural function, write them to EO and AO, store the data.
        memory, effect, actions = self.memory[name], None, {}
        try:
            if cell.effect is not None:
                effect, memory = self._function(cell, cell.effect, memory, None)
            for effector, function in cell.actions.items():
                action, memory = self._function(cell, function, memory, effect)
                if action is not None:
                    actions[effector] = action
        except (ArithmeticError, ValueError) as error:
            self.AB[name] = False
            self.trouble[name].fault = f"{type(error).__name__}: {error}"
            self.trouble[name].in_a_row += 1
            if self.trouble[name].in_a_row >= FAULTS_IN_A_ROW:
                self.trouble[name].rests_until = self.at.now + REST_NS
            self._write(name, None, self.at.now)
            return
        self.trouble[name].in_a_row, self.trouble[name].fault, self.memory[name] = 0, "", memory
        if cell.effect is not None:
            self._write(name, effect, self.at.now)
        self.at.AO.update(actions)

    def _function(self, cell: Cell, function: Any, memory: Any, effect: Any) -> tuple[Any, Any]:
        behaviour = behaviour_from(function)
        values: dict[str, Any] = {}
        for port, declared in behaviour.ports.items():
            values[port] = self._data(cell, port, declared.with_stamp)
            if values[port] is None and declared.needed:
                return None, memory
        if "effect" in behaviour.passes and effect is None:
            return None, memory
        special = {"dynamic": memory, "effect": effect, "now_ns": self.at.now}
        special |= {"static": cell.static, "constants": cell.constants}
        result = behaviour.call(**values, **{each: special[each] for each in behaviour.passes})
        return result if behaviour.keeps else (result, memory)

    def _data(self, cell: Cell, port: str, with_stamp: bool) -> Any:
        """Port DI: the latest value of the link, if it is young enough."""
        link = cell.links.get(port)
        if link is None:
            return None
        source = PortSource(link) if isinstance(link, str) else link
        name = self.shown(source.name)
        effects, stamps = (self.at.old[1], self.at.old[2]) if source.before else (self.EO, self.written)
        value, stamp = effects[name], stamps[name]
        if value is None or stamp is None:
            return None
        if port in cell.fresh_ns and (stamp > self.at.now or self.at.now - stamp > cell.fresh_ns[port]):
            return None
        active = (self.at.old[0] if source.before else self.AB).get(name, False)
        return Reading(value, stamp, active) if with_stamp else value

    def _network(self, network: Network) -> None:
        # The innervation cell signals the Excitatory Inputs cell, the Inhibitory Inputs cell and the Activation
        # Output cell in this order.
        name = network.name
        excitation = self.at.EB[name] = self._value(network.excited_by)
        inhibition = False
        if excitation:
            inhibition = self.at.IB[name] = self._value(network.inhibited_by)
        if excitation or not self.literal:
            self.AB[name] = excitation and not inhibition
        # If the value is true, the Activation Output cell innervates the functional cells in a predefined order,
        # otherwise the whole process returns; thus the network is deactivated.
        if excitation and not inhibition:
            if self.reset_waits[name]:
                self.reset_waits[name] = False
                for member in network.cells:
                    if not network.cleared or member.name in network.cleared:
                        self.reset_waits[member.name] = True
            for member in network.cells:
                self._signal(member)
        elif inhibition or not self.literal:
            self._take_down(network, inhibition)

    def _take_down(self, network: Network, inhibition: bool) -> None:
        """No cell of an inactive network is active, unless another active network holds it."""
        for member in network.cells:
            holders = [each for each in self.all.values() if isinstance(each, Network) and member in each.cells]
            if any(self.AB[holder.name] for holder in holders):
                continue
            self.AB[member.name] = False
            if isinstance(member, Network):
                self._take_down(member, inhibition)
            elif inhibition and member.inhibited_output is not UNSET:
                self._write(member.name, member.inhibited_output, self.at.now)

    def _write(self, name: str, value: Any, stamp: int) -> None:
        self.EO[name], self.written[name] = value, stamp
        self.writes[name] += 1

    def shown(self, name: str) -> str:
        """The cell whose EO a name shows."""
        node = self.all.get(name)
        return self.shown(node.output) if isinstance(node, Network) and node.output else name

    def _value(self, condition: Condition) -> bool:
        return condition.holds(self)

    def activation(self, name: str, before: bool) -> bool:
        """AB, for the conditions."""
        return (self.at.old[0] if before else self.AB)[name]

    def effect(self, name: str, before: bool) -> Any:
        """EO, for the conditions."""
        return (self.at.old[1] if before else self.EO)[self.shown(name)]
