/* The safety core: see safety_core.h. Read safety_step at the end of this file first. */
#include "safety_core.h"

#include <stddef.h>
#include <string.h>

enum { NEUTRAL_MIN = 20, NEUTRAL_MAX = 200, OVERRIDE_MAX = 800, OVERRIDE_MAX_MS = 500, SLEW_MIN_MS = 100,
       SLEW_MAX_MS = 1000 };

/* Neutral and swing of the lines now: both follow the reference, like a ratiometric stick. */
typedef struct {
    int32_t neutral_mv;
    int32_t swing_mv;
} span;

static int32_t clamp(int32_t value, int32_t low, int32_t high)
{
    return value < low ? low : value > high ? high : value;
}

static int32_t distance(int32_t a, int32_t b)
{
    return a < b ? b - a : a - b;
}

/* value * numerator / denominator, rounded to nearest. */
static int32_t scaled(int32_t value, int32_t numerator, int32_t denominator)
{
    const int32_t product = value * numerator;
    return (product + (product < 0 ? -denominator / 2 : denominator / 2)) / denominator;
}

safety_config safety_defaults(uint8_t family)
{
    return (safety_config){
        .family = family, .neutral_per_mille = 100, .override_per_mille = 200, .override_ms = 10, .slew_ms = 200,
        .guard_lost_per_mille = 250};
}

static bool config_possible(const safety_config *config)
{
    return family_find(config->family) != NULL && config->neutral_per_mille >= NEUTRAL_MIN &&
           config->neutral_per_mille <= NEUTRAL_MAX && config->override_per_mille > config->neutral_per_mille &&
           config->override_per_mille <= OVERRIDE_MAX && config->override_ms <= OVERRIDE_MAX_MS &&
           config->slew_ms >= SLEW_MIN_MS && config->slew_ms <= SLEW_MAX_MS && config->guard_lost_per_mille <= PER_MILLE;
}

bool safety_init(safety_core *core, const safety_config *config)
{
    memset(core, 0, sizeof *core); /* SILENT, joystick, no fault */
    core->config = *config;
    if (!config_possible(config))
        return false;
    core->family = family_find(config->family);
    return true;
}

/* Whether a condition has held for this time without a break. */
static bool held(safety_core *core, int which, bool condition, uint32_t duration_ms)
{
    safety_timer *timer = &core->timers[which];
    if (!timer->running)
        timer->since_ms = core->now_ms;
    timer->running = condition;
    return condition && core->now_ms - timer->since_ms >= duration_ms;
}

static void tick(safety_core *core, uint32_t now_ms)
{
    core->elapsed_ms = core->started ? now_ms - core->now_ms : 0;
    if (!core->started)
        core->kick_ms = now_ms;
    core->started = true;
    core->now_ms = now_ms;
    if (core->elapsed_ms > STEP_MAX_MS)
        memset(core->timers, 0, sizeof core->timers); /* the time between is unknown: no condition has held */
}

static int32_t reference_tolerance(const safety_core *core)
{
    return core->family->reference_mv * REFERENCE_PER_MILLE / PER_MILLE;
}

static span span_now(const safety_core *core, int32_t reference_mv)
{
    const int32_t nominal = core->family->reference_mv, tolerance = reference_tolerance(core);
    const int32_t neutral = clamp(reference_mv, nominal - tolerance, nominal + tolerance);
    return (span){neutral, scaled(core->family->swing_mv, neutral, nominal)};
}

static bool possible(const safety_core *core, const uint16_t mv[AXES])
{
    for (int axis = 0; axis < AXES; axis++)
        if (mv[axis] < core->family->fault_low_mv || mv[axis] > core->family->fault_high_mv)
            return false;
    return true;
}

static int32_t deflection(const uint16_t mv[AXES], span now)
{
    const int32_t forward = distance(mv[AXIS_FORWARD], now.neutral_mv), turn = distance(mv[AXIS_TURN], now.neutral_mv);
    return forward > turn ? forward : turn;
}

static bool stick_neutral(const safety_core *core, const safety_inputs *inputs, span now)
{
    return deflection(inputs->joystick_mv, now) * PER_MILLE <= core->config.neutral_per_mille * now.swing_mv;
}

/* Beyond the fault limits a stick does not override: that is a broken wire, not the rider. */
static bool stick_pushed(const safety_core *core, const safety_inputs *inputs, span now)
{
    return possible(core, inputs->joystick_mv) &&
           deflection(inputs->joystick_mv, now) * PER_MILLE > core->config.override_per_mille * now.swing_mv;
}

