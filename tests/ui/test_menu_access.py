"""How the menu takes switches, and how goals become menus: the modules themselves in a browser, with times of their own."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from waychair.ui.server import STATIC

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page, Route

HOST = "http://menu.test"

RUN = """async ([options, count, happenings]) => {
  const { Access, defaults } = await import("/static/js/menu/access.js");
  const access = new Access({ ...defaults(), ...options });
  const told = [];
  access.begin(count, 0);
  let now = 0;
  const note = (moves) => { for (const move of moves) told.push(move === "take" ? `take ${access.index}` : move); };
  for (const [at, kind, which] of happenings) {
    for (; now < at; now = Math.min(at, now + 0.02)) note(access.tick(now));
    if (kind === "down" || kind === "up") note(access.level(which ?? 1, kind === "down", at));
    else if (kind !== "end") note(access.step(kind, at));
  }
  return told;
}"""


@pytest.fixture(scope="module")
def page(browser: Browser) -> Iterator[Page]:
    """A page that holds nothing but can load the modules."""

    def serve(route: Route) -> None:
        path = route.request.url.removeprefix(f"{HOST}/static/")
        if path.startswith("js/"):
            route.fulfill(path=STATIC / path)
        else:
            route.fulfill(body="<!doctype html><title>Modules</title>", content_type="text/html")

    made = browser.new_page()
    made.route("**/*", serve)
    made.goto(HOST)
    yield made
    made.close()


def run(page: Page, options: dict[str, Any], happenings: list[tuple[Any, ...]], count: int = 4) -> list[str]:
    """The moves of the access to one menu of `count` items."""
    return page.evaluate(RUN, [options, count, happenings])  # type: ignore[no-any-return]


def press(at: float, lasts: float = 0.2, which: int = 1) -> list[tuple[Any, ...]]:
    return [(at, "down", which), (at + lasts, "up", which)]


AUTO = {"method": "auto", "sweep": 1.0, "first": 0.5}


def test_the_frame_sweeps_and_a_press_takes_the_framed_item(page: Page) -> None:
    assert run(page, AUTO, press(1.4)) == ["take 0"]  # the first item is longer
    assert run(page, AUTO, press(1.6)) == ["next", "take 1"]
    assert run(page, AUTO, press(3.4)) == ["next", "next", "take 2"]


def test_the_frame_rests_after_its_rounds_and_the_next_press_only_wakes_it(page: Page) -> None:
    told = run(page, AUTO, [(20.0, "down"), (20.2, "up"), (21.0, "end"), *press(21.1)])
    assert told == [*["next"] * 7, "rest", "wake", "take 0"]


@pytest.mark.parametrize("bounces", [1, 3])
def test_a_bouncing_switch_presses_once_and_a_short_press_between_bounces_is_released(page: Page, bounces: int) -> None:
    edges = [(0.5 + 0.004 * k, "down" if k % 2 == 0 else "up") for k in range(2 * bounces + 1)]
    released = [(0.8 + 0.004 * k, "up" if k % 2 == 0 else "down") for k in range(2 * bounces + 1)]
    assert run(page, {"method": "step"}, [*edges, *released, (2.0, "end")]) == ["next"]
    shortest = [(0.5, "down"), (0.51, "up")]  # lets go within the time of a bounce
    assert run(page, {"method": "step"}, [*shortest, *press(1.0), (2.0, "end")]) == ["next", "next"]


def test_a_press_counts_only_once_it_has_lasted_and_not_right_after_another(page: Page) -> None:
    slow = {"method": "step", "acceptance": 0.3, "release": 0.5}
    assert run(page, slow, [*press(0.5, 0.2), (2.0, "end")]) == []
    assert run(page, slow, [*press(0.5, 0.5), (2.0, "end")]) == ["next"]
    assert run(page, slow, [*press(0.5, 0.5), *press(1.2, 0.5), (3.0, "end")]) == ["next"]
    assert run(page, slow, [*press(0.5, 0.5), *press(1.6, 0.5), (3.0, "end")]) == ["next", "next"]


def test_two_switches_step_and_take(page: Page) -> None:
    told = run(page, {"method": "step"}, [*press(0.5), *press(1.0), *press(1.5, which=2), (2.0, "end")])
    assert told == ["next", "next", "take 2"]
    assert run(page, {"method": "step"}, [t for k in range(5) for t in press(0.5 + k)]) == ["next"] * 5  # never rests


def test_one_switch_steps_by_short_presses_and_takes_by_a_long_one(page: Page) -> None:
    told = run(page, {"method": "single", "long": 0.8}, [*press(0.5), *press(1.2), *press(2.0, 1.5), (4.0, "end")])
    assert told == ["next", "next", "take 2"]


def test_in_inverse_scanning_the_frame_moves_while_held_and_letting_go_takes(page: Page) -> None:
    inverse = {"method": "inverse", "sweep": 1.0, "first": 0.0, "rounds": 2}
    assert run(page, inverse, [*press(0.5, 2.5), (5.0, "end")]) == ["next", "next", "next", "take 2"]
    held = run(page, inverse, [*press(0.5, 30.0), (40.0, "end")])
    assert held == [*["next"] * 8, "rest"]  # letting go takes nothing any more
    assert run(page, inverse, [*press(0.5, 30.0), *press(35.0, 0.5), (40.0, "end")])[-2:] == ["next", "take 0"]


def test_a_stuck_and_a_chattering_switch_are_named_and_take_nothing_more(page: Page) -> None:
    stuck = run(page, AUTO, [(0.5, "down"), (40.0, "end")])
    assert stuck == ["take 0", "stuck"]
    chatter = run(page, {"method": "step"}, [t for k in range(24) for t in press(0.5 + 0.1 * k, 0.05)], count=99)
    assert chatter.count("next") <= 16
    assert "chatter" in chatter


def test_joystick_and_keys_step_both_ways_take_and_go_back(page: Page) -> None:
    told = run(page, {"method": "direct"}, [(1, "next"), (2, "next"), (3, "previous"), (4, "take"), (5, "back")])
    assert told == ["next", "next", "next", "take 1", "back"]


def test_damaged_options_are_the_defaults(page: Page) -> None:
    sound = """async (kept) => (await import("/static/js/menu/access.js")).sound(kept)"""
    default = page.evaluate(sound, None)
    assert default["sweep"] == 1.5
    damaged = {"method": "telepathy", "sweep": 0.0, "first": "long", "rounds": 99, "acceptance": 0.4}
    assert page.evaluate(sound, damaged) == {**default, "acceptance": 0.4}


@pytest.mark.parametrize(("mean", "deviation"), [(0.4, 0.1), (0.9, 0.3), (1.6, 0.6)])
def test_a_calibrated_sweep_is_long_enough_for_nine_presses_of_ten(page: Page, mean: float, deviation: float) -> None:
    rng = np.random.default_rng(3)
    proposed = """async (riders) => {
      const { proposedSweep } = await import("/static/js/menu/access.js");
      return riders.map(proposedSweep);
    }"""
    measured = rng.normal(mean, deviation, (400, 10)).clip(0.15)
    sweeps = np.array(page.evaluate(proposed, measured.tolist()))
    missed = (rng.normal(mean, deviation, (1000, 400)).clip(0.15) > sweeps).mean()
    assert missed < 0.1
    assert np.median(sweeps) < mean + 3 * deviation  # and no longer than needed
    assert page.evaluate(proposed, [[9.0] * 10, [0.1] * 10, []]) == [5, 0.3, 1.5]


TREE = """async (goals) => {
  const { goalItems } = await import("/static/js/menu/goal_tree.js");
  const plain = ({ label, goal, items }) => (goal ? [label, goal.name] : [label, items.map(plain)]);
  return goalItems(goals).map(plain);
}"""


def tree(page: Page, paths: list[str]) -> list[Any]:
    return page.evaluate(TREE, [{"name": path, "path": path.split("/")} for path in paths])  # type: ignore[no-any-return]


def leaves(nodes: list[Any]) -> list[tuple[str, int, int]]:
    """Name, depth, and largest menu on the way, of each goal."""
    found: list[tuple[str, int, int]] = []
    for _, inner in nodes:
        if isinstance(inner, str):
            found.append((inner, 1, len(nodes)))
        else:
            found += [(name, depth + 1, max(most, len(nodes))) for name, depth, most in leaves(inner)]
    return found


def test_goals_keep_their_order_and_groups_with_one_item_are_that_item(page: Page) -> None:
    assert tree(page, ["2/West/b", "2/West/a", "2/East/c", "1/Hall"]) == [
        ["2", [["West", [["b", "2/West/b"], ["a", "2/West/a"]]], ["East, c", "2/East/c"]]],
        ["1, Hall", "1/Hall"],
    ]
    assert tree(page, ["Main/x", "Main/y"]) == [["x", "Main/x"], ["y", "Main/y"]]
    assert tree(page, []) == []
    assert tree(page, ["only"]) == [["only", "only"]]


@pytest.mark.parametrize(("count", "deepest"), [(7, 1), (8, 2), (49, 2), (200, 3), (1000, 4), (5000, 5)])
def test_a_menu_has_at_most_seven_items_and_every_goal_is_reached_once(page: Page, count: int, deepest: int) -> None:
    names = [f"Room {k:04d}" for k in range(count)]
    found = leaves(tree(page, names))
    assert [name for name, _, _ in found] == names
    assert max(depth for _, depth, _ in found) <= deepest
    assert max(most for _, _, most in found) <= 7
