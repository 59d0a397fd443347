"""Journeys over the storeys of the navigator's building, for clients of the action, the topic and the services.

| takes | |
|---|---|
| the action travel, the topic storey_goal | the goal; the rider's `confirm` of the first drive begins the journey |
| imu/data, pressure | the rides |
| lift_states | the word of the lifts' adapters |
| the service say_storey | the rider's word for the storey |
| beacon | the id of a beacon that the chair has met, which tells the storey |
| camera/... | AprilTags that are beacons: they tell the storey, and set or confirm the place |

| sends | |
|---|---|
| journey | the state of the journey, at each change; latched |
| lift_requests | calls, and open doors |
| initialpose | the place by a tag, of a chair that is not certain of it |

A journey that was under way when its node was killed is over. If the chair was in a lift then, no drive begins until somebody
has said which storey it is on; nor if it is in a lift without a journey, and the door is not seen open.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rclpy.action import ActionServer, CancelResponse
from rclpy.task import Future

from waychair.calibration.chair_body import ChairBody
from waychair.control.journey.door_view import SHUT_IN
from waychair.control.journey.journey import DOUBTED, JourneyPhase
from waychair.errors import BuildingError, WaychairError
from waychair.planning.building.beacon_places import storey_of_beacon
from waychair.ros import topics
from waychair.ros.interface_types import interface_type
from waychair.ros.messages.floor import Floor, JourneyReport, StoreyGoal, journey_state, read_storey_goal
from waychair.ros.messages.motion import pose_with_covariance
from waychair.ros.messages.sensors import read_imu, read_pressure
from waychair.ros.messages.wire import native, plain
from waychair.ros.nodes.navigator_parts.cabin_watch import CabinWatch
from waychair.ros.nodes.navigator_parts.lift_adapter import LiftAdapter
from waychair.ros.nodes.navigator_parts.remote_chair import LegDriver, RemoteChair
from waychair.ros.nodes.node import ChairNode
from waychair.ros.nodes.parts.journey_plan import (
    JourneyPlan,
    known_building,
    planned,
    start_named,
    storey_id,
    storey_named,
)
from waychair.ros.nodes.parts.tag_reader import TagReader
from waychair.ros.nodes.worker import Worker
from waychair.runtime.drive_base import ChairMessage
from waychair.runtime.journeys import Traveller, TravelState
from waychair.runtime.tag_watch import TagWatch, TagWord
from waychair.types import Pose2, Scan

STARTS_WITHIN_S = 3.0
"""s; a first drive that neither waits nor drives by then was refused."""


@dataclass(slots=True)
class _Journey:
    """A journey that waits for the rider's yes, or is under way."""

    plan: JourneyPlan
    chair: RemoteChair
    traveller: Traveller
    asked_ns: int
    messages: list[ChairMessage] = field(default_factory=list)


