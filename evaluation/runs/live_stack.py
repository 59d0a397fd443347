"""A running ROS stack: `waychair up` in a separate process, observed and driven from outside."""

from __future__ import annotations

import math
import os
import re
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from waychair.firmware_bridge.protocol import Holder
from waychair.ros import topics
from waychair.ros.client import ChairClient
from waychair.ros.environment import ros_environment
from waychair.ros.interface_types import interface_type
from waychair.ros.messages.chair import (
    DriveReport,
    Lines,
    read_drive_request,
    read_drive_state,
    read_lines,
    read_localisation,
)
from waychair.ros.messages.motion import read_odometry
from waychair.ros.messages.wire import deserialised
from waychair.slam.localising.localisation import Localisation, LocalisationState
from waychair.types import Odometry, Pose2

WORLD = "small_clinic"
PATIENCE_S = 60.0
_START_S = 240.0
"""A stack starts within 15 to 40 s, and more slowly on a busy computer; only one that does not start takes it all."""
_RUNS_AS = re.compile(r"'(\w+)' runs as process (\d+)")
COMMAND = (sys.executable, "-X", "faulthandler", "-c", "from waychair.cli.main import main; main()")
"""The `waychair` of this interpreter, which tells its threads' stacks if it is aborted."""


def waychair(domain: int, *arguments: str, timeout_s: float = 300.0) -> subprocess.CompletedProcess[str]:
    """Run a command as at a terminal, without real-time priority, so that it does not delay the stack.

    Raises:
        RuntimeError: it does not end in time; with the stacks of its threads.
    """
    with subprocess.Popen(
        ["chrt", "--other", "0", *COMMAND, *arguments],
        env=ros_environment(domain=domain),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as command:
        try:
            said, errors = command.communicate(timeout=timeout_s)
        except subprocess.TimeoutExpired:
            command.send_signal(signal.SIGABRT)
            _, stacks = command.communicate()
            what = " ".join(arguments)
            raise RuntimeError(f"`waychair {what}` did not end within {timeout_s:g} s; it was at\n{stacks}") from None
    return subprocess.CompletedProcess(command.args, command.returncode, said, errors)


_AGAIN_S = 3.0
"""After this time without a drive it has ended, and all nodes know."""

_FORGIVEN = {"board_host_silent"}
"""A new goal clears this stop."""


@dataclass(slots=True)
class SeenMessages:
    """Messages of a topic in the last minute or so: (wall time of arrival [ns], message)."""

    all: deque[tuple[int, Any]] = field(default_factory=lambda: deque(maxlen=4000))

    @property
    def last(self) -> Any:
        """The last message, None before the first."""
        return self.all[-1][1] if self.all else None

    def since(self, stamp_ns: int) -> Iterator[tuple[int, Any]]:
        """Yield the messages that arrived after a stamp."""
        return ((at_ns, what) for at_ns, what in self.all if at_ns > stamp_ns)


class LiveStack:
    """`waychair up` of a simulated chair as a context manager; its messages are collected while `spin` runs.

    At the begin of the block it is ready for a drive, `start_s` after its start.
    """

    def __init__(self, folder: Path, domain: int, *arguments: str, world: str = WORLD, namespace: str = "") -> None:
        self.folder, self.domain = folder, domain
        folder.mkdir(parents=True, exist_ok=True)
        self._log = folder / "up.log"
        self._command = [*COMMAND, "up", "--sim", world, "--out", str(folder / "run"), "--urgent", *arguments]
        self._command += ["--namespace", namespace] if namespace else []
        if "--page" not in arguments:
            self._command.append("--no-page")
        self.client = ChairClient("onlooker", domain=domain, namespace=namespace)
        self.states, self.places, self.lines, self.truth = (
            SeenMessages(),
            SeenMessages(),
            SeenMessages(),
            SeenMessages(),
        )
        self.requests = SeenMessages()
        self.listen(topics.DRIVE_REQUEST, read_drive_request, self.requests)
        self.listen(topics.DRIVE_STATE, read_drive_state, self.states)
        self.listen(topics.LOCALISATION, read_localisation, self.places)
        self.listen(topics.LINES, read_lines, self.lines)
        self.listen(topics.TRUTH, lambda message: read_odometry(message, topics.TRUTH.frame), self.truth)

    def __enter__(self) -> Self:
        with self._log.open("w") as log:
            self.process = subprocess.Popen(
                self._command, env=ros_environment(domain=self.domain), stdout=log, stderr=subprocess.STDOUT
            )
        began_s = time.monotonic()
        try:
            self.until_ready()
        except BaseException:
            self.end()
            raise
        self.start_s = time.monotonic() - began_s
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.end()
        self.client.close()

    def end(self, by: signal.Signals = signal.SIGTERM) -> int:
        """End the stack by a signal, if it still runs, and return its exit code."""
        if self.process.poll() is None:
            self.process.send_signal(by)
        return self.process.wait(20.0)

    @property
    def log(self) -> str:
        """The output of `waychair up` and its nodes so far."""
        return self._log.read_text(encoding="utf-8")

    @property
    def pids(self) -> Mapping[str, int]:
        """The process ids by name, each of the last start."""
        return {name: int(pid) for name, pid in _RUNS_AS.findall(self.log)}

    @property
    def state(self) -> DriveReport | None:
        """The bridge's last report."""
        return self.states.last  # type: ignore[no-any-return]

    @property
    def localisation(self) -> Localisation | None:
        """The mapper's last pose."""
        return None if self.places.last is None else self.places.last[1]

    @property
    def really(self) -> Odometry | None:
        """The true pose of the simulated chair."""
        return self.truth.last  # type: ignore[no-any-return]

    def true_pose(self) -> Pose2:
        """Return the true pose of now: after a command that was waited for, the last one received may be seconds old."""
        since_ns = time.time_ns()
        self.until(lambda: self.really is not None and self.really.stamp_ns > since_ns, "the true pose")
        assert self.really is not None
        return self.really.odom_from_base

    @property
    def driving(self) -> bool:
        """Whether the computer drives, by the bridge's last report."""
        return self.state is not None and self.state.driving

    def listen(self, topic: topics.RosTopic, read: Callable[[Any], Any], seen: SeenMessages) -> None:
        """Collect the messages of a topic."""

        def take(data: bytes) -> None:
            seen.all.append((time.time_ns(), read(deserialised(data, topic.type))))

        self.client.node.create_subscription(
            interface_type(topic.type), topic.name, take, topics.profile(topic.qos), raw=True
        )

    def spin(self, seconds: float) -> None:
        """Receive messages for some time."""
        self.client.spin(seconds)

    def until(self, true: Callable[[], Any], what: str, patience_s: float = PATIENCE_S) -> None:
        """Receive messages until a condition is true.

        Raises:
            AssertionError: the condition is not true in time.
        """
        ends = time.monotonic() + patience_s
        while not true():
            assert time.monotonic() < ends, f"waited in vain for {what}:\n{self.history()}\n{self.log}"
            self.client.spin(0.01)

    def history(self) -> str:
        """Return the bridge's last reports, a line per change."""
        said = [f"{s.mode.value}: {s.reason} {s.ended} {dict(s.halts)}" for _, s in self.states.all]
        stamps = [s.stamp_ns for _, s in self.states.all]
        changes = [k for k in range(len(said)) if k == 0 or said[k] != said[k - 1]]
        lines = [f"{(stamps[k] - stamps[0]) * 1e-9:.3f} s {said[k]}" for k in changes[-12:]]
        return "\n".join([*lines, f"ended {self.client.result()}, at {self.localisation}, really {self.really}"])

    def until_ready(self, since_ns: int = 0) -> None:
        """Wait until a drive could begin and the chair is localised, by reports after a stamp."""
        self.until(lambda: self._is_ready(since_ns), "the chair to be ready", _START_S)

    def _is_ready(self, since_ns: int) -> bool:
        if self.state is None or self.localisation is None or self.requests.last is None:
            return False
        fresh = min(self.state.stamp_ns, self.places.last[0], self.requests.last.scan_ns) > since_ns
        open_halts = {stop_id for stop_id, _ in self.state.halts} - _FORGIVEN
        return fresh and not open_halts and self.localisation.state is LocalisationState.OK

    def off_m(self) -> float:
        """Return the error of the estimated position now [m]."""
        assert self.localisation is not None
        assert self.really is not None
        told, true = self.localisation.map_from_base, self.really.odom_from_base
        return math.hypot(told.x - true.x, told.y - true.y)

    def ask(self, goal: Pose2) -> int:
        """Ask for a goal, and return its id once the bridge knows it."""
        assert self.client.go_to_pose(goal)
        shown = self.client.goal_id
        self.until(lambda: self.state is not None and self.state.goal_id == shown, "the goal")
        return shown

    def drive(self, ask: Callable[[], object], there: Callable[[], bool], patience_s: float = 120.0) -> None:
        """Request a drive, confirm it, and receive messages until `there` is true.

        If the drive has ended before, it is requested again, after a reset if needed: on a busy computer a late tick can
        end a drive.
        """
        self.until(lambda: not self.driving, "the end of the drive before")
        busy_s = -math.inf

        def done() -> bool:
            nonlocal busy_s
            if self.driving:
                busy_s = time.monotonic()
            elif self.waits and self.state is not None:
                self.client.confirm(10.0, goal_id=self.state.goal_id)
            elif time.monotonic() - busy_s > _AGAIN_S:
                if self.state is not None and self.state.halts:
                    self.client.reset_faults(10.0)
                ask()
                busy_s = time.monotonic()
            return there()

        self.until(done, "the drive", patience_s)

    def begin(self, goal: Pose2) -> None:
        """Request a drive by the action, confirm it, and wait until the chair moves."""
        self.drive(lambda: self.client.go_to_pose(goal, 10.0), lambda: self.driving and self.moves)

    @property
    def waits(self) -> bool:
        """Return whether a goal waits for confirmation."""
        return self.state is not None and self.state.waits

    @property
    def moves(self) -> bool:
        """Whether the chair truly moves, faster than a rider would notice."""
        return self.really is not None and abs(self.really.twist.v) > 0.15


@dataclass(frozen=True, slots=True)
class Death:
    """The result of a killed process: the time until the computer had released the lines [ms], by the simulator's
    stamps; the time until a new drive could begin [s]; and the position error then [m].

    `jitter_ms`: greatest lateness of this measuring process meanwhile.
    """

    process: str
    gone_ms: float
    back_s: float
    off_m: float
    jitter_ms: float
    resumed: bool


def kill(stack: LiveStack, name: str, how: signal.Signals = signal.SIGKILL) -> Death:
    """Kill a process of a driving stack; the simulator's death includes its board, which holds the lines."""
    pid, dead_ns = stack.pids[name], time.time_ns()
    gone = let_go_after if name == "simulator" else gone_after
    os.kill(pid, how)
    gone_ns = until_released(stack, dead_ns, gone, 5.0)
    late_ms = jitter_ms(stack, dead_ns)
    if how is signal.SIGSTOP:
        stack.spin(0.5)
        os.kill(pid, signal.SIGCONT)
    else:
        stack.until(lambda: stack.pids[name] != pid, f"another {name}")
    stack.until_ready(gone_ns)
    back_s = (time.time_ns() - dead_ns) * 1e-9
    stack.until(lambda: stack.really is not None and abs(stack.really.twist.v) < 0.01, "the chair to rest")
    stack.spin(1.0)
    held = any(lines.holder is Holder.BOARD and lines.stamp_ns > gone_ns for _, lines in stack.lines.since(dead_ns))
    return Death(name, (gone_ns - dead_ns) / 1e6, back_s, stack.off_m(), late_ms, held or stack.driving)


def held_at(stack: LiveStack, stamp_ns: int) -> bool:
    """Return whether the computer held the lines at a stamp; the simulator tells each change."""
    before: list[Lines] = [lines for _, lines in stack.lines.all if lines.stamp_ns <= stamp_ns]
    return bool(before) and before[-1].holder is Holder.BOARD


def gone_after(stack: LiveStack, dead_ns: int) -> int | None:
    """Return the first stamp from `dead_ns` on at which the computer does not hold the lines."""
    if not held_at(stack, dead_ns):
        return dead_ns
    after: list[Lines] = [lines for _, lines in stack.lines.all if lines.stamp_ns > dead_ns]
    return next((lines.stamp_ns for lines in after if lines.holder is not Holder.BOARD), None)


def until_released(
    stack: LiveStack,
    since_ns: int,
    gone: Callable[[LiveStack, int], int | None] = gone_after,
    patience_s: float = PATIENCE_S,
) -> int:
    """Receive messages until the computer has released the lines after a stamp; return the stamp of the release."""
    stack.until(lambda: gone(stack, since_ns) is not None, "the lines to be let go", patience_s)
    gone_ns = gone(stack, since_ns)
    assert gone_ns is not None
    return gone_ns


def let_go_after(stack: LiveStack, dead_ns: int) -> int | None:
    """Return the stamp of the bridge's first tick after `dead_ns` without a command."""
    after: list[DriveReport] = [state for _, state in stack.states.all if state.stamp_ns > dead_ns]
    return next((state.stamp_ns for state in after if state.command is None), None)


def jitter_ms(stack: LiveStack, since_ns: int) -> float:
    """Return the greatest lateness [ms] of the simulator's messages, which are sent every 20 ms."""
    late = [at_ns - odometry.stamp_ns for at_ns, odometry in stack.truth.since(since_ns)]
    return max(late, default=0) / 1e6