static bool armed(const safety_core *core)
{
    return core->state == STATE_ARMED || core->state == STATE_DRIVE || core->state == STATE_GUARD;
}

static bool command_zero(const safety_core *core)
{
    return core->setpoint[AXIS_FORWARD] == 0 && core->setpoint[AXIS_TURN] == 0;
}

static uint16_t hear_bad_frame(safety_core *core)
{
    core->timers[TIMER_HOLD].running = false;
    memmove(core->bad_frame_ms, core->bad_frame_ms + 1, (BAD_FRAMES - 1) * sizeof core->bad_frame_ms[0]);
    core->bad_frame_ms[BAD_FRAMES - 1] = core->now_ms;
    if (core->bad_frames < BAD_FRAMES)
        core->bad_frames++;
    const bool many = core->bad_frames == BAD_FRAMES && core->now_ms - core->bad_frame_ms[0] <= BAD_FRAMES_MS;
    return many ? FAULT_BAD_FRAMES : 0;
}

static uint16_t hear_hello(safety_core *core, const host_message *host)
{
    core->session = host->hello_matches;
    core->sequence = host->sequence;
    core->flags = 0; /* no ENABLE until its first command */
    return FAULT_NEW_HOST;
}

/* Whether a frame belongs to the session and is new; it is then a sign of life. */
static bool accept(safety_core *core, const host_message *host, uint8_t flags)
{
    const uint16_t newer = (uint16_t)(host->sequence - core->sequence);
    if (!core->session || newer == 0 || newer > SEQUENCE_WINDOW)
        return false;
    core->heard = core->host_present = true;
    core->host_ms = core->now_ms;
    core->sequence = host->sequence;
    core->reset_asked = (flags & ~core->flags & COMMAND_RESET) != 0;
    core->flags = flags;
    return true;
}

static uint16_t hear_command(safety_core *core, const host_message *host)
{
    if (!accept(core, host, host->flags & (COMMAND_ENABLE | COMMAND_RESET | COMMAND_ESTOP_ACK)))
        return 0;
    memcpy(core->setpoint, host->setpoint, sizeof core->setpoint);
    const bool beyond =
        distance(host->setpoint[AXIS_FORWARD], 0) > SETPOINT_MAX || distance(host->setpoint[AXIS_TURN], 0) > SETPOINT_MAX;
    return beyond ? FAULT_RANGE : 0;
}

/* A limit never drives: it has no set-point, and without its guard flag it does not even arm. */
static uint16_t hear_limit(safety_core *core, const host_message *host)
{
    const bool guards = (host->flags & LIMIT_GUARD) != 0;
    if (!accept(core, host, guards ? host->flags : host->flags & (COMMAND_RESET | COMMAND_ESTOP_ACK)))
        return 0;
    core->setpoint[AXIS_FORWARD] = core->setpoint[AXIS_TURN] = 0;
    for (int to = 0; to < DIRECTIONS; to++)
        if (host->caps[to] > SETPOINT_MAX)
            return FAULT_RANGE;
    if (core->state == STATE_GUARD)
        guard_ask(&core->guard, host->caps, host->flags >> LIMIT_HARD_SHIFT);
    return 0;
}

static uint16_t hear(safety_core *core, const host_message *host)
{
    core->heard = core->reset_asked = false;
    if (core->bad_frames > 0 && core->now_ms - core->bad_frame_ms[BAD_FRAMES - 1] > BAD_FRAMES_MS)
        core->bad_frames = 0; /* otherwise a wrap of the clock would make them recent again */
    switch (host->event) {
    case EVENT_BAD_FRAME:
        return hear_bad_frame(core);
    case EVENT_HELLO:
        return hear_hello(core, host);
    case EVENT_COMMAND:
        return hear_command(core, host);
    case EVENT_LIMIT:
        return hear_limit(core, host);
    default:
        return 0;
    }
}

/* Faults of the computer latch only once it is armed; before that they only prevent arming. */
static uint16_t host_faults(safety_core *core, const host_message *host)
{
    uint16_t found = hear(core, host);
    if (core->host_present && core->now_ms - core->host_ms >= WATCHDOG_MS)
        core->host_present = false;
    if (!core->host_present)
        found |= FAULT_HOST_SILENT;
    if (core->elapsed_ms > STEP_MAX_MS)
        found |= FAULT_CLOCK;
    return armed(core) ? found : 0;
}