class Journeys:
    """The journeys of a navigator's node, which calls `step` in each tick and `hear` with each scan."""

    def __init__(self, node: ChairNode[Any], driver: LegDriver, body: ChairBody) -> None:
        self._node, self._driver, self._body = node, driver, body
        self._worker = Worker(node)
        self._now: _Journey | None = None
        self._lifts = LiftAdapter(node)
        self._cabins = CabinWatch(driver, body.base_from_laser, self._worker)
        self._client: tuple[Any, Future] | None = None
        """The action's goal handle and its result, while a client waits."""
        self._report = JourneyReport(0)
        self._send: Callable[[Any], None] = node.publisher(topics.JOURNEY)
        self._type = interface_type("waychair_msgs/action/Travel")
        server = ActionServer(
            node=node,
            action_type=self._type,
            action_name=topics.TRAVEL,
            execute_callback=self._execute,
            cancel_callback=self._cancel_by_client,
        )
        node.at_end(server.destroy)
        node.at_end(self._worker.close)
        node.listen(topics.STOREY_GOAL, read_storey_goal, self._take_goal, needed=False)
        node.listen(topics.IMU, read_imu, self._hear_imu, needed=False)
        self._tag_watch, self._send_pose = TagWatch(), node.publisher(topics.INITIAL_POSE)
        self.tags = TagReader(node, body.base_from_camera, self._where, self.meet_tags)
        """Reads the camera's pictures, which the navigator's node shows it."""
        self._beacon = "", "", ""
        """The beacon met last, the map folder then, and the beacon's storey."""
        node.listen(topics.BEACON, lambda message: str(message.data), self._meet_beacon, needed=False)
        node.listen(topics.PRESSURE, read_pressure, self.hear, needed=False)
        node.listen(topics.PAGE_WATCH, lambda message: message, lambda message: self._saw_page(), needed=False)
        node.create_service(interface_type("waychair_msgs/srv/SayStorey"), "say_storey", self._answer_storey)

    @property
    def active(self) -> bool:
        """Whether a journey waits for the rider's yes, or is under way or held."""
        return self._now is not None

    def make_way(self) -> None:
        """Give the present journey up for another goal.

        Raises:
            BuildingError: the chair is in a lift, so that its storey is not certain.
        """
        if self._now is not None and self._now.traveller.aboard:
            raise BuildingError("the chair is in a lift: cancel the journey, or wait until the storey is certain")
        if self._now is not None:
            self._end("another goal was given")

    def cancel(self) -> None:
        """Cancel the journey; in a car the storey is still found out."""
        if self._now is not None and not self._now.traveller.aboard:
            self._end("the journey was cancelled: choose a goal to drive on")
        elif self._now is not None:
            self._now.traveller.cancel(self._node.now_ns())

    def pause(self) -> bool:
        """Hold the journey; return whether there is one."""
        return self._now is not None and self._now.traveller.journey is not None and self._now.traveller.pause()

    def go_on(self) -> bool:
        """Continue a journey that was held; return whether there is one."""
        return self._now is not None and self._now.traveller.go_on(self._node.now_ns())

    def hear(self, message: ChairMessage) -> None:
        """Take in a scan or a sample of the IMU, for the next step."""
        if self._now is not None:
            self._now.messages.append(message)
        if isinstance(message, Scan) and (self._now is None or self._now.traveller.journey is None):
            self._cabins.look(message)

    def step(self) -> None:
        """Make one step of the journey, if there is one."""
        journey = self._now
        if (journey is None or journey.traveller.journey is None) and self._cabins.doubts(self._driver.now()):
            self._doubt("the chair is in a lift whose door is not open, so that its storey is not certain")
        if journey is None:
            return
        messages, journey.messages = tuple(journey.messages), []
        if journey.traveller.journey is None:
            self._wait_for_yes(journey)
            return
        state = journey.traveller.step(journey.chair.stamp_ns, messages)
        self._tell(journey, state)
        floor = self._driver.now().floor
        if not (journey.traveller.aboard or journey.chair.changes_floor or floor is None or floor.certain):
            self._end(DOUBTED)
            return
        if state.journey is not None and state.journey.ended:
            arrived = state.journey.phase is JourneyPhase.ARRIVED
            self._end("the chair has arrived" if arrived else state.journey.why, arrived=arrived)

    def _wait_for_yes(self, journey: _Journey) -> None:
        """Begin the journey once the rider has confirmed its first drive; give it up if that drive is over."""
        now = self._driver.now()
        if journey.chair.waits:
            journey.traveller.go(journey.plan.legs, now.stamp_ns)
            return
        state = now.state
        over = (
            state is None or state.goal_id != journey.chair.goal_id or state.drops_goal or now.goal_id != state.goal_id
        )
        if over and (now.stamp_ns - journey.asked_ns) * 1e-9 > STARTS_WITHIN_S:
            why = now.navigation.reason or "the bridge did not take the drive"
            self._end(f"the journey to {journey.plan.goal} did not begin: {journey.chair.failed or why}")

    def _take_goal(self, goal: StoreyGoal) -> None:
        self._ask(goal)

    def _ask(self, goal: StoreyGoal) -> None:
        """Plan a journey in the worker, then ask for its first drive."""
        now = self._driver.now()
        try:
            self.make_way()
            if now.floor is None or now.map_from_base is None:
                raise BuildingError("the chair is not localised: wait until it is, then ask for the goal again")
            if not now.floor.certain:
                raise BuildingError("the storey is not certain: say which one it is by waychair storey NAME")
        except WaychairError as error:
            self._refuse(str(error))
            return
        folder, pose = Path(now.floor.map_folder), now.map_from_base

        def plan() -> JourneyPlan | str:
            try:
                return planned(folder, pose, self._body, goal)
            except WaychairError as error:
                return str(error)

        self._worker.submit(plan, self._begin)

    def _begin(self, plan: JourneyPlan | str) -> None:
        """Ask for the first drive of a planned journey, which waits for the rider's yes."""
        if isinstance(plan, str):
            self._refuse(plan)
            return
        chair = RemoteChair(self._node, self._driver, plan.folders)
        traveller = Traveller(
            chair, self._body, plan.maps, plan.sites, self._lifts, plan.storey, unmapped=plan.unmapped
        )
        now_ns = self._node.now_ns()
        self._now = _Journey(plan, chair, traveller, now_ns)
        chair.go(plan.legs[0].goal)
        self._publish(JourneyReport(now_ns, plan.goal, "asked", f"press Drive to go to {plan.goal}", plan.storey))

    def _tell(self, journey: _Journey, state: TravelState) -> None:
        assert state.journey is not None
        title, order = str(state.journey.phase), state.order
        self._publish(
            JourneyReport(state.chair.stamp_ns, journey.plan.goal, title, order.sentence, state.storey, order.ask)
        )

    def _publish(self, report: JourneyReport) -> None:
        """Publish the state if it has changed."""
        before, self._report = self._report, report
        if (before.goal, before.phase, before.sentence, before.storey, before.asks) == (
            (report.goal, report.phase, report.sentence, report.storey, report.asks)
        ):
            return
        self._send(journey_state(report))
        if self._client is not None:
            feedback = self._type.Feedback()
            feedback.state = native(journey_state(report))
            self._client[0].publish_feedback(feedback)

    def _refuse(self, why: str) -> None:
        self._node.get_logger().error(f"a journey was refused: {why}")
        self._publish(JourneyReport(self._node.now_ns(), phase="refused", sentence=why))
        self._finish(why, arrived=False)

    def _end(self, why: str, *, arrived: bool = False) -> None:
        """End the journey, and tell its sender."""
        journey, self._now = self._now, None
        assert journey is not None
        if not arrived:
            journey.chair.cancel()
        self._lifts.end_all()
        journey.chair.close()
        phase = JourneyPhase.ARRIVED if arrived else JourneyPhase.FAILED
        storey = journey.traveller.storey
        self._publish(JourneyReport(self._node.now_ns(), journey.plan.goal, str(phase), why, storey))
        self._finish(why, arrived=arrived)

    def _finish(self, why: str, *, arrived: bool) -> None:
        if self._client is None:
            return
        (handle, ended), self._client = self._client, None
        if arrived:
            handle.succeed()
        elif handle.is_cancel_requested:
            handle.canceled()
        else:
            handle.abort()
        ended.set_result(self._type.Result(arrived=arrived, message=why))

    async def _execute(self, handle: Any) -> Any:
        self._finish("another goal was given", arrived=False)
        ended = Future()
        self._client = handle, ended
        self._ask(read_storey_goal(plain(handle.request.goal)))
        return await ended

    def _cancel_by_client(self, handle: Any) -> CancelResponse:
        if self._client is None or self._client[0] is not handle:
            return CancelResponse.REJECT
        self._node.executor.create_task(self.cancel)
        return CancelResponse.ACCEPT

    def _hear_imu(self, sample: Any) -> None:
        self.hear(sample)

    def _meet_beacon(self, beacon: str) -> None:
        """Take the storey of a beacon: as evidence in a lift, else as the chair's storey; a drive on another map ends."""
        now = self._driver.now()
        if now.floor is None:
            return
        try:
            if self._beacon[:2] != (beacon, now.floor.map_folder):
                building, _ = known_building(Path(now.floor.map_folder))
                self._beacon = beacon, now.floor.map_folder, storey_of_beacon(building.hgraph, beacon)
            self._meet(beacon, self._beacon[2], now.floor)
        except WaychairError as error:
            self._node.get_logger().warning(str(error), throttle_duration_sec=60.0)

    def _meet(self, beacon: str, storey: str, floor: Floor) -> None:
        """Take the storey of a beacon; see `_meet_beacon`.

        Raises:
            BuildingError: the storey has no map, or the chair is on its way.
        """
        state = self._driver.now().state
        if self._now is not None and self._now.traveller.aboard:
            self._now.traveller.met_beacon(storey)
        elif storey != floor.storey and (self._now is not None or (state is not None and state.driving)):
            self.cancel()
            self._driver.cancel_leg()
            self._doubt(f"beacon '{beacon}' is on storey '{storey}', and the chair drove on the map of another")
        elif storey != floor.storey or not floor.certain:
            self._node.get_logger().info(self._say_storey(storey))

    def _where(self) -> tuple[str, Pose2] | None:
        """Return the folder of the map in use and the chair in odom."""
        now = self._driver.now()
        if now.floor is None or not now.floor.map_folder or now.odom_from_base is None:
            return None
        return now.floor.map_folder, now.odom_from_base

    def meet_tags(self, words: tuple[TagWord, ...], odom_from_base: Pose2) -> None:
        """Take the words of AprilTags in a picture: the storey as of a beacon, then the place on it."""
        now = self._driver.now()
        floor = now.floor
        if floor is None:
            return
        for word in words:
            try:
                self._meet(word.beacon, word.storey, floor)
            except WaychairError as error:
                self._node.get_logger().warning(str(error), throttle_duration_sec=60.0)
        if not floor.certain or any(word.storey != floor.storey for word in words):
            self._tag_watch.forget()  # of another map than the present one
            return
        pose = self._tag_watch.place(words, odom_from_base, now.localisation, now.stamp_ns)
        if pose is not None and now.odom_from_base is not None:
            here = pose @ odom_from_base.inverse() @ now.odom_from_base  # the chair may have moved since the picture
            self._node.get_logger().warning("the chair localises itself where a tag says that it is")
            self._send_pose(pose_with_covariance(now.stamp_ns, here))

    def _doubt(self, why: str) -> None:
        """Let no drive begin until somebody, or a beacon at rest, has said the storey."""
        self._node.get_logger().error(why)
        chair = RemoteChair(self._node, self._driver, {})
        chair.doubt_storey(certain=False)
        self._node.executor.create_task(chair.close)

    def _saw_page(self) -> None:
        if self._now is not None:
            self._now.chair.seen_page()

    def _answer_storey(self, request: Any, response: Any) -> Any:
        """Serve waychair_msgs/srv/SayStorey."""
        try:
            response.message = self._say_storey(str(request.storey), str(request.place))
            response.success = True
        except WaychairError as error:
            response.success, response.message = False, str(error)
        return response

    def _say_storey(self, name: str, place: str = "") -> str:
        """Take the rider's word for the storey, and the place: of a journey that asks, else for all nodes.

        Raises:
            BuildingError: there is no such storey or place, the chair drives or is in a lift with its door shut, or a journey
                is under way.
        """
        now = self._driver.now()
        if now.floor is None:
            raise BuildingError("the chair has no map yet: wait for the mapper")
        building, _ = known_building(Path(now.floor.map_folder))
        journey = self._now
        if journey is not None and journey.traveller.aboard:
            if place:
                raise BuildingError("the chair is in a lift: say the storey at which it stands")
            storey = storey_id(building, name)
            journey.traveller.answer(storey, now.stamp_ns)
            return f"the chair takes {storey} as its storey, if the ride does not contradict it"
        if journey is not None or (now.state is not None and now.state.driving):
            raise BuildingError("the chair is on its way: cancel the drive first, then say the storey")
        if self._cabins.shut_in:
            raise BuildingError(SHUT_IN)
        pose = None
        if place:
            storey, folder, pose = start_named(building, StoreyGoal(place, name))
        else:
            storey, folder = storey_named(building, name)
            pose = self._cabins.pose_on(storey)
        chair = RemoteChair(self._node, self._driver, {storey: str(folder.resolve())})
        chair.change_storey(storey, None, pose)
        self._node.executor.create_task(chair.close)
        if place:
            looks = f"localises itself at {place}"
        else:
            looks = "looks for its place there" if pose is None else "knows its place"
        return f"the chair takes the map of {storey}, and {looks}"
