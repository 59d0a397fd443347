"""A building being edited: its draft outlives its program, its saves are whole, and other people's changes are noticed."""

from __future__ import annotations

import os
import random
import signal
import time
from pathlib import Path

import pytest

from tests.maps.building.buildings import two_storeys
from waychair.errors import BuildingError
from waychair.maps.building.building import Building, load_building, save_building
from waychair.maps.building.hgraph import ArcRef
from waychair.maps.building.hgraph_edits import with_way
from waychair.maps.building.hgraph_files import SAVING, submap_file
from waychair.maps.editing.draft import draft_of, save_draft, texts_of_draft
from waychair.maps.editing.edit_log import LOG
from waychair.maps.editing.operations import applied, operation_of
from waychair.types import Json
from waychair.ui.editor import session as sessions
from waychair.ui.editor.session import Session, StaleEdit

JOINED: Json = {"do": "add_node", "submap": "g", "x": 12.0, "y": 1.5, "joined": ["g:c2"]}
LOOSE: Json = {"do": "add_node", "submap": "g", "x": 13.0, "y": -1.5}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    save_building(Building(tmp_path / "clinic", two_storeys()))
    return tmp_path / "clinic"


def contents(folder: Path) -> dict[str, bytes]:
    """Return the bytes of all files of a building but those of its editor."""
    kept = (each for each in folder.rglob("*") if each.is_file() and each.name not in (LOG, sessions.LOCK))
    return {each.relative_to(folder).as_posix(): each.read_bytes() for each in kept}


def test_two_programs_do_not_edit_one_building(folder: Path) -> None:
    with Session(folder), pytest.raises(BuildingError, match="another program edits"):
        Session(folder)
    Session(folder).close()


def test_a_draft_with_its_undo_outlives_its_program(folder: Path) -> None:
    before = contents(folder)
    with Session(folder) as session:
        for asked in (JOINED, LOOSE):
            session.do(session.revision, asked)
        session.undo(session.revision)
        expected = session.draft.hgraph
    assert contents(folder) == before
    with Session(folder) as session:
        assert session.draft.hgraph == expected
        assert not session.is_saved
        session.redo(session.revision)
        assert "c5" in session.draft.hgraph.submaps["g"].nodes
        session.undo(session.revision)
        session.undo(session.revision)
        assert session.draft.hgraph == two_storeys()


def test_an_edit_whose_line_was_cut_off_is_left_out_and_the_next_one_follows(folder: Path) -> None:
    with Session(folder) as session:
        session.do(session.revision, JOINED)
    with (folder / LOG).open("ab") as file:
        file.write(b'{"do": "add_node", "subm')
    with Session(folder) as session:
        assert "c4" in session.draft.hgraph.submaps["g"].nodes
        session.do(session.revision, LOOSE)
    with Session(folder) as session:
        assert {"c4", "c5"} <= set(session.draft.hgraph.submaps["g"].nodes)


def test_errors_keep_a_draft_from_the_building_that_chairs_drive_by(folder: Path) -> None:
    before = contents(folder)
    with Session(folder) as session:
        session.do(session.revision, LOOSE)
        assert [each.place for each in session.findings if session.forbids(each)] == ["g:c4"]
        assert "Kept as a draft" in session.save(session.revision)
        assert contents(folder) == before
        session.do(session.revision, {"do": "join", "one": "g:c4", "other": "g:c3"})
        assert session.save(session.revision) == "Saved."
        assert session.is_saved
        saved = session.draft.hgraph
        session.undo(session.revision)
        assert not session.is_saved
    assert load_building(folder).hgraph == saved
    with Session(folder) as session:  # an undo past the save is kept, too
        assert frozenset(("c3", "c4")) not in {
            frozenset((arc.start, arc.end)) for arc in session.draft.hgraph.submaps["g"].arcs
        }


def test_of_two_pages_the_later_one_is_told(folder: Path) -> None:
    with Session(folder) as session:
        seen = session.revision
        session.do(seen, JOINED)
        with pytest.raises(StaleEdit, match="another page"):
            session.do(seen, LOOSE)
        assert "c5" not in session.draft.hgraph.submaps["g"].nodes


def test_a_building_that_is_opened_and_saved_keeps_its_bytes_and_comments(folder: Path) -> None:
    path = submap_file(folder, "g/ward")
    path.write_text("# the quiet ward\n" + path.read_text().replace(" x=0 ", "   x=0.000 "))
    before = contents(folder)
    with Session(folder) as session:
        assert session.save(session.revision) == "Saved."
        save_draft(folder, session.draft, session.draft)
    assert contents(folder) == before


def test_a_file_edited_by_hand_is_noticed_and_neither_side_is_lost(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sessions, "WATCHED_S", 0.0)
    with Session(folder) as session:
        session.do(session.revision, JOINED)
        save_building(Building(folder, with_way(two_storeys(), ArcRef("g", "c2", "c3"), price=30.0)))
        session.look()
        assert any("price_m=30" in sentence for sentence in session.foreign)
        with pytest.raises(BuildingError, match="somebody else"):
            session.save(session.revision)
        assert session.take_files(session.revision) == []
        assert not session.foreign
        assert session.save(session.revision) == "Saved."
    both = load_building(folder).hgraph.submaps["g"]
    assert "c4" in both.nodes
    assert any(arc.way.price == 30.0 for arc in both.arcs)


def test_a_save_over_somebody_elses_files_keeps_theirs_aside(folder: Path) -> None:
    with Session(folder) as session:
        session.do(session.revision, JOINED)
        save_building(Building(folder, with_way(two_storeys(), ArcRef("g", "c2", "c3"), price=30.0)))
        assert session.save(session.revision, over=True) == "Saved."
    assert any("price_m=30" in each.read_text() for each in (folder / "replaced").rglob("g.txt"))
    assert "c4" in load_building(folder).hgraph.submaps["g"].nodes


def test_edits_that_cannot_be_done_again_are_told_and_their_log_is_kept(folder: Path) -> None:
    with Session(folder) as session:
        session.do(session.revision, JOINED)
        session.do(session.revision, {"do": "move_nodes", "nodes": ["g:c3"], "x": 0.5, "y": 0.0})
        edited = two_storeys()
        submap = edited.submaps["g"]
        gone = applied(draft_of(Building(folder, edited)), operation_of({"do": "delete_nodes", "nodes": ["g:c3"]}))
        assert submap is not gone.hgraph.submaps["g"]
        save_building(Building(folder, gone.hgraph))
        (failed,) = session.take_files(session.revision)
        assert "no node g:c3" in failed
        assert "c4" in session.draft.hgraph.submaps["g"].nodes
    assert list(folder.glob("draft-*.jsonl"))


def test_a_save_that_is_killed_leaves_the_old_building_or_the_new_one(folder: Path) -> None:
    edits: list[Json] = [
        {"do": "move_nodes", "nodes": ["g:c3", "1:c3"], "x": 0.1, "y": 0.0},
        {"do": "change_storey", "id": "1", "name": "Above", "height": 3.7},
    ]
    before = draft_of(load_building(folder))
    after = before
    for asked in edits:
        after = applied(after, operation_of(asked))
    versions = [texts_of_draft(before), texts_of_draft(after)]
    rng = random.Random(3)
    found = []
    for _ in range(12):
        child = os.fork()
        if not child:
            try:
                save_draft(folder, after, before)
                save_draft(folder, before, after)
            finally:
                os._exit(0)
        time.sleep(rng.uniform(0.0, 0.03))
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        found.append(texts_of_draft(draft_of(load_building(folder))))
        assert not (folder / SAVING).exists()
    assert all(each in versions for each in found)
