/* Fuzz target and driver: the whole board loop on bytes that grow out of valid frames wherever they reach new code.
 *
 *   fuzz BYTES SEED      feeds this many bytes in all; prints the coverage; aborts on the first broken promise
 *
 * The firmware's objects call __sanitizer_cov_trace_pc (gcc and clang: -fsanitize-coverage=trace-pc) on every edge; an
 * input that reaches a new one joins the corpus. Built with AddressSanitizer. The target has libFuzzer's name, so that
 * `clang -fsanitize=fuzzer` can drive it too, with FUZZ_TARGET_ONLY defined. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "board.h"
#include "hal.h"

enum { INPUT_MAX = 512, CORPUS_MAX = 1024, CHANGES_MAX = 8, EDGES = 1 << 16, BYTES_PER_STEP = 12, NEUTRAL_MV = 2500, SWING_MV = 1200 };

static const uint8_t *input;
static size_t input_left;
static uint32_t clock_ms;
static uint16_t lines_mv[AXES];
static uint16_t stick_mv[AXES];

void hal_begin(const joystick_family *family)
{
    (void)family;
}

hal_converter hal_converter_of_board(void)
{
    return (hal_converter){12, 4095};
}

uint32_t hal_now_ms(void)
{
    return clock_ms;
}

static size_t step_left;

bool hal_read_byte(uint8_t *byte)
{
    if (input_left == 0 || step_left == 0)
        return false;
    *byte = *input++;
    input_left--;
    step_left--;
    return true;
}

void hal_write(const uint8_t *bytes, size_t length)
{
    frame_decoder decoder;
    frame sent;
    frame_decoder_init(&decoder);
    for (size_t i = 0; i < length; i++)
        if (frame_decode(&decoder, bytes[i], &sent) == DECODED_BAD)
            abort();
}

void hal_sense(safety_inputs *inputs)
{
    inputs->reference_mv = NEUTRAL_MV;
    inputs->estop_released = inputs->board_ok = true;
    for (int axis = 0; axis < AXES; axis++) {
        inputs->joystick_mv[axis] = stick_mv[axis];
        inputs->line_mv[axis] = lines_mv[axis];
    }
}

bool hal_put(const uint16_t line_mv[AXES])
{
    memcpy(lines_mv, line_mv, sizeof lines_mv);
    return true;
}

void hal_switch(uint8_t holder)
{
    for (int axis = 0; holder != HOLDER_BOARD && axis < AXES; axis++)
        lines_mv[axis] = holder == HOLDER_CUT ? NEUTRAL_MV : stick_mv[axis];
}

void hal_kick(void)
{
}

static safety_outputs one_step(board *self)
{
    clock_ms++;
    step_left = BYTES_PER_STEP;
    return board_step(self);
}

static size_t put_frame(uint8_t type, uint16_t sequence, const uint8_t *payload, uint8_t length, uint8_t *wire)
{
    frame message = {.type = type, .sequence = sequence, .length = length};
    memcpy(message.payload, payload, length);
    return frame_encode(&message, wire);
}

static size_t put_hello(uint8_t *wire)
{
    uint8_t payload[22] = {PROTOCOL_VERSION};
    for (int i = 0; i < 4; i++)
        payload[1 + i] = (uint8_t)(PROTOCOL_LAYOUT_HASH >> (8 * i));
    payload[5] = 'A';
    payload[21] = FAMILY_HALL_5V;
    return put_frame(FRAME_HELLO, 0, payload, sizeof payload, wire);
}

static size_t put_command(uint16_t sequence, int16_t forward, uint8_t *wire)
{
    const uint8_t payload[9] = {(uint8_t)forward, (uint8_t)((uint16_t)forward >> 8), 0, 0, COMMAND_ENABLE};
    return put_frame(FRAME_COMMAND, sequence, payload, sizeof payload, wire);
}

static size_t put_limit(uint16_t sequence, int16_t cap, uint8_t flags, uint8_t *wire)
{
    uint8_t payload[13] = {[8] = flags};
    for (int to = 0; to < DIRECTIONS; to++) {
        payload[2 * to] = (uint8_t)cap;
        payload[2 * to + 1] = (uint8_t)((uint16_t)cap >> 8);
    }
    return put_frame(FRAME_LIMIT, sequence, payload, sizeof payload, wire);
}

static void feed(board *self, const uint8_t *bytes, size_t length, bool may_move)
{
    input = bytes;
    input_left = length;
    while (input_left > 0) {
        const safety_outputs outputs = one_step(self);
        if (outputs.holder == HOLDER_CUT || (outputs.holder == HOLDER_BOARD && !may_move))
            abort();
        for (int axis = 0; axis < AXES; axis++)
            if (outputs.line_mv[axis] < NEUTRAL_MV - SWING_MV || outputs.line_mv[axis] > NEUTRAL_MV + SWING_MV)
                abort();
    }
}

static void start(board *self)
{
    const board_config config = {.chair_id = "A", .safety = safety_defaults(FAMILY_HALL_5V)};
    clock_ms = 0;
    lines_mv[AXIS_FORWARD] = lines_mv[AXIS_TURN] = stick_mv[AXIS_FORWARD] = stick_mv[AXIS_TURN] = NEUTRAL_MV;
    board_init(self, &config);
}

/* A board that was brought to DRIVE by the book. */
static board driving(void)
{
    board self;
    uint8_t wire[FRAME_WIRE_MAX];
    start(&self);
    feed(&self, wire, put_hello(wire), false);
    for (uint16_t sequence = 1; sequence <= 110; sequence++) {
        feed(&self, wire, put_command(sequence, sequence > 105 ? 9000 : 0, wire), sequence > 105);
        while (clock_ms < 20u * sequence)
            (void)one_step(&self);
    }
    if (self.core.state != STATE_DRIVE)
        abort();
    return self;
}

