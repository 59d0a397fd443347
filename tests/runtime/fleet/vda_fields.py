"""The fields of VDA 5050 3.0.0 as its schemas list them, and a check of JSON against them.

A line is an object: its name, then its fields; `!` after a field: required; after a colon its type: s, i, n, b, a list
`[...]`, another object's name, or an enumeration of words.
"""

from __future__ import annotations

from typing import Any

_HEADER = "headerId!:i timestamp!:s version!:s manufacturer!:s serialNumber!:s"

FIELDS = f"""
connection {_HEADER} connectionState!:ONLINE|OFFLINE|HIBERNATING|CONNECTION_BROKEN
state {_HEADER} maps:[map] zoneSets:[zoneSet] orderId!:s orderUpdateId!:i lastNodeId!:s lastNodeSequenceId!:i nodeStates!:[nodeState] edgeStates!:[edgeState] plannedPath:any intermediatePath:any mobileRobotPosition:position velocity:velocity loads:any driving!:b paused:b newBaseRequest:b zoneRequests:[zoneRequest] edgeRequests:any distanceSinceLastNode:n actionStates!:[actionState] instantActionStates!:[actionState] zoneActionStates:[actionState] powerSupply!:powerSupply operatingMode!:STARTUP|AUTOMATIC|SEMIAUTOMATIC|INTERVENED|MANUAL|SERVICE|TEACH_IN errors!:[error] information:[info] safetyState!:safetyState
nodeState nodeId!:s sequenceId!:i nodeDescriptor:s released!:b nodePosition:any
edgeState edgeId!:s sequenceId!:i edgeDescriptor:s released!:b trajectory:any
position x!:n y!:n theta!:n mapId!:s localized!:b localizationScore:n deviationRange:n
velocity vx:n vy:n omega:n
zoneRequest requestId!:s requestType!:ACCESS|REPLANNING zoneId!:s zoneSetId!:s requestStatus!:REQUESTED|GRANTED|REVOKED|EXPIRED trajectory:any
actionState actionId!:s actionType:s actionDescriptor:s actionStatus!:WAITING|INITIALIZING|RUNNING|PAUSED|RETRIABLE|FINISHED|FAILED actionResult:s
powerSupply stateOfCharge!:n batteryVoltage:n batteryCurrent:n batteryHealth:n charging!:b range:n
error errorType!:s errorReferences:[reference] errorDescription:s errorDescriptionTranslations:any errorHint:s errorHintTranslations:any errorLevel!:WARNING|URGENT|CRITICAL|FATAL
reference referenceKey!:s referenceValue!:s
info infoType!:s infoReferences:[reference] infoDescriptor:s infoLevel!:INFO|DEBUG
safetyState activeEmergencyStop!:MANUAL|REMOTE|NONE fieldViolation!:b
factsheet {_HEADER} typeSpecification!:type physicalParameters!:physical protocolLimits!:limits protocolFeatures!:features mobileRobotGeometry!:geometry loadSpecification!:loadSpecification mobileRobotConfiguration:any
type seriesName!:s seriesDescription:s mobileRobotKinematics:s mobileRobotClass!:s maximumLoadMass!:n localizationTypes!:[s] navigationTypes!:[s] supportedZones:[s]
physical minimumSpeed!:n maximumSpeed!:n minimumAngularSpeed:n maximumAngularSpeed:n maximumAcceleration!:n maximumDeceleration!:n minimumHeight!:n maximumHeight!:n width!:n length!:n
limits maximumStringLengths!:any maximumArrayLengths!:any timing!:timing
timing minimumOrderInterval!:n minimumStateInterval!:n defaultStateInterval:n visualizationInterval:n
features optionalParameters!:[any] mobileRobotActions!:[any]
geometry wheelDefinitions:any envelopes2d:[envelope] envelopes3d:any
envelope envelope2dId!:s vertices!:[vertex] description:s
vertex x!:n y!:n
loadSpecification loadPositions:[s] loadSets:any
"""

_OBJECTS = {words[0]: words[1:] for line in FIELDS.strip().splitlines() if (words := line.split())}
_TYPES: dict[str, tuple[type, ...]] = {"s": (str,), "i": (int,), "n": (int, float), "b": (bool,)}


def faults(name: str, values: Any) -> list[str]:
    """Return what in a message, or a part of it, is not as the standard lists it."""
    if not isinstance(values, dict):
        return [f"{name} is no object"]
    found, known = [], set()
    for word in _OBJECTS[name]:
        field, _, kind = word.partition(":")
        required, field = field.endswith("!"), field.rstrip("!")
        known.add(field)
        if field in values:
            found += [f"{name}.{field}: {fault}" for fault in _kind_faults(kind, values[field])]
        elif required:
            found.append(f"{name}.{field} is missing")
    return found + [f"{name}.{field} is unknown" for field in sorted(set(values) - known)]


def _kind_faults(kind: str, value: Any) -> list[str]:
    if kind == "any":
        return []
    if kind.startswith("["):
        if not isinstance(value, list):
            return ["is no list"]
        return [fault for each in value for fault in _kind_faults(kind[1:-1], each)]
    if kind in _TYPES:
        right = isinstance(value, _TYPES[kind]) and (kind == "b") == isinstance(value, bool)
        return [] if right else [f"{value!r} is not of type {kind}"]
    if kind in _OBJECTS:
        return faults(kind, value)
    return [] if value in kind.split("|") else [f"{value!r} is none of {kind}"]
