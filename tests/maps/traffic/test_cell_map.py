"""Floor plans as maps of 1 m cells."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from waychair.maps.grid.moving_ai import load_free_cells
from waychair.maps.traffic.cell_map import free_cells, moving_ai_text, room_cells
from waychair.maps.traffic.corridors import floor_plan_names, load_corridors


@pytest.mark.parametrize("name", floor_plan_names())
def test_the_cell_map_holds_the_corridors_and_each_room_beside_one_of_them(name: str) -> None:
    plan = load_corridors(name)
    corridors, free = free_cells(plan, rooms=False), free_cells(plan)
    rooms = room_cells(plan)
    assert free.sum() == corridors.sum() + len(rooms)
    for x, y in rooms.values():
        around = corridors[y - 1, x], corridors[y + 1, x], corridors[y, x - 1], corridors[y, x + 1]
        assert sum(around) == 1


def test_the_cells_of_a_t_are_its_metres() -> None:
    free = free_cells(load_corridors("T"), rooms=False)
    assert free.sum() == 25 + 24
    assert free[27, 3:28].all()
    assert free[3:28, 15].all()


def test_the_text_is_read_back_as_the_same_cells(tmp_path: Path) -> None:
    free = free_cells(load_corridors("9cube"))
    (tmp_path / "plan.map").write_text(moving_ai_text(free))
    assert np.array_equal(load_free_cells(tmp_path / "plan.map"), free[::-1])