/* A board that guards by the book, with a stick that is held against its caps. */
static board guarding(void)
{
    board self;
    uint8_t wire[FRAME_WIRE_MAX];
    start(&self);
    feed(&self, wire, put_hello(wire), false);
    for (uint16_t sequence = 1; sequence <= 125; sequence++) {
        feed(&self, wire, put_limit(sequence, 1000, COMMAND_ENABLE | LIMIT_GUARD, wire), true);
        while (clock_ms < 20u * sequence)
            (void)one_step(&self);
    }
    if (self.core.state != STATE_GUARD)
        abort();
    stick_mv[AXIS_FORWARD] = NEUTRAL_MV + 700;
    stick_mv[AXIS_TURN] = NEUTRAL_MV - 90;
    return self;
}

/* No bytes give the chair more than its rider's stick while a guard or its end holds the lines. */
static void within_the_stick(const safety_outputs *outputs)
{
    for (int axis = 0; outputs->holder == HOLDER_BOARD && axis < AXES; axis++) {
        const int line = outputs->line_mv[axis] - NEUTRAL_MV, stick = stick_mv[axis] - NEUTRAL_MV;
        if (abs(line) > abs(stick) || line * stick < 0)
            abort();
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

/* The bytes arrive while the board guards: afterwards the caps are narrow, or the stick is free by its own act. */
static void feed_guarded(const board *on_guard, uint32_t now_ms, const uint8_t *data, size_t size)
{
    board self = *on_guard;
    clock_ms = now_ms;
    stick_mv[AXIS_FORWARD] = NEUTRAL_MV + 700;
    stick_mv[AXIS_TURN] = NEUTRAL_MV - 90;
    input = data;
    input_left = size;
    for (int after = 0; input_left > 0 || after < HOST_BUDGET_MS; after += input_left == 0) {
        const safety_outputs outputs = one_step(&self);
        within_the_stick(&outputs);
    }
    for (int to = 0; self.core.lost && to < DIRECTIONS; to++)
        if (self.core.guard.caps[to] > 2500)
            abort();
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static board on_the_way, on_guard;
    static uint32_t on_the_way_ms, on_guard_ms;
    static bool prepared;
    if (!prepared) {
        on_the_way = driving();
        on_the_way_ms = clock_ms;
        on_guard = guarding();
        on_guard_ms = clock_ms;
        prepared = true;
    }
    feed_guarded(&on_guard, on_guard_ms, data, size);
    board self;
    start(&self);
    feed(&self, data, size, false); /* too short for two seconds of anything: it must never move */
    self = on_the_way;
    clock_ms = on_the_way_ms;
    feed(&self, data, size, true);
    safety_outputs outputs = one_step(&self);
    for (int ms = 0; ms < HOST_BUDGET_MS; ms++)
        outputs = one_step(&self);
    if (outputs.holder != HOLDER_JOYSTICK)
        abort();
    return 0;
}

#ifndef FUZZ_TARGET_ONLY

typedef struct {
    uint8_t bytes[INPUT_MAX];
    size_t length;
} sample;

static sample corpus[CORPUS_MAX];
static size_t corpus_count;
static uint8_t seen[EDGES];
static size_t edges, new_edges;
static uint64_t random_state;

void __sanitizer_cov_trace_pc(void);

void __sanitizer_cov_trace_pc(void)
{
    uint8_t *edge = &seen[((uintptr_t)__builtin_return_address(0)) % EDGES];
    new_edges += *edge == 0;
    *edge = 1;
}

/* xorshift64* (Vigna 2016) */
static size_t draw(size_t below)
{
    random_state ^= random_state >> 12;
    random_state ^= random_state << 25;
    random_state ^= random_state >> 27;
    return (size_t)((random_state * 2685821657736338717u) >> 33) % below;
}

static void append(sample *to, const uint8_t *bytes, size_t length)
{
    if (length > INPUT_MAX - to->length)
        length = INPUT_MAX - to->length;
    memcpy(to->bytes + to->length, bytes, length);
    to->length += length;
}

enum { SETPOINT_COUNT = 6 };
static const int16_t SETPOINTS[SETPOINT_COUNT] = {0, 0, 1, 9000, -10000, 10001};

static sample changed(const sample *from)
{
    sample result = {.length = 0};
    const sample *other = &corpus[draw(corpus_count)];
    uint8_t wire[FRAME_WIRE_MAX];
    size_t at = from->length > 0 ? draw(from->length) : 0;
    switch (draw(5)) {
    case 0: /* splice */
        append(&result, from->bytes, at);
        append(&result, other->bytes, other->length);
        break;
    case 1: /* leave out */
        append(&result, from->bytes, at);
        append(&result, from->bytes + at, draw(from->length - at + 1));
        break;
    case 2: /* a valid frame with a wrong content, between two others */
        while (at < from->length && from->bytes[at++] != 0)
            continue;
        append(&result, from->bytes, at);
        if (draw(2) == 0)
            append(&result, wire, put_command((uint16_t)draw(160), SETPOINTS[draw(SETPOINT_COUNT)], wire));
        else
            append(&result, wire, put_limit((uint16_t)draw(160), SETPOINTS[draw(SETPOINT_COUNT)], (uint8_t)draw(256), wire));
        append(&result, from->bytes + at, from->length - at);
        break;
    case 3: /* a frame of any type and length */
        for (size_t i = 0; i < sizeof wire; i++)
            wire[i] = (uint8_t)draw(256);
        append(&result, from->bytes, from->length);
        uint8_t framed[FRAME_WIRE_MAX];
        append(&result, framed, put_frame((uint8_t)draw(7), 0, wire, (uint8_t)draw(FRAME_PAYLOAD_MAX + 1), framed));
        break;
    default:
        append(&result, from->bytes, from->length);
    }
    for (size_t flips = draw(4) == 0 ? draw(4) : 0; flips > 0 && result.length > 0; flips--)
        result.bytes[draw(result.length)] = (uint8_t)(draw(4) == 0 ? 0 : draw(256));
    return result;
}

static void keep_if_new(const sample *candidate)
{
    new_edges = 0;
    LLVMFuzzerTestOneInput(candidate->bytes, candidate->length);
    edges += new_edges;
    if (new_edges > 0 && corpus_count < CORPUS_MAX)
        corpus[corpus_count++] = *candidate;
}

int main(int count, char **words)
{
    if (count != 3)
        return 2;
    const unsigned long long total = strtoull(words[1], NULL, 10);
    random_state = strtoull(words[2], NULL, 10) + 1;
    sample first = {.length = 0};
    first.length = put_hello(first.bytes);
    corpus[corpus_count++] = first;
    LLVMFuzzerTestOneInput(first.bytes, 0); /* the coverage of the normal way to DRIVE is not credited to an input */
    memset(seen, 0, sizeof seen);
    unsigned long long fed = 0;
    for (unsigned long long runs = 0; fed < total; runs++) {
        sample candidate = corpus[draw(corpus_count)];
        for (size_t changes = 1 + draw(CHANGES_MAX); changes > 0; changes--)
            candidate = changed(&candidate);
        keep_if_new(&candidate);
        fed += candidate.length;
    }
    printf("%llu bytes, %zu edges, corpus of %zu\n", fed, edges, corpus_count);
    return 0;
}

#endif
