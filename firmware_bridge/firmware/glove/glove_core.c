/* Patterns and limits of a glove: see glove_core.h. */
#include "glove_core.h"

#include <stddef.h>
#include <string.h>

/* Twice long on all motors, which no symbol is: the computer does not speak any more. */
static const uint8_t NOBODY_STRENGTH = 255;
static const uint16_t NOBODY_ON_MS = 200;
static const uint16_t NOBODY_OFF_MS = 300;

static uint16_t all_motors(const glove_core *core)
{
    return (uint16_t)((1u << core->motors) - 1u);
}

void glove_init(glove_core *core, uint8_t motors)
{
    core->motors = motors < GLOVE_MOTORS_MAX ? motors : GLOVE_MOTORS_MAX;
}

static void stop(glove_core *core)
{
    core->playing = false;
    core->queued = false;
}

static void cut(glove_core *core, uint8_t why)
{
    if (core->playing)
        core->cut = why;
    stop(core);
}

static void begin(glove_core *core, const glove_pattern *pattern)
{
    core->pattern = *pattern;
    core->playing = true;
    core->at = 0;
    core->on = true;
    core->left_ms = core->pattern.steps[0].on_ms;
}

static void say_that_nobody_speaks(glove_core *core)
{
    const glove_step step = {all_motors(core), NOBODY_STRENGTH, NOBODY_ON_MS, NOBODY_OFF_MS};
    const glove_pattern pattern = {.count = 2, .steps = {step, step}};
    begin(core, &pattern);
}

/* The vibration and rest of the levels that the motors have had since the last step. */
static void account_part(glove_core *core, uint32_t part_ms)
{
    int on = 0;
    for (int motor = 0; motor < GLOVE_MOTORS_MAX; motor++) {
        if (core->level[motor] == 0) {
            core->run_ms[motor] = 0;
            continue;
        }
        on++;
        core->run_ms[motor] = (uint16_t)(core->run_ms[motor] + part_ms);
        core->bins[core->bin][motor] = (uint8_t)(core->bins[core->bin][motor] + part_ms);
        core->duty_ms[motor] = (uint16_t)(core->duty_ms[motor] + part_ms);
    }
    if (on > GLOVE_CROWD) {
        core->crowd_ms += part_ms;
        core->calm_ms = 0;
        return;
    }
    core->calm_ms += part_ms;
    if (core->calm_ms >= GLOVE_CALM_MS)
        core->crowd_ms = 0;
}

static void next_bin(glove_core *core)
{
    core->bin = (uint8_t)((core->bin + 1) % GLOVE_BINS);
    core->bin_ms = 0;
    for (int motor = 0; motor < GLOVE_MOTORS_MAX; motor++) {
        core->duty_ms[motor] = (uint16_t)(core->duty_ms[motor] - core->bins[core->bin][motor]);
        core->bins[core->bin][motor] = 0;
    }
}

static void account(glove_core *core, uint32_t elapsed_ms)
{
    uint32_t left = elapsed_ms < GLOVE_BINS * GLOVE_BIN_MS ? elapsed_ms : GLOVE_BINS * GLOVE_BIN_MS;
    while (left > 0) {
        const uint32_t room = GLOVE_BIN_MS - core->bin_ms, part = left < room ? left : room;
        account_part(core, part);
        core->bin_ms += part;
        if (core->bin_ms == GLOVE_BIN_MS)
            next_bin(core);
        left -= part;
    }
}

/* Moves to the vibration or rest that is due, and to the queued pattern after the last one. */
static void advance(glove_core *core, uint32_t elapsed_ms)
{
    core->next_ms += elapsed_ms;
    while (core->playing && elapsed_ms >= core->left_ms) {
        elapsed_ms -= core->left_ms;
        const glove_pattern *pattern = &core->pattern;
        if (core->on) {
            core->on = false;
            core->left_ms = pattern->steps[core->at].off_ms;
        } else if (core->at + 1 < pattern->count) {
            core->at++;
            core->on = true;
            core->left_ms = pattern->steps[core->at].on_ms;
        } else {
            core->playing = false;
            elapsed_ms = 0;
            if (core->queued && core->next_ms <= core->next.valid_ms)
                begin(core, &core->next);
            core->queued = false;
        }
    }
    core->left_ms -= elapsed_ms;
}

