"""The action server navigate_to_pose as Nav2's clients expect it: one goal at a time, and a new goal replaces the old.

A goal ends as succeeded, as canceled by a client, or as aborted with a code and a sentence. For planning failures the
codes are those of Nav2's planner server (nav2_msgs/action/ComputePathToPose, 200 to 208).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Protocol

import numpy as np
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.duration import Duration
from rclpy.task import Future

from waychair.errors import (
    GoalOccupied,
    GoalOutsideMap,
    MessageError,
    NoFreeSpace,
    NoPath,
    PlanningError,
    StartOccupied,
    StartOutsideMap,
    WaychairError,
)
from waychair.ros.interface_types import interface_type
from waychair.ros.messages.chair import goal_id_of
from waychair.ros.messages.motion import pose_stamped, read_pose_stamped
from waychair.ros.messages.wire import native
from waychair.ros.nodes.node import ChairNode
from waychair.ros.topics import NAVIGATE_TO_POSE
from waychair.types import Path, Pose2

NONE = 0

ERROR_CODES: Mapping[type[WaychairError], int] = MappingProxyType(
    {
        StartOutsideMap: 203,
        GoalOutsideMap: 204,
        StartOccupied: 205,
        GoalOccupied: 206,
        NoFreeSpace: 208,
        NoPath: 208,
        PlanningError: 200,
    }
)
"""Nav2's codes of planning failures, subclasses before base classes."""


def error_code(error: WaychairError) -> int:
    """Return Nav2's code of a failure; 0 if it has none."""
    return next((code for kind, code in ERROR_CODES.items() if isinstance(error, kind)), NONE)


@dataclass(frozen=True, slots=True)
class DriveFeedback:
    """The feedback to a client: the chair's pose in map, times [s], recoveries so far, and remaining distance [m]."""

    map_from_base: Pose2
    elapsed_s: float
    remaining_s: float
    recoveries: int
    distance_m: float


class GoalDriver(Protocol):
    """The interface of the action's owner. All methods are called in the executor's thread and return at once."""

    def begin(self, goal: Pose2, goal_id: int) -> None:
        """Start a drive to a pose in map, which ends the current drive. Raises `WaychairError` if it cannot start."""

    def refuse(self, reason: str) -> None:
        """Note why a goal was refused, for others than its sender."""

    def cancel(self) -> None:
        """Stop and give the goal up; call `NavigateAction.end` afterwards."""


class NavigateAction:
    """The action server. In the executor's thread, its owner calls `tell` during a drive and `end` after it."""

    def __init__(self, node: ChairNode[Any], drive: GoalDriver) -> None:
        self._node = node
        self._drive = drive
        self._type = interface_type("nav2_msgs/action/NavigateToPose")
        self._goal: tuple[ServerGoalHandle, Future] | None = None
        server = ActionServer(
            node=node,
            action_type=self._type,
            action_name=NAVIGATE_TO_POSE,
            execute_callback=self._execute,
            goal_callback=self._accept,
            cancel_callback=self._cancel,
        )
        node.at_end(server.destroy)

    @property
    def active(self) -> bool:
        """Return whether a client waits for the end of a drive."""
        return self._goal is not None

    def tell(self, progress: DriveFeedback) -> None:
        """Send feedback to the client, if there is one."""
        if self._goal is None:
            return
        feedback = self._type.Feedback()
        feedback.current_pose = native(pose_stamped(self._node.now_ns(), progress.map_from_base))
        feedback.navigation_time = Duration(seconds=progress.elapsed_s).to_msg()
        feedback.estimated_time_remaining = Duration(seconds=progress.remaining_s).to_msg()
        feedback.number_of_recoveries = progress.recoveries
        feedback.distance_remaining = float(progress.distance_m)
        self._goal[0].publish_feedback(feedback)

    def end(self, *, reached: bool, reason: str = "", code: int = NONE) -> None:
        """End the goal as succeeded if `reached`, as canceled if a client requested that, else as aborted."""
        if self._goal is None:
            return
        handle, ended = self._goal
        self._goal = None
        if reached:
            handle.succeed()
        elif handle.is_cancel_requested:
            handle.canceled()
        else:
            handle.abort()
        result = self._type.Result()
        result.error_code, result.error_msg = (NONE, "") if reached else (code, reason)
        ended.set_result(result)

    def _accept(self, goal: Any) -> GoalResponse:
        try:
            read_pose_stamped(goal.pose)
        except MessageError as error:
            self._drive.refuse(str(error))
            return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    def _cancel(self, handle: ServerGoalHandle) -> CancelResponse:
        if self._goal is None or self._goal[0] is not handle:
            return CancelResponse.REJECT
        self._node.executor.create_task(self._drive.cancel)  # runs when the goal is already marked as being canceled
        return CancelResponse.ACCEPT

    async def _execute(self, handle: ServerGoalHandle) -> Any:
        self.end(reached=False, reason="another goal was given")
        ended = Future()
        self._goal = handle, ended
        try:
            self._drive.begin(read_pose_stamped(handle.request.pose), goal_id_of(handle.goal_id))
        except WaychairError as error:
            self._drive.refuse(str(error))
            self.end(reached=False, reason=str(error), code=error_code(error))
        return await ended


def feedback(pose: Pose2, path: Path | None, elapsed_s: float, recoveries: int, max_speed: float) -> DriveFeedback:
    """Return the feedback of a drive along a path, whose remaining time is that at half the largest speed [m/s]."""
    left = remaining_distance(path, pose)
    return DriveFeedback(pose, elapsed_s, left / max(max_speed / 2, 0.05), recoveries, left)


def remaining_distance(path: Path | None, pose: Pose2) -> float:
    """Return the length [m] of a path from its point nearest to a pose."""
    if path is None or len(path.poses) < 2:
        return 0.0
    points = path.poses[:, :2]
    nearest = int(np.argmin(np.hypot(*(points - (pose.x, pose.y)).T)))
    return float(np.hypot(*np.diff(points[nearest:], axis=0).T).sum())
