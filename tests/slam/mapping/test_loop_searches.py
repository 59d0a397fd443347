"""The pace of long searches for a revisited place."""

from __future__ import annotations

import numpy as np
import pytest

from waychair.slam.mapping.loop_searches import SubmapsSearch
from waychair.slam.scan.submap_search import SubmapRound


@pytest.mark.parametrize(("submaps", "key_scans_a_piece"), [(1, 1), (60, 1), (61, 2), (120, 2), (200, 4)])
def test_the_more_submaps_a_round_has_the_more_key_scans_share_a_piece(submaps: int, key_scans_a_piece: int) -> None:
    members = {first: np.arange(first, first + 40) for first in range(0, 40 * submaps, 40)}
    search = SubmapsSearch([], members, SubmapRound(np.zeros((0, 2)), list(members.items())))
    due = [search.is_due() for _ in range(12)]
    assert due == [k % key_scans_a_piece == key_scans_a_piece - 1 for k in range(12)]
