"""Explanation of a chair's stops in plain sentences, from its black box."""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path

from waychair.control.safety.stops import STOPS, Severity
from waychair.control.safety.supervisor import DRIVEN
from waychair.errors import BoxError
from waychair.runtime.black_box.box_events import BlackBoxEvent, Gravity
from waychair.runtime.black_box.box_file import BoardIdentity, Log, LoggedHalt, Tick
from waychair.runtime.black_box.box_store import (
    PARTS,
    RING,
    LogPart,
    is_written,
    parts_of,
    segment_files,
    unfinished_log,
)
from waychair.runtime.black_box.why_evidence import LogCursor, evidence, look_at, remedy_of
from waychair.types import DriveMode, Pose2

_STANDS, _TURNS = 0.03, 0.06
_NEAR = 0.3
_BACK_S = 30.0
"""Length of the log that is read before the end of a killed run [s]."""


@dataclass(frozen=True, slots=True)
class Explanation:
    """The explanation of one stop. `id` is its gravest reason, `wall_ns` its time by the wall clock."""

    id: str
    wall_ns: int
    doing: str
    first: str
    evidence: tuple[str, ...]
    followed: tuple[str, ...]
    remedy: str
    look_at: tuple[str, ...]
    where: Pose2
    folder: str
    software: str
    calibration_hash: str
    board: BoardIdentity | None


@dataclass(frozen=True, slots=True)
class LoggedStop:
    """The events and the log of one stop; `part` None for a killed run that no later run has kept yet."""

    events: tuple[BlackBoxEvent, ...]
    log: Log
    folder: Path
    part: LogPart | None = None


def last_stops(box: Path, count: int = 1) -> list[LoggedStop]:
    """Return the latest stops in a box, the latest first.

    Raises:
        BoxError: there is no black box, it is not readable, or it holds no stop.
    """
    if not (box / RING).is_dir() and not (box / PARTS).is_dir():
        what = "is no black box: it holds neither ring/ nor parts/" if box.exists() else "does not exist"
        raise BoxError(f"{box} {what}; give the folder that --box named when the chair drove")
    stops = [*_loose_end(box)]
    problems = []
    for part in reversed(parts_of(box)):
        if len(stops) >= count:
            break
        try:
            stops.append(LoggedStop(part.events, _not_empty(part.log(), part.folder), part.folder, part))
        except BoxError as error:
            problems.append(str(error))
    if stops:
        return stops[:count]
    if problems:
        raise BoxError(problems[0])
    if list((box / PARTS).glob("*")) or not segment_files(box):
        raise BoxError(f"the black box {box} holds no readable log: it is empty or damaged")
    raise BoxError(f"the black box {box} holds no stop: nothing has stopped the chair so far")


def _loose_end(box: Path) -> list[LoggedStop]:
    """Return the end of a killed run that no later run has kept yet."""
    if is_written(box):
        return []
    left = unfinished_log(box, _BACK_S)
    if left is None:
        return []
    event, log = left[0], left[1]
    return [LoggedStop((event,), log.between(event.stamp_ns - round(_BACK_S * 1e9), event.stamp_ns), box / RING)]


def _not_empty(log: Log, folder: Path) -> Log:
    if not log.moments:
        raise BoxError(f"{folder} holds no readable tick: it is damaged")
    return log


def explain(stop: LoggedStop) -> Explanation:
    """Return the explanation of a stop, in the order of events."""
    log, worst = stop.log, _worst(stop.events)
    at = _index(log, stop.events[0])
    begun = _onset(log, at)
    first = _first(stop.events[0], log, at, begun)
    reasons = dict.fromkeys([first.id, *(event.id for event in stop.events)])
    shown = dict.fromkeys(
        sentence for name in reasons for sentence in evidence(_cursor_at(log, stop.events, name, at), name)
    )
    tick = log.moments[at].tick
    return Explanation(
        id=worst.id,
        wall_ns=worst.wall_ns,
        doing=_doing(log, max(begun - 1, 0), at),
        first=_told_first(first, log, begun, worst),
        evidence=tuple(shown),
        followed=tuple(_followed(stop, at, first)),
        remedy=remedy_of(worst.id, worst.text),
        look_at=tuple(dict.fromkeys(hint for name in reasons for hint in look_at(name))),
        where=tick.map_from_base,
        folder=str(stop.folder),
        software=log.head.software,
        calibration_hash=log.head.calibration_hash,
        board=log.head.board,
    )


