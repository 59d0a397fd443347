/* The guard: see guard.h. */
#include "guard.h"

#include <string.h>

enum { CREEPS_FROM_MS = PUSH_MS + WARNING_MS, SPENT_MS = CREEPS_FROM_MS + OVERRIDE_MS, ALL_HARD = (1 << DIRECTIONS) - 1 };

static const int UPWARD[AXES] = {TO_FRONT, TO_RIGHT}, DOWNWARD[AXES] = {TO_REAR, TO_LEFT};
static const int32_t CREEP_CAP[DIRECTIONS] = {CREEP_CAP_DRIVE, CREEP_CAP_DRIVE, CREEP_CAP_TURN, CREEP_CAP_TURN};

static int32_t least(int32_t a, int32_t b)
{
    return a < b ? a : b;
}

void guard_begin(guard *self)
{
    memset(self, 0, sizeof *self);
}

void guard_ask(guard *self, const uint16_t caps[DIRECTIONS], uint8_t hard)
{
    for (int to = 0; to < DIRECTIONS; to++)
        self->asked[to] = caps[to];
    self->hard = hard;
}

void guard_narrow(guard *self, int32_t highest)
{
    for (int to = 0; to < DIRECTIONS; to++)
        self->asked[to] = least(highest, least(self->asked[to], self->caps[to]));
    self->hard = ALL_HARD;
}

void guard_open(guard *self)
{
    for (int to = 0; to < DIRECTIONS; to++)
        self->asked[to] = SETPOINT_MAX;
}

void guard_fade(guard *self, int32_t elapsed_ms, int32_t left_ms)
{
    for (int to = 0; to < DIRECTIONS; to++)
        self->caps[to] = self->caps[to] * (left_ms - elapsed_ms) / left_ms;
}

/* Counts the time of a hard push against a cap that an override would raise. After the override it stays at its end: a
 * stick that is stuck, or a spasm, gives no second one. A chair that may drive faster than a creep has left the thing behind: the same
 * push does not override the next one. */
static void count_push(guard *self, int to, bool held_hard, int32_t elapsed_ms)
{
    const bool blocked = self->asked[to] < CREEP_CAP[to] && !(self->hard >> to & 1);
    if (!held_hard)
        self->pushed_ms[to] = 0;
    else if (self->caps[to] >= 2 * CREEP_CAP[to])
        self->pushed_ms[to] = self->pushed_ms[to] < CREEPS_FROM_MS ? 0 : SPENT_MS;
    else if (blocked && self->pushed_ms[to] < SPENT_MS)
        self->pushed_ms[to] += (uint32_t)elapsed_ms;
}

/* Called for the drive's directions first, with no bits set. One axis creeps at a time, because at a corner of the chair two
 * creeps add up to a hard touch. */
static int32_t wanted_cap(guard *self, int to)
{
    const uint32_t pushed_ms = self->pushed_ms[to];
    if (self->asked[to] >= CREEP_CAP[to] || (self->hard >> to & 1) || pushed_ms < PUSH_MS || pushed_ms >= SPENT_MS)
        return self->asked[to];
    if (pushed_ms < CREEPS_FROM_MS)
        self->bits |= GUARD_WARNS;
    if (pushed_ms < CREEPS_FROM_MS || (self->bits & GUARD_OVERRIDDEN))
        return self->asked[to];
    self->bits |= GUARD_OVERRIDDEN;
    return CREEP_CAP[to];
}

void guard_step(guard *self, const int32_t deflection_mv[AXES], int32_t swing_mv, int32_t elapsed_ms)
{
    self->bits = 0;
    for (int axis = 0; axis < AXES; axis++) {
        const int32_t up = deflection_mv[axis] * PER_MILLE, hard = swing_mv * PUSH_PER_MILLE;
        count_push(self, UPWARD[axis], up > hard, elapsed_ms);
        count_push(self, DOWNWARD[axis], -up > hard, elapsed_ms);
    }
    for (int to = 0; to < DIRECTIONS; to++)
        self->caps[to] = least(wanted_cap(self, to), self->caps[to] + elapsed_ms * SETPOINT_MAX / RISE_MS);
    for (int axis = 0; axis < AXES; axis++)
        if (guard_capped(self, axis, deflection_mv[axis], swing_mv) != deflection_mv[axis])
            self->bits |= GUARD_CAPPED;
}

bool guard_is_full(const guard *self)
{
    for (int to = 0; to < DIRECTIONS; to++)
        if (self->caps[to] < SETPOINT_MAX)
            return false;
    return true;
}

int32_t guard_capped(const guard *self, int axis, int32_t deflection_mv, int32_t swing_mv)
{
    const int32_t up = self->caps[UPWARD[axis]] * swing_mv / SETPOINT_MAX;
    const int32_t down = self->caps[DOWNWARD[axis]] * swing_mv / SETPOINT_MAX;
    return deflection_mv > up ? up : deflection_mv < -down ? -down : deflection_mv;
}