/* Motors that are whole and not switched off by a gain of 0. */
static uint16_t usable(const glove_core *core, const glove_inputs *inputs)
{
    unsigned motors = all_motors(core) & ~(unsigned)(inputs->open | inputs->shorted);
    for (int motor = 0; motor < core->motors; motor++)
        if (core->gain[motor] == 0)
            motors &= ~(1u << motor);
    return (uint16_t)motors;
}

static bool step_is_possible(const glove_core *core, const glove_step *step)
{
    if (step->mask == 0 || (step->mask & ~all_motors(core)) != 0 || step->strength == 0)
        return false;
    return step->on_ms > 0 && step->on_ms <= GLOVE_ON_MAX_MS && step->off_ms <= GLOVE_OFF_MAX_MS;
}

static bool is_too_much(const glove_core *core, const glove_pattern *pattern)
{
    for (int motor = 0; motor < core->motors; motor++) {
        uint32_t planned = core->duty_ms[motor];
        for (int i = 0; i < pattern->count; i++)
            planned += (pattern->steps[i].mask >> motor & 1) ? pattern->steps[i].on_ms : 0u;
        if (planned > GLOVE_DUTY_MAX_MS)
            return true;
    }
    return false;
}

static uint8_t refusal(const glove_core *core, const glove_inputs *inputs)
{
    const glove_pattern *pattern = &inputs->host.pattern;
    uint8_t refused = pattern->count == 0 ? PLAY_STEPS : 0;
    for (int i = 0; i < pattern->count; i++) {
        if (!step_is_possible(core, &pattern->steps[i]))
            return PLAY_STEPS;
        if ((pattern->steps[i].mask & usable(core, inputs)) == 0)
            refused = PLAY_FAULTY;
    }
    if (!inputs->worn)
        refused |= PLAY_NOT_WORN;
    if (core->hot)
        refused |= PLAY_HOT;
    if (is_too_much(core, pattern))
        refused |= PLAY_DUTY;
    if (core->playing && pattern->priority < core->pattern.priority)
        refused |= PLAY_LOWER;
    return refused;
}

static void play(glove_core *core, const glove_inputs *inputs)
{
    core->judged = inputs->host.sequence;
    core->refused = refusal(core, inputs);
    if (core->refused != 0)
        return;
    if (core->playing && inputs->host.pattern.priority == core->pattern.priority) {
        core->next = inputs->host.pattern;
        core->next_ms = 0;
        core->queued = true;
        return;
    }
    core->queued = false;
    begin(core, &inputs->host.pattern);
}

static void greet(glove_core *core, const glove_message *host)
{
    stop(core);
    core->state = host->hello_matches ? GLOVE_READY : GLOVE_WAITING;
    core->last_sequence = host->sequence;
    core->silent_ms = 0;
    core->judged = 0;
    core->refused = 0;
    memset(core->gain, UINT8_MAX, sizeof core->gain);
}

static bool is_next(const glove_core *core, uint16_t sequence)
{
    const uint16_t ahead = (uint16_t)(sequence - core->last_sequence);
    return ahead > 0 && ahead <= GLOVE_SEQUENCE_WINDOW;
}

/* Whether the message was accepted. */
static bool hear(glove_core *core, const glove_inputs *inputs)
{
    const glove_message *host = &inputs->host;
    if (host->event == GLOVE_HELLO) {
        greet(core, host);
        return host->hello_matches;
    }
    const bool session = core->state == GLOVE_READY || core->state == GLOVE_ARMED;
    if (host->event == GLOVE_NOTHING || !session || !is_next(core, host->sequence))
        return false;
    core->last_sequence = host->sequence;
    core->silent_ms = 0;
    if (host->event == GLOVE_PLAY)
        play(core, inputs);
    else if (host->event == GLOVE_STOP)
        stop(core);
    else if (host->event == GLOVE_GAIN)
        memcpy(core->gain, host->gain, sizeof core->gain);
    else
        core->state = host->armed ? GLOVE_ARMED : GLOVE_READY;
    return true;
}

