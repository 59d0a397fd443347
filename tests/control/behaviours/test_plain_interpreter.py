"""The runtime beside a plain interpreter that follows the paper's text, on random networks; the offers beside the truth."""

from __future__ import annotations

import pytest
from evaluation.behaviours.cluttered_places import offered, random_place, truly_free
from evaluation.behaviours.compared_cells import LITERAL_EVERY, differing_ports
from evaluation.behaviours.random_networks import MOST_CELLS, SENSORS, random_network

from waychair.calibration.chair_body import CHAIR_A, CHAIR_B, ChairBody
from waychair.control.behaviours.cell import Cell
from waychair.control.behaviours.cell_network import Network, wire


@pytest.mark.parametrize("seed", range(3 * LITERAL_EVERY))
def test_no_port_differs_from_the_plain_interpreter(seed: int) -> None:
    compared, differing, named = differing_ports(seed, 20)
    assert (differing, named) == (0, [])
    assert compared > 100


@pytest.mark.nightly
@pytest.mark.parametrize("first", range(10_000, 10_400, 40))
def test_no_port_of_many_networks_differs_from_the_plain_interpreter(first: int) -> None:
    assert sum(differing_ports(seed, 60)[1] for seed in range(first, first + 40)) == 0


def test_random_networks_have_all_that_the_runtime_can_do() -> None:
    wirings = [wire(random_network(seed), SENSORS) for seed in range(60)]
    nodes = [node for wiring in wirings for node in wiring.nodes.values()]
    assert max(sum(isinstance(node, Cell) for node in wiring.nodes.values()) for wiring in wirings) <= MOST_CELLS
    assert any(len(parents) > 1 for wiring in wirings for parents in wiring.parents.values())
    assert any(isinstance(node, Network) and any(isinstance(each, Network) for each in node.cells) for node in nodes)
    assert any(node.every_ns for node in nodes)
    assert any(node.triggers for node in nodes)
    assert any(isinstance(node, Cell) and node.actions for node in nodes)
    assert any(isinstance(node, Cell) and node.fresh_ns for node in nodes)


@pytest.mark.parametrize(("seed", "body"), [(3, CHAIR_A), (4, CHAIR_B)])
def test_no_orientation_is_offered_that_would_touch_and_most_free_ones_are(seed: int, body: ChairBody) -> None:
    place = random_place(seed, body)
    free, told = truly_free(place, body), offered(place, body, seed, ("lidar",))
    assert not (told & ~free).any()
    assert (told & free).sum() >= 0.75 * free.sum()