/* Whether the line of an axis should stand at neutral: by the computer's command, or because the stick that it copies is
 * at rest. */
static bool rests(const safety_core *core, int axis, span now)
{
    if (!core->guarding)
        return core->setpoint[axis] == 0;
    return distance(core->line_mv[axis], now.neutral_mv) * PER_MILLE <= core->config.neutral_per_mille * now.swing_mv;
}

/* Compares the read-back with the voltage of the present holder: F8 at any time, F21 on an axis at rest. */
static uint16_t read_back_faults(safety_core *core, const safety_inputs *inputs, span now)
{
    bool mismatch = false, creep = false;
    for (int axis = 0; axis < AXES; axis++) {
        const int32_t expected = core->holder == HOLDER_BOARD ? core->line_mv[axis] : inputs->joystick_mv[axis];
        const int32_t error = distance(inputs->line_mv[axis], expected);
        mismatch = mismatch || (core->holder != HOLDER_CUT && error > MISMATCH_MV);
        creep = creep || (core->holder == HOLDER_BOARD && rests(core, axis, now) && error > CREEP_MV);
    }
    uint16_t found = 0;
    if (held(core, TIMER_MISMATCH, mismatch, LINE_FAULT_MS))
        found |= FAULT_MISMATCH;
    if (held(core, TIMER_CREEP, creep, CREEP_MS))
        found |= FAULT_CREEP;
    return found;
}

static uint16_t line_faults(safety_core *core, const safety_inputs *inputs, span now)
{
    uint16_t found = read_back_faults(core, inputs, now);
    const int32_t drift = distance(inputs->reference_mv, core->family->reference_mv);
    if (held(core, TIMER_REFERENCE, drift > reference_tolerance(core), LINE_FAULT_MS))
        found |= FAULT_REFERENCE;
    if (held(core, TIMER_IMPOSSIBLE, !possible(core, inputs->line_mv), LINE_FAULT_MS))
        found |= FAULT_IMPOSSIBLE;
    if (held(core, TIMER_STICK, !possible(core, inputs->joystick_mv), LINE_FAULT_MS))
        found |= FAULT_STICK;
    if (!inputs->estop_released)
        found |= FAULT_ESTOP;
    if (!inputs->board_ok)
        found |= FAULT_BOARD;
    return found;
}

static void give_lines(safety_core *core, line_holder holder)
{
    core->holder = holder;
    core->stopping = core->guarding = false;
}

static void begin_stop(safety_core *core, uint32_t duration_ms)
{
    core->stopping = true;
    core->stop_left_ms = duration_ms;
}

/* A fault of the computer or of the converter ends a guard: the stick stays narrow, or is cut off if the converter cannot
 * copy it. */
static void lose_guard(safety_core *core, uint16_t found)
{
    core->lost = true;
    guard_narrow(&core->guard, core->config.guard_lost_per_mille * (SETPOINT_MAX / PER_MILLE));
    if (found & FAULT_BOARD)
        give_lines(core, HOLDER_CUT);
}

/* Latches faults and begins the stop of their class; a stronger class replaces a weaker one in progress. */
static void latch(safety_core *core, uint16_t found)
{
    if (found == 0)
        return;
    const bool ramping = (core->faults & FAULTS_RAMP_TO_CUT) != 0;
    const bool board = core->holder == HOLDER_BOARD;
    core->faults |= found;
    core->state = STATE_FAULT;
    if ((found & FAULTS_CUT_AT_ONCE) || ((found & FAULTS_RAMP_TO_CUT) && !board))
        give_lines(core, HOLDER_CUT);
    else if ((found & FAULTS_RAMP_TO_CUT) && !ramping)
        begin_stop(core, RAMP_TO_CUT_MS);
    else if (core->guarding && (!core->stopping || (found & FAULT_BOARD)))
        lose_guard(core, found);
    else if (board && !core->stopping)
        begin_stop(core, HANDOVER_MS);
}

/* After a lost guard and a stick at rest the joystick is live; faults of the computer are then over. */
static void free_stick(safety_core *core, bool neutral)
{
    if (!held(core, TIMER_LOST, core->lost && neutral, NEUTRAL_HOLD_MS))
        return;
    core->lost = false;
    if (core->faults & (FAULTS_RAMP_TO_CUT | FAULTS_CUT_AT_ONCE))
        return;
    give_lines(core, HOLDER_JOYSTICK);
    core->faults &= FAULT_BOARD;
    if (core->faults == 0)
        core->state = STATE_SILENT;
}

