/* Proof of the guard on the shipped safety core: a sweep and random inputs, called in a loop.
 *
 *   guard_proof sweep STEP_MV        every stick x cap x reference of every family, in steps of so many millivolts
 *   guard_proof fuzz STEPS SEED      so many random steps of sticks, references, caps, frames and faults
 *
 * Prints the steps in which the guard held the lines, and the exceptions; status 1 with any. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "safety_core.h"

enum { ARMING_STEPS = 2100, RISING_STEPS = 510, LIMIT_EVERY = 20, FLAGS = COMMAND_ENABLE | LIMIT_GUARD, SHOWN = 5 };

typedef struct {
    unsigned long long steps, guarded, exceptions, passed_through;
} tally;

static tally counted;
static uint32_t now_ms;
static uint16_t sequence;

static int32_t between(int32_t value, int32_t low, int32_t high)
{
    return value < low ? low : value > high ? high : value;
}

static safety_inputs resting(const joystick_family *family)
{
    const uint16_t mv = (uint16_t)family->reference_mv;
    return (safety_inputs){{mv, mv}, {mv, mv}, mv, true, true, {0}};
}

static host_message limit_of(const uint16_t caps[DIRECTIONS], uint8_t flags)
{
    host_message message = {.event = EVENT_LIMIT, .sequence = ++sequence, .flags = flags};
    memcpy(message.caps, caps, sizeof message.caps);
    return message;
}

/* A core in GUARD with these caps in force. */
static safety_core guarding(const joystick_family *family, uint8_t id, const uint16_t caps[DIRECTIONS])
{
    safety_core core;
    const safety_config config = safety_defaults(id);
    safety_inputs inputs = resting(family);
    if (!safety_init(&core, &config))
        exit(2);
    inputs.host = (host_message){.event = EVENT_HELLO, .hello_matches = true, .sequence = sequence};
    for (int step = 0; step < ARMING_STEPS + RISING_STEPS; step++) {
        (void)safety_step(&core, &inputs, ++now_ms);
        inputs.host = step % LIMIT_EVERY == 0 ? limit_of(caps, FLAGS) : (host_message){0};
    }
    if (core.state != STATE_GUARD || core.faults != 0)
        exit(2);
    return core;
}

static void complain(const char *what, const safety_core *core, const safety_inputs *inputs, const safety_outputs *outputs)
{
    if (counted.exceptions++ < SHOWN)
        fprintf(stderr, "%s: state %d, sticks %d %d, reference %d, lines %d %d\n", what, core->state,
                inputs->joystick_mv[0], inputs->joystick_mv[1], inputs->reference_mv, outputs->line_mv[0],
                outputs->line_mv[1]);
}

/* Reckoned here anew, not by the core: neutral and swing follow the reference within 5 %. */
static void check(const safety_core *core, const joystick_family *family, const safety_inputs *inputs,
                  const safety_outputs *outputs)
{
    counted.steps++;
    if (!core->guarding)
        return;
    counted.guarded++;
    const int32_t tolerance = family->reference_mv / 20;
    const int32_t neutral =
        between(inputs->reference_mv, family->reference_mv - tolerance, family->reference_mv + tolerance);
    const int32_t swing = (family->swing_mv * neutral + family->reference_mv / 2) / family->reference_mv;
    bool broken = false;
    for (int axis = 0; axis < AXES; axis++)
        broken = broken || inputs->joystick_mv[axis] < family->fault_low_mv ||
                 inputs->joystick_mv[axis] > family->fault_high_mv;
    for (int axis = 0; axis < AXES; axis++) {
        const int32_t stick = broken ? 0 : inputs->joystick_mv[axis] - neutral, line = outputs->line_mv[axis] - neutral;
        const int32_t up = outputs->caps[axis == AXIS_FORWARD ? TO_FRONT : TO_RIGHT];
        const int32_t down = outputs->caps[axis == AXIS_FORWARD ? TO_REAR : TO_LEFT];
        if (abs(line) > abs(stick))
            complain("more than the stick", core, inputs, outputs);
        if (line * stick < 0)
            complain("another sign", core, inputs, outputs);
        if (line * SETPOINT_MAX > up * swing || -line * SETPOINT_MAX > down * swing)
            complain("more than the cap", core, inputs, outputs);
        const int32_t cap = stick > 0 ? up : down;
        if (abs(line) < abs(stick) && (abs(line) + 1) * SETPOINT_MAX <= cap * swing)
            complain("less than stick and cap", core, inputs, outputs);
        if (cap == SETPOINT_MAX && abs(stick) <= swing) {
            counted.passed_through++;
            if (abs(line - stick) > 1)
                complain("not passed through", core, inputs, outputs);
        }
    }
}

