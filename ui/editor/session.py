"""One building that is being edited: its draft with undo and redo, the checks after each edit, and the saved files.

The draft is in `draft.jsonl`, apart from the saved building, so that nobody drives by it; saving writes the building whole
or not at all. One program at a time edits a building. Every change names the revision that its page has seen, so that of
two pages the later one is told and loses nothing.
"""

from __future__ import annotations

import fcntl
import os
import threading
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import IO, Self

from waychair.calibration.chair_body import CHAIR_A, ChairBody
from waychair.errors import BuildingError, WaychairError
from waychair.files import is_file
from waychair.maps.building.building import Building, load_building, new_building
from waychair.maps.building.checks.hgraph_checks import FindingSeverity, GraphFinding
from waychair.maps.building.hgraph_files import GENERAL
from waychair.maps.building.indexed import indexed
from waychair.maps.editing.arc_edits import Operation
from waychair.maps.editing.draft import Draft, draft_of, save_draft, texts_of_draft, zoned
from waychair.maps.editing.edit_log import LOG, EditLog, History, replayed
from waychair.maps.editing.map_edits import patch_between
from waychair.maps.editing.node_edits import AddNode, with_id
from waychair.maps.editing.operations import operation_of, words
from waychair.maps.folders.map_files import load_map
from waychair.planning.building.border_tables import BorderTables
from waychair.planning.building.surroundings import LiveSurroundings
from waychair.planning.building.table_files import TABLES, graph_key, save_tables
from waychair.ui.editor.differences import differences

LOCK = ".editing"
"""The file that is locked while a program edits the building."""

WATCHED_S = 1.0
"""How often the saved files are looked at, for changes by somebody else [s]."""

NOT_IN_DRAFT = ("E15", "E16")
"""Faults of files beside the graph, which a save may not wait for."""


class StaleEdit(BuildingError):
    """A page's edit is of an older revision: another page has changed the building since."""


