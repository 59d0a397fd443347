"""Every failure a caller can act on has a name, under one root.

A message says what happened, with the value, and what to do about it. The command line prints it as one sentence.
"""

from __future__ import annotations


class WaychairError(Exception):
    """Root of all errors that waychair raises on purpose."""


class ConfigError(WaychairError):
    """A configuration file or value is impossible or unknown."""


class MissingExtra(WaychairError):
    """A part of waychair that was not installed is needed."""


class RecordingError(WaychairError):
    """A recording cannot be read or written."""


class RecordingNotFound(RecordingError):
    """There is no recording at this path."""


class RecordingDamaged(RecordingError):
    """The recording is empty, truncated or not of a known format."""


class NoScans(RecordingError):
    """The recording holds no laser scans, so no map can be made of it."""


class NoPictures(RecordingError):
    """The recording holds no pictures with depth in which anything can be seen."""


class MapError(WaychairError):
    """A map folder, image or YAML cannot be read or written."""


class SessionError(MapError):
    """A drive cannot be joined to a map of earlier ones."""


class MapNotFound(MapError):
    """There is no map at this path."""


class GraphError(WaychairError):
    """A pose graph cannot be read or solved."""


class PlaceError(WaychairError):
    """A list of named places is broken."""


class UnknownPlace(PlaceError):
    """No place has this name."""


class ZoneError(WaychairError):
    """A list of zones is broken."""


class WorldError(WaychairError):
    """A simulated world's file is broken."""


class WorkerLost(WaychairError):
    """A process that shared the work was ended by somebody else."""


class CalibrationError(WaychairError):
    """A calibration cannot be used."""


class ThinData(CalibrationError):
    """Too little was measured to calibrate from."""


class NotMonotone(CalibrationError):
    """More stick gives less speed, which no inverse can undo."""


class NotRepeatable(CalibrationError):
    """The chair answered the same stick differently at the beginning and at the end."""


class CalibrationMismatch(CalibrationError):
    """The calibration belongs to another chair."""


class CalibrationDamaged(CalibrationError):
    """The calibration file was altered, is broken, or is of an unknown schema."""


class BridgeError(WaychairError):
    """The board that holds the joystick lines cannot be used."""


class TransportError(BridgeError):
    """The cable to the board cannot be opened or was lost."""


class BoardBuildError(BridgeError):
    """The firmware cannot be built or started on this computer."""


class PlanningError(WaychairError):
    """No path can be given."""


class StartOutsideMap(PlanningError):
    """The start lies outside the map."""


class StartOccupied(PlanningError):
    """The chair does not fit where it stands."""


class GoalOutsideMap(PlanningError):
    """The goal lies outside the map."""


class GoalOccupied(PlanningError):
    """The chair does not fit at the goal."""


class GoalTooExact(PlanningError):
    """A goal's tolerances are closer than a chair can stop."""


class NoFreeSpace(PlanningError):
    """The map has no room for the chair anywhere."""


class NoPath(PlanningError):
    """Start and goal are not connected by free space wide enough for the chair."""


class MapTooLarge(PlanningError):
    """The map has more cells than a planner may take memory for."""


class NotConverged(PlanningError):
    """A field was not computed exactly enough in the work or the time allowed."""


class OutputError(WaychairError):
    """A result cannot be written where it was asked for."""


class DriverSilent(WaychairError):
    """What drives a simulated chair has not answered in time."""


class LongTermError(WaychairError):
    """The file of the long-term memory cannot be read or written."""


class LongTermDamaged(LongTermError):
    """A record of the long-term memory is not what was written."""


class VocabularyError(WaychairError):
    """A dictionary of visual words is broken, or is of another kind than the features."""


class SensorError(WaychairError):
    """Messages of a sensor do not go together."""


class BoxError(WaychairError):
    """A black box cannot be read, or there is nothing in it to explain."""


class RosError(WaychairError):
    """The ROS side of a chair cannot be used."""


class InterfaceBuildError(RosError):
    """Definitions of ROS messages cannot be generated or compiled on this computer."""


class MessageError(RosError):
    """A ROS message says something impossible, or comes in a form that is not understood."""