static void sweep_sticks(const safety_core *from, const joystick_family *family, int step_mv, int reference_mv)
{
    for (int stick = 0; stick <= family->supply_mv; stick += step_mv) {
        safety_core core = *from;
        safety_inputs inputs = resting(family);
        inputs.reference_mv = (uint16_t)reference_mv;
        inputs.joystick_mv[AXIS_FORWARD] = (uint16_t)stick;
        inputs.joystick_mv[AXIS_TURN] = (uint16_t)(family->supply_mv - stick);
        const safety_outputs outputs = safety_step(&core, &inputs, now_ms + 1);
        check(&core, family, &inputs, &outputs);
    }
}

static void sweep(int step_mv)
{
    for (uint8_t id = FAMILY_NONE + 1; id < FAMILY_COUNT; id++) {
        const joystick_family *family = family_find(id);
        const int past = family->reference_mv * 8 / 100; /* beyond the tolerance of 5 % */
        for (int cap_mv = 0; cap_mv <= family->swing_mv; cap_mv += step_mv) {
            const uint16_t cap = (uint16_t)(cap_mv * SETPOINT_MAX / family->swing_mv), rest = (uint16_t)(SETPOINT_MAX - cap);
            const uint16_t caps[DIRECTIONS] = {cap, rest, rest, cap};
            const safety_core core = guarding(family, id, caps);
            for (int off = -past; off <= past; off += step_mv)
                sweep_sticks(&core, family, step_mv, family->reference_mv + off);
        }
    }
}

static uint64_t random_state;

/* xorshift64* (Vigna 2016) */
static uint32_t draw(uint32_t below)
{
    random_state ^= random_state >> 12;
    random_state ^= random_state << 25;
    random_state ^= random_state >> 27;
    return (uint32_t)((random_state * 2685821657736338717u) >> 33) % below;
}

static host_message any_message(void)
{
    uint16_t caps[DIRECTIONS];
    for (int to = 0; to < DIRECTIONS; to++)
        caps[to] = (uint16_t)(draw(4) == 0 ? draw(10) * 1111 : draw(SETPOINT_MAX + 1));
    if (draw(5000) == 0)
        caps[draw(DIRECTIONS)] = (uint16_t)draw(65536);
    host_message message = limit_of(caps, draw(500) == 0 ? (uint8_t)draw(256) : (uint8_t)(FLAGS | (draw(16) << 4)));
    const uint32_t other = draw(4000);
    if (other == 0)
        message.event = (uint8_t)draw(7);
    if (other == 1)
        message.sequence = (uint16_t)draw(65536);
    if (other < 3)
        message.hello_matches = draw(2) == 0;
    return message;
}

static void any_surroundings(const joystick_family *family, safety_inputs *inputs)
{
    if (draw(30) == 0)
        inputs->joystick_mv[draw(AXES)] = (uint16_t)(family->reference_mv - family->swing_mv + (int)draw(2u * (uint32_t)family->swing_mv + 1));
    if (draw(3000) == 0)
        inputs->joystick_mv[draw(AXES)] = (uint16_t)draw(65536);
    if (draw(500) == 0)
        inputs->joystick_mv[0] = inputs->joystick_mv[1] = (uint16_t)family->reference_mv;
    if (draw(200) == 0)
        inputs->reference_mv = (uint16_t)((int)family->reference_mv * (int)(1000 + draw(90)) / 1045);
    inputs->estop_released = draw(20000) != 0;
    inputs->board_ok = draw(20000) != 0;
}

