"""Numbers of the guidance, with their units and reasons."""

from __future__ import annotations

import math

from waychair.control.haptics.symbols import Symbol

GAP_S = 0.40
"""s; least rest between two patterns (Niwa et al. 2009)."""

VALID_NS = 150_000_000
"""ns; a symbol that has not begun by then is not said any more."""

REPEAT_S = 2.1
"""s; while all is well, "forward" is said again after so long: a driver lets go of the stick after three seconds of silence."""

LEAST_ERROR = math.radians(1.6)
"""rad; smaller errors of the course are not corrected."""

NUDGE_SHARE = 0.55
"""An error is corrected by a nudge if it is larger than this share of one, so that the nudge makes it smaller."""

SWIVEL_FROM, SHORT_SWIVEL = math.radians(14.0), 0.6
"""rad, and share of the shortest held turn that this rider can make: farther off its course the chair turns on the spot."""

PER_MISTAKE, MOST_TOLERANT = 4.0, 2.0
"""A rider who obeys fewer symbols than most is corrected later: the tolerated error grows by so many times the missing share, at the
most to so many times itself. A nudge that is taken for something else costs more than the error that it was to correct."""

STOPPED_SWIVEL_FROM = math.radians(6.0)
"""rad; the same where the guard stops a turn at the heading that was asked for."""

OPEN_SWIVEL_FROM = math.radians(10.0)
"""rad; the same on a leg without a door: the chair is some 0.2 m beside it then, less than the room that most legs have, and a
turn on the spot costs three seconds."""

IN_VAIN, IN_VAIN_FROM = 3, math.radians(3.0)
"""Nudges in a row to one side after which the course is still so far off, rad: then the chair turns on the spot, if the guard
stops it at its heading."""

STOPPED_S = 0.5
"""s; so much later the next symbol may come where the guard stops a turn: a little late costs less than a turn cut short."""

FAR_OFF = 1.4
"""So many times farther off, the driver is turned on the spot although nudges are on their way: they do not help."""

STRAIGHT_ENOUGH = math.radians(6.0)
"""rad; a driver who stands is nudged until the course is so good, then sent ahead."""

LOOK_AHEAD = 1.2
"""m; how far ahead on the leg the driver aims."""

GATE_FROM, GATE_TO = 0.20, 0.02
"""m; distances of the chair's front from the wall between which the gate decides."""

GATE_OFFSET, GATE_TURN = 0.75, math.radians(7.0)
"""Share of the room beside the chair as it is turned, and rad to the door's axis: farther off, the chair does not pass the gate."""

LEAST_ASKEW, BESIDE_MIDDLE = math.radians(4.0), 0.4
"""rad, and share of the room beside the chair: one that would pass a door's middle farther askew aims so far beside it at the most."""

BACK_OFF = 0.85
"""m; distance of the chair's front from the wall from which the next try begins."""

SLOWEST, SLOW, PER_ROOM, TIGHT = 0.17, 0.22, 2.2, 0.08
"""Shares of the swing to hold the stick ahead in a door and before one, at least, about 0.14 and 0.22 m/s; more by so much for each
metre of room beside the chair: a nudge comes a second late, and the drift of that second has to fit. In a door that leaves less
room [m] than the last the chair is slowed down by its error as well."""

HELD_FROM = math.radians(0.8)
"""rad; nearer to the right course a hand's drift to neither side is passed on, farther off only one towards the course."""

DRIFT, ALL = 0.2, 1.0
"""Shares of the swing: a hand drifts by less than the first, a larger turn is meant; every turn is smaller than the second."""

PUSHED = 0.1
"""Share of the swing; a smaller push of the stick makes hardly any motion, and is no answer."""

HOLDS_S = 0.25
"""s from a cap of the stick until the chair turns by it: the board, and the motors' own lag."""

CREEPS = 0.12
"""Share of the swing, about 0.05 m/s: so slowly a driver who is not straight drives on at a door, and nudges outrun the drift."""

SHUFFLE = 0.3
"""m; way straight back or ahead when the chair cannot turn on."""

MOST_TRIES, OPEN_TRIES = 12, 2
"""Tries at one door, and shuffles at one turn, before the guide asks for other steps; and tries where other ways are likely, on a leg
without a door: two, because somebody in the way may have walked on by the second."""

ASTRAY, ASTRAY_AT_GOAL = 0.5, 0.35
"""m; farther beside a leg, or beside the one to the goal, new steps are wanted."""

MISSED = 0.3
"""m; a driver who has come to rest farther from the steps' end is led on: a place counts up to 0.5 m, and both end and pose are a little off."""

STILL_V, STILL_OMEGA = 0.03, 0.05
"""m/s, rad/s; below these the chair stands."""

OBEYED_S, STUCK_S = 0.6, 2.5
"""s beyond the lag: without an effect by the first, a symbol is said again; by the second, something is in the way."""

IGNORED, QUIET_S = 4, 4.0
"""Symbols without any effect, after which the rider has a reason: the guide is silent for so many seconds."""

SWIVELS = (Symbol.SWIVEL_LEFT, Symbol.SWIVEL_RIGHT)
NUDGES = (Symbol.NUDGE_LEFT, Symbol.NUDGE_RIGHT)

ABOUT = math.radians(150.0)
"""rad; from here on a turn may go either way round: the side that was said counts, and before that the plan's."""

NUDGED_S, NUDGING_S = 0.35, 0.5
"""s; a nudge is done so long after its effect began, and its turn is spread over the second."""

EARLY_S = 0.35
"""s; some drivers react so much sooner than their mean."""

STOPS_SHORT = math.radians(1.5)
"""rad; a turn ends within half a tick of this."""

SPEEDS_UP_S, SETTLES_S = 0.7, 0.35
"""s after a symbol is obeyed: a turn has its full rate, and has come to rest."""

STRAIGHTENS_S = 9.0
"""s; a driver who is still not straight after so long backs off."""

PASSED = math.radians(60.0)
"""rad; a turn that is so near but leads away has passed its heading."""

SHORTEST_SWIVEL_S = 0.85
"""s; two patterns cannot follow each other sooner, so no held turn is shorter."""

NEAR_END = 0.05
"""m; the end of a leg is reached within this."""

KEEPS_WAITING_S = 0.85
"""s; for so long a symbol keeps the next one waiting."""

AIM_PART, AIM_TICKS = 0.12, 6
"""Share by which a tick's aim counts, about 0.4 s, and ticks without which there is no verdict."""

SWIVELLING = 0.25
"""rad/s; a chair that turns so fast while it should drive straight is still swivelling."""

TURN_BEFORE_WALL = 0.15
"""m; nearer to the wall the front does not swing."""

IN_DOOR = 0.3
"""m; so far beyond the wall's face the chair is aimed along the axis, no longer at the middle."""

LEAST_AIM = 0.5
"""m; a nearer point is no aim."""

SLOW_BEFORE = 1.0
"""m before the pivot of a door the driver is slowed down."""

BEHIND_START = 0.15
"""m; a driver is not sent back farther behind the start of a leg where no guard holds the stick: behind it the steps are not known to
be free."""

BACK_FROM_THINGS = 0.4
"""m; way back from something in the way."""