/* Leaves FAULT by a reset of the computer while everything is in order. A rider without a computer gets the joystick
 * back after a released e-stop and a stick at rest; the computer stays locked out. */
static void recover(safety_core *core, uint16_t found, bool neutral)
{
    free_stick(core, neutral);
    const bool only_estop = (core->faults & (FAULTS_RAMP_TO_CUT | FAULTS_CUT_AT_ONCE)) == FAULT_ESTOP;
    const bool released = only_estop && !(found & FAULT_ESTOP) && neutral;
    if (held(core, TIMER_ESTOP_RELEASE, released, NEUTRAL_HOLD_MS))
        give_lines(core, HOLDER_JOYSTICK);
    const bool acknowledged = !(core->faults & FAULT_ESTOP) || (core->flags & COMMAND_ESTOP_ACK);
    if (core->state != STATE_FAULT || !core->reset_asked || !acknowledged)
        return;
    if (found != 0 || !neutral || !command_zero(core) || core->stopping || core->lost)
        return;
    core->faults = 0;
    core->state = STATE_SILENT;
    give_lines(core, HOLDER_JOYSTICK);
}

static void take_lines(safety_core *core, const safety_inputs *inputs)
{
    core->state = STATE_DRIVE;
    give_lines(core, HOLDER_BOARD);
    for (int axis = 0; axis < AXES; axis++)
        core->line_mv[axis] = inputs->joystick_mv[axis]; /* from the present voltage: no jump */
    memcpy(core->window_mv, core->line_mv, sizeof core->window_mv);
    core->window_start_ms = core->now_ms;
}

static void take_guard(safety_core *core)
{
    core->state = STATE_GUARD;
    give_lines(core, HOLDER_BOARD);
    core->guarding = true;
    guard_begin(&core->guard);
}

static void change_state(safety_core *core, const safety_inputs *inputs, span now, bool neutral)
{
    const bool enabled = (core->flags & COMMAND_ENABLE) != 0;
    const bool guards = enabled && (core->flags & LIMIT_GUARD) != 0;
    const bool ready = core->state == STATE_SILENT && core->session && core->host_present && enabled &&
                       command_zero(core) && neutral;
    const bool overridden =
        held(core, TIMER_OVERRIDE, stick_pushed(core, inputs, now), core->config.override_ms);
    if (core->holder == HOLDER_BOARD && !core->guarding && overridden && !(core->faults & FAULTS_RAMP_TO_CUT)) {
        give_lines(core, HOLDER_JOYSTICK); /* F19, at once: the rider expects this jump */
        if (core->state == STATE_DRIVE)
            core->state = STATE_SILENT;
    }
    if (held(core, TIMER_HOLD, ready, NEUTRAL_HOLD_MS))
        core->state = STATE_ARMED;
    else if (core->state == STATE_ARMED && (!enabled || !neutral))
        core->state = STATE_SILENT;
    else if (core->state == STATE_ARMED && guards)
        take_guard(core);
    else if (core->state == STATE_ARMED && !command_zero(core))
        take_lines(core, inputs);
    else if (core->state == STATE_DRIVE && (!enabled || guards)) {
        core->state = STATE_SILENT;
        begin_stop(core, HANDOVER_MS);
    } else if (core->state == STATE_GUARD && !guards) {
        core->state = STATE_SILENT;
        guard_open(&core->guard);
    }
}

/* Ramps from the present command to the rider's stick, or to neutral before a cut, in the time that is left. */
static void stop_lines(safety_core *core, const safety_inputs *inputs, span now)
{
    const bool to_cut = (core->faults & FAULTS_RAMP_TO_CUT) != 0;
    if (core->elapsed_ms >= core->stop_left_ms) {
        give_lines(core, to_cut ? HOLDER_CUT : HOLDER_JOYSTICK);
        return;
    }
    const bool to_stick = !to_cut && possible(core, inputs->joystick_mv);
    for (int axis = 0; axis < AXES; axis++) {
        const int32_t target = to_stick ? inputs->joystick_mv[axis] : now.neutral_mv;
        core->line_mv[axis] +=
            scaled(target - core->line_mv[axis], (int32_t)core->elapsed_ms, (int32_t)core->stop_left_ms);
    }
    core->stop_left_ms -= core->elapsed_ms;
}