static void fuzz(unsigned long long steps, uint64_t seed)
{
    static const uint16_t NONE[DIRECTIONS];
    random_state = seed * 2 + 1;
    safety_core prepared[FAMILY_COUNT];
    uint16_t sequences[FAMILY_COUNT];
    for (uint8_t id = FAMILY_NONE + 1; id < FAMILY_COUNT; id++) {
        prepared[id] = guarding(family_find(id), id, NONE);
        sequences[id] = sequence;
    }
    const uint32_t start_ms = now_ms;
    safety_core core = prepared[1];
    const joystick_family *family = family_find(1);
    safety_inputs inputs = resting(family);
    safety_outputs outputs = {0};
    for (unsigned long long step = 0; step < steps; step++) {
        if (step % 4000 == 0) {
            const uint8_t id = (uint8_t)(1 + draw(FAMILY_COUNT - 1));
            core = prepared[id];
            core.now_ms = now_ms;
            core.host_ms += now_ms - start_ms;
            core.kick_ms = now_ms;
            sequence = sequences[id];
            family = family_find(id);
            inputs = resting(family);
            outputs = (safety_outputs){.holder = HOLDER_BOARD, .line_mv = {inputs.reference_mv, inputs.reference_mv}};
        }
        const safety_outputs before = outputs;
        const bool was_lost = core.lost && core.guarding;
        any_surroundings(family, &inputs);
        for (int axis = 0; axis < AXES; axis++)
            inputs.line_mv[axis] = outputs.holder == HOLDER_BOARD ? outputs.line_mv[axis] : inputs.joystick_mv[axis];
        const bool spoken = draw(LIMIT_EVERY) == 0;
        inputs.host = spoken ? any_message() : (host_message){0};
        const uint32_t passed = draw(20) == 0 ? 1 + draw(draw(300) == 0 ? 80 : 20) : 1;
        now_ms += passed;
        outputs = safety_step(&core, &inputs, now_ms);
        check(&core, family, &inputs, &outputs);
        int raised_axes = 0;
        for (int to = 0; core.guarding && to < DIRECTIONS; to++) {
            if (outputs.caps[to] > before.caps[to] + passed * (SETPOINT_MAX / RISE_MS))
                complain("a cap rose too fast", &core, &inputs, &outputs);
            if (was_lost && outputs.caps[to] > before.caps[to])
                complain("a cap rose after the computer was lost", &core, &inputs, &outputs);
            if (core.lost && outputs.caps[to] > 2500)
                complain("a cap of a lost computer is wide", &core, &inputs, &outputs);
            const bool raised = core.state == STATE_GUARD && outputs.caps[to] > core.guard.asked[to];
            const int32_t creep = to == TO_FRONT || to == TO_REAR ? CREEP_CAP_DRIVE : CREEP_CAP_TURN;
            raised_axes |= raised ? 1 << (to == TO_LEFT || to == TO_RIGHT) : 0;
            if (raised && ((core.guard.hard >> to & 1) || outputs.caps[to] > creep))
                complain("a cap is above the one asked for", &core, &inputs, &outputs);
        }
        if (raised_axes == 3)
            complain("both axes creep", &core, &inputs, &outputs);
    }
}

int main(int count, char **words)
{
    if (count == 3 && strcmp(words[1], "sweep") == 0)
        sweep(atoi(words[2]));
    else if (count == 4 && strcmp(words[1], "fuzz") == 0)
        fuzz(strtoull(words[2], NULL, 10), strtoull(words[3], NULL, 10));
    else
        return 2;
    printf("%llu steps, %llu guarded, %llu passed through, %llu exceptions\n", counted.steps, counted.guarded,
           counted.passed_through, counted.exceptions);
    return counted.exceptions > 0;
}
