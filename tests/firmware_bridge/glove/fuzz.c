/* Fuzz target and driver of the glove: the whole loop on bytes that grow out of valid frames, and on random commands. An
 * own, exact account of every motor's vibration judges each millisecond.
 *
 *   fuzz bytes COUNT SEED      feeds this many bytes in all; prints the coverage
 *   fuzz commands COUNT SEED   sends this many valid commands at random times; prints the worst of each limit
 *
 * It aborts on the first broken promise. The firmware's objects are compiled with -fsanitize-coverage=trace-pc. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "glove/glove_board.h"
#include "glove/glove_hal.h"

enum {
    MOTORS = 9,
    INPUT_MAX = 512,
    CORPUS_MAX = 1024,
    CHANGES_MAX = 8,
    EDGES = 1 << 16,
    BYTES_PER_MS = 12,
    WINDOW_MS = 10000,
    DUTY_MS = 5000,
    RUN_MS = 500,
    CROWD = 4,
    CROWD_MS = 250,
    CALM_MS = 250,
    QUIET_MS = 1300                /* silence, its pattern of 700 ms, and something more */
};

static const uint8_t *input;
static size_t input_left, room;
static uint32_t clock_ms;
static glove_inputs sensed;
static uint8_t driven[GLOVE_MOTORS_MAX];
static glove_board BOARD;

static struct {
    uint8_t was_on[WINDOW_MS][GLOVE_MOTORS_MAX];
    uint32_t at;
    uint32_t duty[GLOVE_MOTORS_MAX], run[GLOVE_MOTORS_MAX], crowd, calm;
    uint32_t worst_duty, worst_run, worst_crowd;
} account;

void glove_hal_begin(uint8_t motors)
{
    (void)motors;
    memset(driven, 0, sizeof driven);
}

uint32_t glove_hal_now_ms(void)
{
    return clock_ms;
}

bool glove_hal_read_byte(uint8_t *byte)
{
    if (input_left == 0 || room == 0)
        return false;
    *byte = *input++;
    input_left--;
    room--;
    return true;
}

void glove_hal_write(const uint8_t *bytes, size_t length)
{
    frame_decoder decoder;
    frame sent;
    frame_decoder_init(&decoder);
    for (size_t i = 0; i < length; i++)
        if (frame_decode(&decoder, bytes[i], &sent) == DECODED_BAD)
            abort();
}

void glove_hal_sense(glove_inputs *inputs)
{
    *inputs = sensed;
}

void glove_hal_put(const uint8_t level[GLOVE_MOTORS_MAX])
{
    memcpy(driven, level, sizeof driven);
}

void glove_hal_kick(void)
{
}

static void keep_greatest(uint32_t *greatest, uint32_t value)
{
    *greatest = value > *greatest ? value : *greatest;
}

static void judge(void)
{
    int on = 0;
    for (int motor = 0; motor < GLOVE_MOTORS_MAX; motor++) {
        uint8_t *before = &account.was_on[account.at][motor];
        const bool now = driven[motor] > 0;
        if (now && (motor >= MOTORS || !sensed.worn || ((sensed.open | sensed.shorted) >> motor & 1)))
            abort();
        account.duty[motor] += now;
        account.duty[motor] -= *before;
        *before = now;
        account.run[motor] = now ? account.run[motor] + 1 : 0;
        keep_greatest(&account.worst_duty, account.duty[motor]);
        keep_greatest(&account.worst_run, account.run[motor]);
        on += now;
    }
    account.at = (account.at + 1) % WINDOW_MS;
    account.calm = on > CROWD ? 0 : account.calm + 1;
    account.crowd = on > CROWD ? account.crowd + 1 : account.calm >= CALM_MS ? 0 : account.crowd;
    keep_greatest(&account.worst_crowd, account.crowd);
    if (account.worst_duty > DUTY_MS || account.worst_run > RUN_MS || account.worst_crowd > CROWD_MS)
        abort();
}

static void one_step(void)
{
    clock_ms++;
    room = BYTES_PER_MS;
    (void)glove_board_step(&BOARD);
    judge();
}

/* The clock jumps. No board can switch a motor off while it is frozen, so this time is nobody's vibration; but it passes, and
 * rest is rest. */
static void freeze(uint32_t ms)
{
    clock_ms += ms;
    account.calm += account.calm > 0 ? ms : 0;
    account.crowd = account.calm >= CALM_MS ? 0 : account.crowd;
    for (; ms > 0; ms--) {
        for (int motor = 0; motor < GLOVE_MOTORS_MAX; motor++) {
            account.duty[motor] -= account.was_on[account.at][motor];
            account.was_on[account.at][motor] = 0;
        }
        account.at = (account.at + 1) % WINDOW_MS;
    }
}