def sentences(explanation: Explanation) -> list[str]:
    """Return an explanation as lines of text."""
    e = explanation
    when = datetime.fromtimestamp(e.wall_ns * 1e-9, UTC).astimezone().strftime("%Y-%m-%d %H:%M:%S")
    lines = [f"{when}: {e.id}", f"  What it was doing: {e.doing}.", f"  What happened first: {e.first}."]
    lines += [f"    - {sentence}" for sentence in e.evidence]
    lines += ["  What followed:", *(f"    - {sentence}" for sentence in e.followed)] if e.followed else []
    lines.append(f"  What to do: {e.remedy}.")
    lines += ["  Check also:", *(f"    - {hint}" for hint in e.look_at)] if e.look_at else []
    board = (
        "no board" if e.board is None else f"firmware {e.board.firmware_version >> 8}.{e.board.firmware_version & 255}"
    )
    wire = "" if e.board is None else f" (wire {e.board.layout_hash:08x})"
    lines.append(f"  Source: {e.folder}, waychair {e.software}, calibration {e.calibration_hash[:12]}, {board}{wire}")
    return lines


def _worst(events: tuple[BlackBoxEvent, ...]) -> BlackBoxEvent:
    """Return the first of the gravest events."""
    return max(events, key=lambda event: list(Gravity).index(event.gravity))


def _index(log: Log, event: BlackBoxEvent) -> int:
    """Return the index of an event's tick."""
    gaps = [abs(tick.stamp_ns - event.stamp_ns) for tick in log.ticks]
    return gaps.index(min(gaps))


def _cursor_at(log: Log, events: tuple[BlackBoxEvent, ...], name: str, at: int) -> LogCursor:
    """Return the log at the tick of a reason's event."""
    event = next((event for event in events if event.id == name), None)
    return LogCursor(log, at if event is None else _index(log, event))


def _onset(log: Log, at: int) -> int:
    """Return the index of the tick from which on the drive was held up without a break until the event."""
    begun = at
    while begun > 0 and _held_up(log.moments[begun - 1].tick):
        begun -= 1
    return begun


def _held_up(tick: Tick) -> bool:
    return tick.mode in DRIVEN and any(_counts(halted) for halted in tick.halts)


def _counts(halted: LoggedHalt) -> bool:
    stop = STOPS.get(halted.id)
    return stop is not None and stop.severity >= Severity.PAUSES


def _first(event: BlackBoxEvent, log: Log, at: int, begun: int) -> LoggedHalt:
    """Return the first cause: the halt that had held the drive up before the event, or the event itself."""
    halts = [halted for halted in log.moments[begun].tick.halts if _counts(halted)] if begun < at else []
    return halts[0] if halts else LoggedHalt(event.id, event.text)


def _told_first(first: LoggedHalt, log: Log, begun: int, worst: BlackBoxEvent) -> str:
    before_s = (worst.stamp_ns - log.moments[begun].tick.stamp_ns) * 1e-9
    earlier = f", {before_s:.1f} s earlier" if before_s >= 0.1 else ""
    sentence = STOPS[first.id].sentence if first.id in STOPS else first.text.partition(": ")[0]
    return f"{sentence} ({first.id}{earlier})"


def _doing(log: Log, index: int, at: int) -> str:
    """Describe goal, speed and pose in the tick before the stop began; `at` is the event's tick."""
    tick = log.moments[index].tick
    here = tick.map_from_base
    where = f"at {here.x:.2f}, {here.y:.2f} on the map"
    speed = tick.twist.v
    moves = f"at {abs(speed):.2f} m/s{' backwards' if speed < -_STANDS else ''}"
    if abs(speed) < _STANDS:
        moves = "turning on the spot" if abs(tick.twist.omega) > _TURNS else "standing"
    if tick.mode not in DRIVEN:
        who = "Stop had been pressed" if tick.mode is DriveMode.STOPPED else "the computer did not drive"
        asked = max((k for k, told in log.requests if told.what == "go" and k <= at), default=None)
        if asked is not None and not any(moment.tick.mode in DRIVEN for moment in log.moments[asked:at]):
            who = f"it was about to drive to {_goal(log, at)}"
        return f"{who}; the chair was {moves} {where}"
    hand = ", with the rider's hand on the joystick" if tick.mode is DriveMode.ASSISTED else ""
    return f"driving by itself{hand} to {_goal(log, index)}, {moves}, {where}"


