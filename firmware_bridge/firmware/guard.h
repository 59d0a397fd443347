/* The guard: caps for each direction of the rider's own stick, by which the board copies it to the lines.
 *
 * A deflection is clamped, not scaled: it is never enlarged, never changes its sign, and a small one stays as it is. A
 * cap falls at once and rises slowly, so that nothing lurches when an obstacle steps aside. The rider overrides a cap
 * by a long push, except where the computer says that there is a drop-off. No heap, no float, no clock. */
#ifndef WAYCHAIR_GUARD_H
#define WAYCHAIR_GUARD_H

#include <stdbool.h>
#include <stdint.h>

#include "axes.h"

enum {
    RISE_MS = 500,                 /* least time in which a cap rises from none to the full swing */
    PUSH_PER_MILLE = 900,          /* of the swing: the stick is held hard beyond this */
    PUSH_MS = 2000,                /* held hard against a cap for so long, the rider means it */
    WARNING_MS = 500,              /* and is warned for so long: a pattern of 250 ms, and the time to let go */
    OVERRIDE_MS = 10000,           /* then the chair creeps for at most so long, while the stick is held */
    CREEP_CAP_DRIVE = 1100,        /* of SETPOINT_MAX: a touch is no faster than 0.1 m/s. 132 mV, of which the dead band takes 94
                                      (0.05 m/s at 1.33 mm/s per mV) or, of the liveliest chair of the make, 71 (0.09 m/s at 1.43) */
    CREEP_CAP_TURN = 1000          /* the same for the farthest corner of a turning chair: 120 mV, 0.05 m/s there or, of the liveliest
                                      chair, 0.10 m/s */
};

/* How the guard acts on the stick now, as bits of the telemetry. */
enum {
    GUARD_CAPPED = 1 << 0,         /* a cap holds the stick back */
    GUARD_WARNS = 1 << 1,          /* an override is about to begin */
    GUARD_OVERRIDDEN = 1 << 2,     /* the rider creeps against a cap */
    GUARD_LOST = 1 << 3            /* the computer is lost: the caps stay until the stick was at rest */
};

typedef struct {
    int32_t caps[DIRECTIONS];      /* in force, of SETPOINT_MAX */
    int32_t asked[DIRECTIONS];     /* by the computer */
    uint8_t hard;                  /* a bit for each direction: no override */
    uint32_t pushed_ms[DIRECTIONS];/* for so long the stick has been held hard against the cap */
    uint8_t bits;
} guard;

/* Starts with every cap at none. */
void guard_begin(guard *self);

/* Takes the computer's caps; each is at most SETPOINT_MAX. */
void guard_ask(guard *self, const uint16_t caps[DIRECTIONS], uint8_t hard);

/* The computer is lost: no cap is above `highest`, none rises any more, and none is overridden. */
void guard_narrow(guard *self, int32_t highest);

/* The guard ends by the rider's own act: all caps rise to the full swing. */
void guard_open(guard *self);

/* Fades the caps to none, of which `left_ms` are left; a stop before the lines are cut. */
void guard_fade(guard *self, int32_t elapsed_ms, int32_t left_ms);

/* Moves the caps on by some milliseconds, with the stick's deflections from neutral [mV]. */
void guard_step(guard *self, const int32_t deflection_mv[AXES], int32_t swing_mv, int32_t elapsed_ms);

/* Whether every cap is the full swing. */
bool guard_is_full(const guard *self);

/* The deflection [mV] that the caps leave of the stick's: |result| <= |deflection|, and never of another sign. */
int32_t guard_capped(const guard *self, int axis, int32_t deflection_mv, int32_t swing_mv);

#endif