static void start(void)
{
    memset(account.was_on, 0, sizeof account.was_on); /* a reboot forgets how warm the motors are */
    memset(account.duty, 0, sizeof account.duty);
    memset(account.run, 0, sizeof account.run);
    account.crowd = account.calm = 0;
    const glove_config config = {.device_id = "A", .layout = 1, .motors = MOTORS, .hand = HAND_RIGHT};
    sensed = (glove_inputs){.worn = true, .temperature_c = 25};
    glove_board_init(&BOARD, &config);
}

static size_t put_frame(uint8_t type, uint16_t sequence, const uint8_t *payload, uint8_t length, uint8_t *wire)
{
    frame message = {.type = type, .sequence = sequence, .length = length};
    memcpy(message.payload, payload, length);
    return frame_encode(&message, wire);
}

static size_t put_hello(uint8_t *wire)
{
    uint8_t payload[22] = {GLOVE_PROTOCOL_VERSION};
    for (int i = 0; i < 4; i++)
        payload[1 + i] = (uint8_t)(GLOVE_LAYOUT_HASH >> (8 * i));
    payload[5] = 'A';
    payload[21] = 1;
    return put_frame(FRAME_GLOVE_HELLO, 0, payload, sizeof payload, wire);
}

/* xorshift64* (Vigna 2016) */
static uint64_t random_state;

static size_t draw(size_t below)
{
    random_state ^= random_state >> 12;
    random_state ^= random_state << 25;
    random_state ^= random_state >> 27;
    return (size_t)((random_state * 2685821657736338717u) >> 33) % below;
}

static const uint16_t TIMES[] = {0, 0, 1, 3, 20, 50, 112, 150, 250, 499, 500, 501, 2000, 2001};
enum { TIME_COUNT = sizeof TIMES / sizeof TIMES[0] };

/* A PLAY; most are possible, and those that are not break one limit. */
static size_t put_play(uint16_t sequence, uint8_t *wire)
{
    uint8_t payload[FRAME_PAYLOAD_MAX] = {(uint8_t)(99 + draw(3)), (uint8_t)draw(256), (uint8_t)draw(4)};
    uint8_t length = 3;
    for (size_t steps = draw(draw(3) == 0 ? GLOVE_STEPS_MAX + 2 : 4); steps > 0; steps--) {
        const unsigned mask = draw(3) == 0 ? (unsigned)draw(draw(16) == 0 ? 1024 : 512) : 1u << (draw(2) == 0 ? 3 : draw(MOTORS));
        const uint16_t on_ms = TIMES[2 + draw(draw(16) == 0 ? TIME_COUNT - 2 : 9)], off_ms = TIMES[draw(draw(8) == 0 ? TIME_COUNT : 7)];
        const uint8_t step[7] = {(uint8_t)mask, (uint8_t)(mask >> 8), (uint8_t)(draw(64) == 0 ? 0 : 255),
                                 (uint8_t)on_ms, (uint8_t)(on_ms >> 8), (uint8_t)off_ms, (uint8_t)(off_ms >> 8)};
        memcpy(payload + length, step, sizeof step);
        length = (uint8_t)(length + sizeof step);
    }
    return put_frame(FRAME_GLOVE_PLAY, sequence, payload, length, wire);
}

/* As much of one motor as a step may hold. */
static size_t put_long(uint16_t sequence, uint8_t *wire)
{
    const uint16_t on_ms = (uint16_t)(400 + draw(101));
    const uint8_t payload[10] = {100, 0, 4, 1 << 3, 0, 255, (uint8_t)on_ms, (uint8_t)(on_ms >> 8), (uint8_t)draw(3), 0};
    return put_frame(FRAME_GLOVE_PLAY, sequence, payload, sizeof payload, wire);
}

static size_t put_alive(uint16_t sequence, uint8_t armed, uint8_t *wire)
{
    return put_frame(FRAME_GLOVE_ALIVE, sequence, &armed, 1, wire);
}

static void feed(const uint8_t *bytes, size_t length)
{
    input = bytes;
    input_left = length;
    while (input_left > 0)
        one_step();
}