def _goal(log: Log, index: int) -> str:
    """Return the goal's name or pose, with its straight-line distance."""
    tick = log.moments[index].tick
    asked = [told.goals for k, told in log.requests if told.what == "go" and k <= index]
    goals = asked[-1] if asked else ()
    left = tick.goals or len(goals)  # 0 after a drive that has just failed
    target = goals[len(goals) - left].target if 0 < left <= len(goals) else tick.goal
    pose = log.head.places.get(target) if isinstance(target, str) else target
    pose = pose or tick.goal
    if pose is None:
        return target if isinstance(target, str) else "a goal without a known path"
    name = target if isinstance(target, str) else _place_at(log, pose)
    here = tick.map_from_base
    return f"{name} ({math.hypot(pose.x - here.x, pose.y - here.y):.1f} m away)"


def _place_at(log: Log, pose: Pose2) -> str:
    names = {
        name: math.hypot(place.x - pose.x, place.y - pose.y)
        for name, place in log.head.places.items()
        if math.hypot(place.x - pose.x, place.y - pose.y) < _NEAR
    }
    return min(names, key=names.__getitem__, default=f"{pose.x:.2f}, {pose.y:.2f}")


def _followed(stop: LoggedStop, at: int, first: LoggedHalt) -> list[str]:
    """Return the events after the first one until the next drive, each with its delay [s]."""
    log, began_ns = stop.log, stop.log.moments[at].tick.stamp_ns
    ticks = _until_next_drive(log.ticks[max(at - 1, 0) :])
    after = ticks[1 if at else 0 :]
    told = [(event.stamp_ns, event.text) for event in stop.events if event.id != first.id]
    told += [
        (after[k - at].stamp_ns, f"request: {each.what}")
        for k, each in log.requests
        if at < k < at + len(after) and each.what != "confirm"
    ]
    told += [*_released(after), *_came_to_rest(after), *_over(ticks)]
    told.sort(key=lambda entry: entry[0])
    lines = [f"{max(0.0, (stamp_ns - began_ns) * 1e-9):.1f} s later: {text}" for stamp_ns, text in told]
    if log.lost:
        lines.append(f"{log.lost} ticks are missing in the log: the disk was too slow")
    if log.damaged:
        lines.append(f"{log.damaged} bytes of the log cannot be read")
    if log.end is not None and log.end.problem and not log.end.problem.startswith("the program ended"):
        lines.append(f"the log ends early: {log.end.problem}")
    return lines


def _released(after: tuple[Tick, ...]) -> list[tuple[int, str]]:
    """Return when the lines were let go."""
    if not after or not after[0].sent.active:
        return [(after[0].stamp_ns, "the computer had let go of the joystick lines")] if after else []
    tick = next((tick for tick in after if not tick.sent.active), None)
    if tick is None:
        return []
    why = "" if tick.sent.reason in ("", "no command") else f": {tick.sent.reason}"
    return [(tick.stamp_ns, f"the computer let go of the joystick lines{why}")]


def _came_to_rest(after: tuple[Tick, ...]) -> list[tuple[int, str]]:
    """Return when the chair stood, with the distance driven until then."""
    way = 0.0
    for before, tick in pairwise(after):
        way += abs(before.twist.v) * (tick.stamp_ns - before.stamp_ns) * 1e-9
        if abs(tick.twist.v) < _STANDS and abs(tick.twist.omega) < _TURNS:
            return [(tick.stamp_ns, f"the chair stood after {way:.2f} m")]
    return [] if not after else [(after[-1].stamp_ns, "the chair was still moving at the end of the log")]


def _over(ticks: tuple[Tick, ...]) -> list[tuple[int, str]]:
    """Return when the drive was over, and when another one began."""
    told = []
    for before, tick in pairwise(ticks):
        was, drives = before.mode in DRIVEN, tick.mode in DRIVEN
        if was and not drives:
            told.append((tick.stamp_ns, f"the drive was over: {tick.reason or tick.stage_reason}"))
        elif drives and not was:
            told.append((tick.stamp_ns, "another drive was confirmed and began"))
    return told


def _until_next_drive(ticks: tuple[Tick, ...]) -> tuple[Tick, ...]:
    """Return the ticks up to the one in which another drive begins."""
    for index, (before, tick) in enumerate(pairwise(ticks)):
        if index and tick.mode in DRIVEN and before.mode not in DRIVEN:
            return ticks[: index + 2]
    return ticks