static void notice_silence(glove_core *core)
{
    if (core->silent_ms < GLOVE_SILENCE_MS)
        return;
    if (core->state == GLOVE_READY) {
        stop(core);
        core->state = GLOVE_WAITING;
    } else if (core->state == GLOVE_ARMED) {
        stop(core);
        core->state = GLOVE_LOST;
        say_that_nobody_speaks(core);
    }
}

static void press(glove_core *core, const glove_inputs *inputs, uint32_t elapsed_ms)
{
    for (int button = 0; button < BUTTONS; button++) {
        const uint32_t before = core->pressed_ms[button];
        uint32_t held = inputs->pressed[button] ? before + elapsed_ms : 0;
        if (held > GLOVE_DEBOUNCE_MS)
            held = GLOVE_DEBOUNCE_MS;
        if (held == GLOVE_DEBOUNCE_MS && before < GLOVE_DEBOUNCE_MS)
            core->presses[button]++;
        core->pressed_ms[button] = (uint16_t)held;
    }
}

static void feel_heat(glove_core *core, int8_t temperature_c)
{
    if (temperature_c >= GLOVE_HOT_C)
        core->hot = true;
    else if (temperature_c <= GLOVE_COOL_C)
        core->hot = false;
}

/* The levels of the present step, before the limits; their number is returned. */
static int wanted(const glove_core *core, uint16_t usable_motors, uint8_t level[GLOVE_MOTORS_MAX])
{
    int count = 0;
    memset(level, 0, GLOVE_MOTORS_MAX);
    if (!core->playing || !core->on)
        return 0;
    const glove_step *step = &core->pattern.steps[core->at];
    for (int motor = 0; motor < core->motors; motor++) {
        if (!((step->mask & usable_motors) >> motor & 1))
            continue;
        level[motor] = (uint8_t)((step->strength * core->gain[motor] + UINT8_MAX / 2) / UINT8_MAX);
        count++;
    }
    return count;
}

/* Why the levels must not be put on the motors for the next millisecond; 0: they may. */
static uint8_t broken_limits(const glove_core *core, const uint8_t level[GLOVE_MOTORS_MAX], int count)
{
    if (count > GLOVE_CROWD && core->crowd_ms >= GLOVE_CROWD_MS)
        return CUT_CROWD;
    for (int motor = 0; motor < core->motors; motor++) {
        if (level[motor] == 0)
            continue;
        if (core->run_ms[motor] >= GLOVE_ON_MAX_MS)
            return CUT_RUN;
        if (core->duty_ms[motor] >= GLOVE_DUTY_MAX_MS)
            return CUT_DUTY;
    }
    return 0;
}

/* A pattern that would break a limit, or miss a step, is stopped as a whole: a part of it could be felt as another. */
static void put_levels(glove_core *core, const glove_inputs *inputs)
{
    const uint16_t motors = usable(core, inputs);
    if (!inputs->worn)
        cut(core, CUT_NOT_WORN);
    if (core->hot)
        cut(core, CUT_HOT);
    if (core->playing && core->on && (core->pattern.steps[core->at].mask & motors) == 0)
        cut(core, CUT_FAULTY);
    const int count = wanted(core, motors, core->level);
    const uint8_t why = broken_limits(core, core->level, count);
    if (why != 0) {
        cut(core, why);
        memset(core->level, 0, sizeof core->level);
    }
}

void glove_step_core(glove_core *core, const glove_inputs *inputs, uint32_t now_ms, glove_outputs *outputs)
{
    const uint32_t elapsed_ms = core->started ? now_ms - core->now_ms : 0;
    core->started = true;
    core->now_ms = now_ms;
    account(core, elapsed_ms);
    if (elapsed_ms > GLOVE_CLOCK_MS)
        cut(core, CUT_CLOCK);
    advance(core, elapsed_ms);
    core->silent_ms += elapsed_ms;
    feel_heat(core, inputs->temperature_c);
    press(core, inputs, elapsed_ms);
    outputs->heard = hear(core, inputs);
    notice_silence(core);
    put_levels(core, inputs);
    memcpy(outputs->level, core->level, sizeof outputs->level);
}