class Session:
    """A building being edited; any thread may call it.

    Raises:
        BuildingError: another program edits it, or its files or its draft are damaged.
        OutputError: its folder cannot be written to.
    """

    def __init__(self, folder: Path, body: ChairBody = CHAIR_A) -> None:
        self.folder, self.body = folder, body
        self.notes: list[str] = []
        self.revision = 1
        self.foreign: Sequence[str] = ()
        self.findings: Sequence[GraphFinding] = ()
        self.around: LiveSurroundings
        self._base: str
        self._saved: Draft
        self._saved_at: int
        self._history: History
        self._looked: float
        self._lock = threading.RLock()
        self._held = _locked(folder)
        try:
            if not is_file(folder / GENERAL, BuildingError):
                new_building(folder, folder.resolve().name)
                self.notes.append(f"A new building was made in {folder.name}.")
            self._log = EditLog(folder)
            self._open()
        except BaseException:
            self._held.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Let other programs edit the building. The draft stays for the next time."""
        self._held.close()

    @property
    def draft(self) -> Draft:
        """The present draft."""
        return self._history.draft

    @property
    def history(self) -> History:
        """The drafts so far."""
        return self._history

    @property
    def is_saved(self) -> bool:
        """Whether the saved building is the draft."""
        return self._history.draft is self._saved

    @property
    def building(self) -> Building:
        """The draft as a building; its maps are those of the folder."""
        return Building(self.folder, self.draft.hgraph)

    def do(self, revision: int, asked: object) -> None:
        """Do an operation, given as JSON values.

        Raises:
            StaleEdit: another page has changed the building since this revision.
            BuildingError, PlaceError, ZoneError: it cannot be done.
            OutputError: the draft cannot be written.
        """
        self.do_operation(revision, operation_of(asked))

    def do_operation(self, revision: int, operation: Operation) -> None:
        """Do an operation; raises as `do`."""
        with self._lock:
            self._expect(revision)
            if isinstance(operation, AddNode):
                operation = with_id(self.draft, operation)
            after = self._history.after(operation)
            self._log.add(operation)
            self._become(after)

    def undo(self, revision: int) -> None:
        """Undo the latest step; raises as `do`."""
        with self._lock:
            self._expect(revision)
            if self._history.done:
                before = self._history.undone()
                self._note_step(before, forward=False)
                self._become(before)

    def redo(self, revision: int) -> None:
        """Redo the step that was undone last; raises as `do`."""
        with self._lock:
            self._expect(revision)
            if self._history.redoes:
                after = self._history.redone()
                self._note_step(after, forward=True)
                self._become(after)

    def save(self, revision: int, over: bool = False) -> str:
        """Write the draft as the building; return a sentence.

        With errors it stays a draft, and the chair goes on with the building as it was saved. If somebody else has
        changed the saved files, nothing is written unless `over`; then their files are kept in `replaced/`.

        Raises:
            StaleEdit, BuildingError, PlaceError, MapError, OutputError: nothing is saved, and the draft stays.
        """
        with self._lock:
            self._expect(revision)
            errors = sum(self.forbids(each) for each in self.findings)
            if errors:
                plural = "errors" if errors > 1 else "error"
                return f"Kept as a draft: the checks show {errors} {plural}. The chair goes on with the saved building."
            if self._key() != self._base:
                if not over:
                    raise BuildingError("somebody else has changed the building's files: choose whose changes stay")
                self._keep_replaced()
            save_draft(self.folder, self.draft, self._saved)
            self._base, self._saved = self._key(), self.draft
            self._log.begin(self._base)
            self.foreign = ()
            self._saved_at = self._history.done
            self.around.with_saved_graph()
            self.check()
            self.revision += 1
            if is_file(self.folder / TABLES, BuildingError):
                self._make_tables()
                return "Saved. Its tables were made anew."
            return "Saved."

    def make_tables(self, revision: int) -> str:
        """Make the tables of the saved building, from which routes are read; return a sentence. Raises as `save`."""
        with self._lock:
            self._expect(revision)
            if not self.is_saved:
                raise BuildingError("the tables are those of the saved building: save it first")
            self._make_tables()
            self.revision += 1
            return "The tables were made."

    def forbids(self, finding: GraphFinding) -> bool:
        """Return whether a finding keeps the draft from being saved as the building."""
        return finding.severity is FindingSeverity.ERROR and finding.code not in NOT_IN_DRAFT

    def take_files(self, revision: int) -> list[str]:
        """Take the saved files as they are now, and do the draft's edits again on them.

        Return a sentence for each edit that cannot be done any more. The draft's log of before is kept beside it.

        Raises:
            StaleEdit, BuildingError, MapError, PlaceError, ZoneError: as `Session`.
        """
        with self._lock:
            self._expect(revision)
            failed = self._open()
            self.revision += 1
            return failed

    def discard(self, revision: int) -> None:
        """Give the draft up: the building is as it was saved. The log of before is kept beside it. Raises as `take_files`."""
        with self._lock:
            self._expect(revision)
            self._set_log_aside()
            self._open()
            self.revision += 1

    def look(self) -> None:
        """Look at the saved files and the maps, at most once a second: `foreign` says what somebody else has changed."""
        with self._lock:
            now = time.monotonic()
            if now - self._looked < WATCHED_S:
                return
            self._looked = now
            if self.around.look_for_maps(self.building):
                self.check()
                self.revision += 1
            try:
                if self._key() == self._base:
                    self.foreign = ()
                    return
                theirs = draft_of(load_building(self.folder))
                self.foreign = tuple(differences(texts_of_draft(self._saved), texts_of_draft(theirs)))
            except WaychairError as error:
                self.foreign = (f"the files cannot be read at present: {error}",)

    def taken_notes(self) -> list[str]:
        """Return the notes that no page has been told yet."""
        notes, self.notes = self.notes, []
        return notes

    def add_map(self, storey: str, folder: Path) -> None:
        """Take the map of a storey that is about to be added; raises MapError for a damaged one."""
        self.around.with_map(storey, load_map(folder))

    def check(self) -> None:
        """Check the draft; `findings` are its faults and warnings."""
        self.findings = self.around.findings(self.draft)

    def _open(self) -> list[str]:
        """Read the saved building and do the edits of its log again; return those that failed, in words."""
        building = load_building(self.folder)
        self._saved = draft_of(building)
        self._base = self._key()
        self.foreign = ()
        self._looked = time.monotonic()
        found = self._log.read()
        self._history, failed = History(self._saved), list[str]()
        if found is None:
            self._log.begin(self._base)
        else:
            self._history, failed = replayed(self._saved, found[1])
            if found[0] != self._base:
                self._set_log_aside()
                self._log.begin(self._base)
                for step in self._history.steps[: self._history.done]:
                    self._log.add(step.operation)
                if found[1]:
                    again = self._history.done - len(failed)
                    self.notes.append(
                        f"The building has changed since this draft was begun: {again} edits were done again."
                    )
            self.notes += [f"This edit cannot be done any more: {sentence}" for sentence in failed]
        self._saved_at = 0
        self.around = LiveSurroundings(replace(building, hgraph=self._saved.hgraph), self.body)
        self.check()
        self.around.warm_up(self.draft)
        return failed

    def _expect(self, revision: int) -> None:
        if revision != self.revision:
            raise StaleEdit("another page has changed the building: look at it again, then repeat your edit")

    def _become(self, history: History) -> None:
        self._history = history
        self.revision += 1
        if is_file(self.folder / TABLES, BuildingError):
            self.around.with_tables(not self.is_saved)
        self.check()

    def _note_step(self, history: History, *, forward: bool) -> None:
        """Write a step back or forth into the log; steps of before the last save are not in it, and become a patch."""
        if min(history.done, self._history.done) >= self._saved_at:
            (self._log.add_redo if forward else self._log.add_undo)()
            return
        step = history.steps[history.done - 1] if forward else self._history.steps[self._history.done - 1]
        self._log.begin(self._base)
        what = f"{'redo' if forward else 'undo'}: {words(step.operation)}"
        self._log.add(patch_between(what, self._saved, history.draft))

    def _make_tables(self) -> None:
        now_ns = time.time_ns()
        building = Building(self.folder, self._saved.hgraph)
        tables = BorderTables(indexed(zoned(self._saved), now_ns).graph)
        save_tables(self.folder / TABLES, tables.tables, graph_key(building, now_ns))
        self.around.with_tables(False)
        self.check()

    def _key(self) -> str:
        return graph_key(Building(self.folder, self._saved.hgraph), 0)

    def _keep_replaced(self) -> None:
        """Copy somebody else's files aside before they are replaced."""
        import shutil

        target = self.folder / "replaced" / time.strftime("%Y%m%d-%H%M%S", time.gmtime())
        for name in [GENERAL, "submaps"]:
            source = self.folder / name
            if source.is_dir():
                shutil.copytree(source, target / name)
            elif source.is_file():
                target.mkdir(parents=True, exist_ok=True)
                shutil.copy2(source, target / name)

    def _set_log_aside(self) -> None:
        path = self.folder / LOG
        if path.is_file() and path.read_bytes().count(b"\n") > 1:
            path.replace(self.folder / f"draft-{time.strftime('%Y%m%d-%H%M%S', time.gmtime())}.jsonl")
        else:
            path.unlink(missing_ok=True)


def _locked(folder: Path) -> IO[bytes]:
    """Return the folder's lock file, locked; it is let go with the program, even a killed one."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        file = (folder / LOCK).open("ab")
    except OSError as error:
        raise BuildingError(f"cannot edit {folder}: {os.strerror(error.errno or 0)}; choose another folder") from error
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        file.close()
        raise BuildingError(f"another program edits the building in {folder}: use its page, or end it first") from error
    return file
