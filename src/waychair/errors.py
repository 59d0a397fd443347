"""Exceptions: one class for each failure that a caller can act on, all under one root.

A message states the cause, the value and the remedy. The command line prints it as one sentence.
"""

from __future__ import annotations


class WaychairError(Exception):
    """Root of all errors that waychair raises on purpose."""


class ConfigError(WaychairError):
    """A configuration file or value is impossible or unknown."""


class MissingExtra(WaychairError):
    """An optional part of waychair (an extra) is needed but not installed."""


class RecordingError(WaychairError):
    """A recording cannot be read or written."""


class RecordingNotFound(RecordingError):
    """There is no recording at this path."""


class RecordingDamaged(RecordingError):
    """The recording is empty, truncated or not of a known format."""


class RecordingUnknown(RecordingDamaged):
    """The file is of another kind than the recordings that can be read."""


class NoScans(RecordingError):
    """The recording holds no laser scans, so no map can be made from it."""


class NoPictures(RecordingError):
    """The recording holds no usable pictures with depth."""


class MapError(WaychairError):
    """A map folder, image or YAML cannot be read or written."""


class SessionError(MapError):
    """A drive cannot be joined to a map of earlier drives."""


class GridTooLarge(MapError):
    """A map in the making would have more cells than can be planned on."""


class MapNotFound(MapError):
    """There is no map at this path."""


class GraphError(WaychairError):
    """A pose graph cannot be read or solved."""


class PlaceError(WaychairError):
    """A list of named places is invalid."""


class UnknownPlace(PlaceError):
    """No place has this name."""


class BuildingError(WaychairError):
    """A building's graph, its text files or its tables cannot be read, written or used."""


class BuildingNotFound(BuildingError):
    """There is no building at this path."""


class ZoneError(WaychairError):
    """A list of zones is invalid."""


class TrafficError(WaychairError):
    """A traffic graph or floor plan is impossible, damaged or cannot be made."""


class VdaError(WaychairError):
    """A message of VDA 5050 cannot be followed, or its broker cannot be reached."""


class WorldError(WaychairError):
    """A simulated world's file is invalid."""


class WorkerLost(WaychairError):
    """A worker process was killed from outside."""


class ClusterError(WaychairError):
    """A cluster of computers cannot be reached, or went away."""


class NotAllMapped(WaychairError):
    """Some of many recordings could not be mapped; all others are."""


class CalibrationError(WaychairError):
    """A calibration cannot be used."""


class ThinData(CalibrationError):
    """Too little was measured to calibrate from."""


class NotMonotone(CalibrationError):
    """More stick gives less speed, so the curve has no inverse."""


class NotRepeatable(CalibrationError):
    """The chair responded differently to the same stick at the beginning and at the end."""


class CalibrationMismatch(CalibrationError):
    """The calibration belongs to another chair."""


class CalibrationDamaged(CalibrationError):
    """The calibration file was altered, is invalid, or has an unknown schema."""


class BridgeError(WaychairError):
    """The board that drives the joystick lines cannot be used."""


class TransportError(BridgeError):
    """The connection to the board cannot be opened or was lost."""


class BoardBuildError(BridgeError):
    """The firmware cannot be built or started on this computer."""


class PlanningError(WaychairError):
    """No path can be planned."""


class StartOutsideMap(PlanningError):
    """The start lies outside the map."""


class StartOccupied(PlanningError):
    """The chair does not fit where it stands."""


class GoalOutsideMap(PlanningError):
    """The goal lies outside the map."""


class GoalOccupied(PlanningError):
    """The chair does not fit at the goal."""


class GoalTooExact(PlanningError):
    """A goal's tolerances are smaller than a chair's stopping accuracy."""


class NoFreeSpace(PlanningError):
    """The map has no room for the chair anywhere."""


class NoPath(PlanningError):
    """Start and goal are not connected by free space wide enough for the chair.

    `place` [m, m] in map is where the whole chair does not fit on a way that is wide enough.
    """

    def __init__(self, message: str, place: tuple[float, float] | None = None) -> None:
        super().__init__(message)
        self.place = place


class MapTooLarge(PlanningError):
    """The map has more cells than a planner may allocate memory for."""


class NotConverged(PlanningError):
    """A potential field did not reach its accuracy within the allowed iterations or time."""


class TaskError(PlanningError):
    """The starts or goals of several agents contradict each other."""


class FleetError(WaychairError):
    """The network of several chairs cannot be joined: its file, its keys or its endpoints are wrong."""


class OutputError(WaychairError):
    """A result cannot be written to the requested path."""


class DriverSilent(WaychairError):
    """The controller of a simulated chair has not answered in time."""


class LongTermError(WaychairError):
    """The file of the long-term memory cannot be read or written."""


class LongTermDamaged(LongTermError):
    """A record of the long-term memory fails its check."""


class VocabularyError(WaychairError):
    """A visual vocabulary is invalid, or was made for another kind of features."""


class SensorError(WaychairError):
    """Messages of a sensor contradict each other."""


class JoystickError(WaychairError):
    """A joystick of this computer cannot be opened, or was unplugged."""


class SessionLogError(WaychairError):
    """The record of guided drives for a trainer cannot be read."""


class LearntError(WaychairError):
    """The file of what was learnt of a rider cannot be read."""


class HabitsError(WaychairError):
    """The record of the rider's habits cannot be read."""


class BoxError(WaychairError):
    """A black box cannot be read or written, or holds no stop to explain."""


class RosError(WaychairError):
    """The ROS side of a chair cannot be used."""


class InterfaceBuildError(RosError):
    """ROS message definitions cannot be generated or compiled on this computer."""


class MessageError(RosError):
    """A ROS message holds impossible values or has an unknown format."""


class BehaviourError(WaychairError):
    """A network of behaviour cells cannot be run."""


class WiringError(BehaviourError):
    """A network of behaviour cells is wired in an impossible way."""


class TraceError(BehaviourError):
    """A trace of a network of behaviour cells cannot be read or replayed."""


class GloveError(WaychairError):
    """The vibrating glove cannot be used, or is described in an impossible way."""


class PatternError(WaychairError):
    """Patterns of vibration are impossible, or cannot be told apart by touch."""
