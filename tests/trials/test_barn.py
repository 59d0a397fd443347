"""The BARN benchmark: its rules, its score, and a few of its worlds."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from waychair.cli.barn_command import barn_command
from waychair.control.drive.mapless import MaplessNavigator
from waychair.control.drive.navigator import Stage
from waychair.errors import ConfigError, WorldError
from waychair.simulation.plan.imports import BarnEnvironment, read_barn
from waychair.trials.barn import (
    JACKAL,
    ROBOTS,
    BarnTask,
    clearance_among,
    navigator_settings,
    report,
    run_barn,
    run_worlds,
    upper_bound,
    worlds_in,
)
from waychair.types import FloatArray, Pose2

TASK = BarnTask()


def field_of(cylinders: list[tuple[float, float]], length: float = 10.0) -> BarnEnvironment:
    """Return posts of 7.5 cm radius between a start at the origin and a goal straight ahead."""
    posts = np.array([(x, y, 0.075) for x, y in cylinders]).reshape(-1, 3)
    return BarnEnvironment("made", posts, Pose2(), Pose2(length, 0.0, 0.0), length)


def test_the_chair_crosses_an_open_field_at_full_speed() -> None:
    run = run_barn(field_of([], 4.0), 0, JACKAL, navigator_settings(JACKAL, 0.5, 1.0))
    assert run.outcome == "success"
    assert 2.9 / 0.5 <= run.time_s + 0.5 < 7.5
    assert run.score == pytest.approx(2.0 / run.time_s)
    assert math.hypot(*(run.truth[-1, :2] - (4.0, 0.0))) <= 1.0


def test_no_more_processes_are_started_than_there_are_worlds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []

    @contextmanager
    def workers(jobs: int) -> Iterator[type[map]]:
        asked.append(jobs)
        yield map

    monkeypatch.setattr("waychair.trials.barn._workers", workers)
    monkeypatch.setattr("waychair.trials.barn.read_barn", lambda path, scale: field_of([], 2.0))
    run_worlds([tmp_path / "a", tmp_path / "b"], TASK, 64)
    assert asked == [2]


def test_the_chair_passes_a_wall_of_posts_through_its_gap() -> None:
    posts = [(2.0, 0.15 * k) for k in range(-20, 21) if not 4 <= k <= 10]
    run = run_barn(field_of(posts, 4.0), 1, JACKAL, navigator_settings(JACKAL, 0.5, 1.0))
    assert run.outcome == "success"
    assert run.clearance_m > 0.0
    crossed = run.truth[np.argmin(np.abs(run.truth[:, 0] - 2.0)), 1]
    assert 0.6 < crossed < 1.5


def test_a_closed_ring_gives_a_timeout_and_no_contact() -> None:
    ring = [(2.0 * math.cos(a), 2.0 * math.sin(a)) for a in np.linspace(0, math.tau, 90, endpoint=False)]
    run = run_barn(field_of(ring, 6.0), 0, JACKAL, navigator_settings(JACKAL, 0.5, 1.0), 8.0)
    assert (run.outcome, run.score) == ("timeout", 0.0)
    assert run.clearance_m > 0.0


def test_before_an_occupied_goal_the_chair_stands_and_says_once_that_it_waits() -> None:
    taken = [(x, y) for x in (2.9, 3.0, 3.1) for y in (-0.1, 0.0, 0.1)]
    brief = 1.1  # s; between two plans
    run = run_barn(field_of(taken, 3.0), 0, JACKAL, navigator_settings(JACKAL, 0.5, 1.0), brief)
    assert run.distance_m == 0.0
    assert run.reason.count("waiting") == 1


def test_a_start_in_a_post_counts_as_a_contact() -> None:
    run = run_barn(field_of([(0.2, 0.0)]), 0, JACKAL, navigator_settings(JACKAL, 0.5, 1.0))
    assert (run.outcome, run.score) == ("contact", 0.0)


@pytest.mark.nightly
def test_the_same_seed_gives_the_same_run_and_others_differ() -> None:
    environment, navigator = field_of([(1.5, 0.1)], 3.0), navigator_settings(JACKAL, 0.5, 1.0)
    first, again, other = (run_barn(environment, start, JACKAL, navigator) for start in (0, 0, 1))
    np.testing.assert_array_equal(first.truth, again.truth)
    assert not np.array_equal(first.truth[0], other.truth[0])
    assert np.abs(other.truth[0]).max() <= math.radians(10.0)


@pytest.mark.parametrize("name", ROBOTS)
def test_the_clearance_among_cylinders_equals_brute_force(name: str) -> None:
    body, rng = ROBOTS[name], np.random.default_rng(7)
    corners = body.outline()
    sides = np.concatenate([np.linspace(a, b, 400) for a, b in zip(corners, np.roll(corners, -1, 0), strict=True)])
    for x, y, theta in rng.uniform(-3, 3, (40, 3)):
        posts: FloatArray = np.column_stack([rng.uniform(-4, 4, (5, 2)), rng.uniform(0.05, 0.2, 5)])
        c, s = math.cos(theta), math.sin(theta)
        local = (posts[:, :2] - (x, y)) @ np.array([[c, -s], [s, c]])
        within = (local[:, 0] <= body.front) & (local[:, 0] >= -body.rear) & (np.abs(local[:, 1]) <= body.width / 2)
        away = np.hypot(*(local[:, None] - sides).transpose(2, 0, 1)).min(axis=1) - posts[:, 2]
        expected = 0.0 if within.any() else max(away.min(), 0.0)
        assert clearance_among(posts, body, Pose2(x, y, theta)) == pytest.approx(expected, abs=0.004)
    assert clearance_among(np.empty((0, 3)), body, Pose2()) == math.inf


def test_nothing_moves_before_the_first_scan() -> None:
    navigator = MaplessNavigator(JACKAL, Pose2(), Pose2(5.0, 0.0), navigator_settings(JACKAL, 0.5, 1.0))
    navigation = navigator.step(0, Pose2(), None)
    assert navigation.stage is Stage.WAITING
    assert (navigation.twist.v, navigation.twist.omega) == (0.0, 0.0)


def test_bounds_beside_zero_failures_follow_the_rule_of_three() -> None:
    assert upper_bound(0, 1000) == pytest.approx(3.0 / 1000, rel=0.01)
    assert upper_bound(5, 5) == 1.0


@pytest.mark.parametrize("body", [pytest.param("jackal", marks=pytest.mark.nightly), "A"])
def test_the_chair_crosses_a_real_world_without_a_contact(data_dir: Path, body: str) -> None:
    """A small sample of the acceptance figures: the world with the longest detours."""
    scale = 1.63 if body == "A" else 1.0
    navigator = navigator_settings(ROBOTS[body], 0.8 if body == "A" else 0.5, scale)
    environment = read_barn(data_dir / "barn" / "worlds" / "world_243.txt", scale)
    run = run_barn(environment, 0, ROBOTS[body], navigator)
    assert (run.outcome, run.clearance_m > 0.0) == ("success", True)
    assert run.score > 0.26


def test_a_report_has_a_row_for_each_world() -> None:
    runs = [run_barn(field_of([], 2.0), start, JACKAL, navigator_settings(JACKAL, 0.5, 1.0)) for start in (0, 1)]
    found = report(runs, replace(TASK, starts=2))
    assert (found["runs"], found["success"], found["contact"], found["timeout"]) == (2, 1.0, 0.0, 0.0)
    assert found["score"] == pytest.approx(np.mean([run.score for run in runs]))
    assert [row["world"] for row in found["worlds"]] == ["made"]
    json.dumps(found, allow_nan=False)


def test_invalid_requests_are_refused_with_advice(tmp_path: Path, data_dir: Path) -> None:
    with pytest.raises(WorldError, match=r"holds no world_\*\.txt"):
        worlds_in(tmp_path)
    with pytest.raises(WorldError, match="at least one"):
        worlds_in(data_dir / "barn", 0)
    (tmp_path / "file").write_text("")
    for path in (tmp_path / "none", tmp_path / "file"):
        with pytest.raises(WorldError, match="there is no folder '"):
            worlds_in(path)
    with pytest.raises(ConfigError, match="unknown body 'truck': take jackal"):
        BarnTask(body="truck")
    with pytest.raises(ConfigError, match="speed"):
        BarnTask(speed=-1.0)
    (tmp_path / "world_001.txt").write_text("world 1\n")
    with pytest.raises(WorldError, match="no line `grid`"):
        run_worlds(worlds_in(tmp_path), TASK)


@pytest.mark.nightly
def test_the_command_prints_the_figures_of_the_benchmark_as_json(
    data_dir: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    barn_command(data_dir / "barn", worlds=1, jobs=1, json=True)
    found = json.loads(capsys.readouterr().out)
    assert {"score", "success", "contact", "timeout", "worlds"} <= set(found)
    assert found["runs"] == 1