/* After silence long enough for the board's own pattern, every motor rests. */
static void must_fall_silent(void)
{
    for (int ms = 0; ms < QUIET_MS; ms++)
        one_step();
    for (int ms = 0; ms < GLOVE_SILENCE_MS; ms++) {
        one_step();
        for (int motor = 0; motor < GLOVE_MOTORS_MAX; motor++)
            if (driven[motor] > 0)
                abort();
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    uint8_t wire[FRAME_WIRE_MAX];
    start();
    feed(data, size);
    start();
    feed(wire, put_hello(wire));
    feed(wire, put_alive(1, 1, wire));
    feed(data, size);
    must_fall_silent();
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

void __sanitizer_cov_trace_pc(void);

void __sanitizer_cov_trace_pc(void)
{
    uint8_t *edge = &seen[((uintptr_t)__builtin_return_address(0)) % EDGES];
    new_edges += *edge == 0;
    *edge = 1;
}

static void append(sample *to, const uint8_t *bytes, size_t length)
{
    if (length > INPUT_MAX - to->length)
        length = INPUT_MAX - to->length;
    memcpy(to->bytes + to->length, bytes, length);
    to->length += length;
}

static sample changed(const sample *from)
{
    sample result = {.length = 0};
    const sample *other = &corpus[draw(corpus_count)];
    uint8_t wire[FRAME_WIRE_MAX], framed[FRAME_WIRE_MAX];
    size_t at = from->length > 0 ? draw(from->length) : 0;
    switch (draw(6)) {
    case 0: /* splice */
        append(&result, from->bytes, at);
        append(&result, other->bytes, other->length);
        break;
    case 1: /* leave out */
        append(&result, from->bytes, at);
        append(&result, from->bytes + at, draw(from->length - at + 1));
        break;
    case 2: /* a pattern between two frames */
        while (at < from->length && from->bytes[at++] != 0)
            continue;
        append(&result, from->bytes, at);
        append(&result, wire, put_play((uint16_t)draw(12), wire));
        append(&result, from->bytes + at, from->length - at);
        break;
    case 3: /* a frame of any type and length */
        for (size_t i = 0; i < sizeof wire; i++)
            wire[i] = (uint8_t)draw(256);
        append(&result, from->bytes, from->length);
        append(&result, framed, put_frame((uint8_t)(64 + draw(9)), (uint16_t)draw(12), wire, (uint8_t)draw(FRAME_PAYLOAD_MAX + 1), framed));
        break;
    case 4:
        append(&result, from->bytes, from->length);
        append(&result, wire, put_alive((uint16_t)draw(12), (uint8_t)draw(3), wire));
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

static int fuzz_bytes(unsigned long long total)
{
    sample first = {.length = 0};
    first.length = put_hello(first.bytes);
    corpus[corpus_count++] = first;
    LLVMFuzzerTestOneInput(first.bytes, 0); /* the coverage of a session is not credited to an input */
    memset(seen, 0, sizeof seen);
    unsigned long long fed = 0;
    while (fed < total) {
        sample candidate = corpus[draw(corpus_count)];
        for (size_t changes = 1 + draw(CHANGES_MAX); changes > 0; changes--)
            candidate = changed(&candidate);
        keep_if_new(&candidate);
        fed += candidate.length;
    }
    printf("%llu bytes, %zu edges, corpus of %zu\n", fed, edges, corpus_count);
    return 0;
}

static int random_commands(unsigned long long total)
{
    uint8_t wire[FRAME_WIRE_MAX];
    uint16_t sequence = 0;
    start();
    feed(wire, put_hello(wire));
    for (unsigned long long sent = 0; sent < total; sent++) {
        const size_t kind = draw(32);
        const bool hard = sent % 256 < 64; /* times in which motors are worked as hard as they may be */
        if (hard && kind < 28)
            feed(wire, put_long(++sequence, wire));
        else if (kind < 28)
            feed(wire, put_play(++sequence, wire));
        else if (kind == 28)
            feed(wire, put_frame(FRAME_GLOVE_STOP, ++sequence, wire, 0, wire));
        else
            feed(wire, put_alive(++sequence, 1, wire));
        if (draw(64) == 0)
            sensed.open = draw(2) == 0 ? 0 : (uint16_t)draw(512);
        if (draw(64) == 0)
            sensed.worn = draw(4) > 0;
        if (draw(256) == 0)
            freeze((uint32_t)draw(3) * 40);
        for (size_t ms = draw(hard || draw(8) == 0 ? 480 : 200); ms > 0; ms--)
            one_step();
        if (BOARD.core.state == GLOVE_WAITING || BOARD.core.state == GLOVE_LOST) {
            sequence = 0;
            feed(wire, put_hello(wire));
        }
    }
    printf("%llu commands, %u ms, worst duty %u, run %u, crowd %u\n", total, clock_ms, account.worst_duty,
           account.worst_run, account.worst_crowd);
    return 0;
}

int main(int count, char **words)
{
    if (count != 4)
        return 2;
    const unsigned long long total = strtoull(words[2], NULL, 10);
    random_state = strtoull(words[3], NULL, 10) + 1;
    return strcmp(words[1], "commands") == 0 ? random_commands(total) : fuzz_bytes(total);
}

#endif