/* Moves towards the command (F6), limited by the chair's slew, by the window and by the swing. */
static void drive_lines(safety_core *core, span now)
{
    if (core->now_ms - core->window_start_ms >= WINDOW_MS) {
        memcpy(core->window_mv, core->line_mv, sizeof core->window_mv);
        core->window_start_ms = core->now_ms;
    }
    const int32_t elapsed = clamp((int32_t)core->elapsed_ms, 0, SLEW_STEP_MS);
    const int32_t slew = now.swing_mv * elapsed / core->config.slew_ms;
    const int32_t window = now.swing_mv * WINDOW_PER_MILLE / PER_MILLE;
    for (int axis = 0; axis < AXES; axis++) {
        const int32_t from = core->line_mv[axis], start = core->window_mv[axis];
        const int32_t target = now.neutral_mv + scaled(core->setpoint[axis], now.swing_mv, SETPOINT_MAX);
        const int32_t slewed = clamp(target, from - slew, from + slew);
        const int32_t windowed = clamp(slewed, start - window, start + window);
        core->line_mv[axis] = clamp(windowed, now.neutral_mv - now.swing_mv, now.neutral_mv + now.swing_mv);
    }
}

/* Copies the stick within the caps. A stick with a broken wire counts as at rest at once: its voltage is nobody's wish. A
 * guard that the rider has ended holds the lines until the caps hold nothing back, so that nothing lurches. */
static void guard_lines(safety_core *core, const safety_inputs *inputs, span now)
{
    const int32_t elapsed = clamp((int32_t)core->elapsed_ms, 0, SLEW_STEP_MS);
    const bool possible_stick = possible(core, inputs->joystick_mv);
    int32_t deflection_mv[AXES];
    for (int axis = 0; axis < AXES; axis++)
        deflection_mv[axis] = possible_stick ? inputs->joystick_mv[axis] - now.neutral_mv : 0;
    if (core->stopping && core->elapsed_ms >= core->stop_left_ms) {
        give_lines(core, HOLDER_CUT);
        return;
    }
    if (core->stopping) {
        guard_fade(&core->guard, (int32_t)core->elapsed_ms, (int32_t)core->stop_left_ms);
        core->stop_left_ms -= core->elapsed_ms;
    } else
        guard_step(&core->guard, deflection_mv, now.swing_mv, elapsed);
    for (int axis = 0; axis < AXES; axis++)
        core->line_mv[axis] = now.neutral_mv + guard_capped(&core->guard, axis, deflection_mv[axis], now.swing_mv);
    if (core->state == STATE_SILENT && (guard_is_full(&core->guard) || !(core->guard.bits & GUARD_CAPPED)))
        give_lines(core, HOLDER_JOYSTICK);
}

static void move_lines(safety_core *core, const safety_inputs *inputs, span now)
{
    if (core->guarding)
        guard_lines(core, inputs, now);
    else if (core->stopping)
        stop_lines(core, inputs, now);
    else if (core->holder == HOLDER_BOARD)
        drive_lines(core, now);
    if (core->holder != HOLDER_BOARD)
        core->line_mv[AXIS_FORWARD] = core->line_mv[AXIS_TURN] = now.neutral_mv; /* the converter waits at neutral */
}

static safety_outputs outputs_of(safety_core *core)
{
    safety_outputs outputs = {
        .state = (uint8_t)core->state, .holder = (uint8_t)core->holder, .faults = core->faults, .heard = core->heard};
    for (int axis = 0; axis < AXES; axis++)
        outputs.line_mv[axis] = (uint16_t)core->line_mv[axis];
    for (int to = 0; core->guarding && to < DIRECTIONS; to++)
        outputs.caps[to] = (uint16_t)core->guard.caps[to];
    outputs.guard_bits = (uint8_t)((core->guarding ? core->guard.bits : 0) | (core->lost ? GUARD_LOST : 0));
    outputs.kick = core->now_ms - core->kick_ms >= KICK_MS;
    if (outputs.kick)
        core->kick_ms = core->now_ms;
    return outputs;
}

safety_outputs safety_step(safety_core *core, const safety_inputs *inputs, uint32_t now_ms)
{
    tick(core, now_ms);
    if (core->family != NULL) {
        const span now = span_now(core, inputs->reference_mv);
        const bool neutral = stick_neutral(core, inputs, now);
        const uint16_t found = (uint16_t)(host_faults(core, &inputs->host) | line_faults(core, inputs, now));
        latch(core, found);
        recover(core, found, neutral);
        change_state(core, inputs, now, neutral);
        move_lines(core, inputs, now);
    }
    return outputs_of(core);
}
