/* Messages between computer and board, as payloads of frames (frame.h), little endian, without padding.
 * firmware_bridge/protocol.py holds the same table; its CRC-32 is PROTOCOL_LAYOUT_HASH. Another hash is refused. */
#ifndef WAYCHAIR_PROTOCOL_H
#define WAYCHAIR_PROTOCOL_H

#include <stdbool.h>
#include <stdint.h>

#include "frame.h"
#include "safety_core.h"

static const uint8_t PROTOCOL_VERSION = 2;
static const uint32_t PROTOCOL_LAYOUT_HASH = 0xDB0DE5A4u;
static const uint16_t FIRMWARE_VERSION = 0x0200; /* major, minor */

enum { CHAIR_ID_LENGTH = 16 }; /* padded with zeros */

typedef enum { FRAME_HELLO = 1, FRAME_HELLO_REPLY = 2, FRAME_COMMAND = 3, FRAME_TELEMETRY = 4, FRAME_LIMIT = 5 } frame_type;

enum {
    REFUSED_VERSION = 1 << 0,
    REFUSED_LAYOUT = 1 << 1,
    REFUSED_CHAIR = 1 << 2,
    REFUSED_FAMILY = 1 << 3,       /* the computer was calibrated with another joystick family */
    REFUSED_CONFIG = 1 << 4        /* the board has no family or impossible limits of its own */
};

typedef struct {
    uint8_t version;
    uint32_t layout_hash;
    char chair_id[CHAIR_ID_LENGTH];
    uint8_t family;
} hello;

typedef struct {
    uint8_t version;
    uint32_t layout_hash;
    uint16_t firmware_version;
    char chair_id[CHAIR_ID_LENGTH];
    uint8_t family;
    uint8_t refused;               /* REFUSED_ bits; 0: the computer may drive */
    uint8_t dac_bits;
    uint16_t dac_counts_max;
    uint16_t reference_mv;
    uint16_t swing_mv;
    uint16_t dac_low_mv;
    uint16_t dac_high_mv;
} hello_reply;

typedef struct {
    int16_t setpoint[AXES];        /* 1/10000 of the swing; forward, and turn to the right */
    uint8_t flags;
    uint32_t stamp_us;             /* the computer's clock, only echoed */
} command;

typedef struct {
    uint16_t caps[DIRECTIONS];     /* of the rider's stick, 1/10000 of the swing; front, rear, left, right */
    uint8_t flags;                 /* those of a command, LIMIT_GUARD, and a drop-off's bit for each direction */
    uint32_t stamp_us;
} limit;

typedef struct {
    uint8_t state;
    uint8_t holder;
    uint16_t faults;
    uint16_t set_mv[AXES];         /* voltages commanded to the converter */
    uint16_t line_mv[AXES];
    uint16_t reference_mv;
    uint16_t joystick_mv[AXES];
    uint16_t echo_sequence;        /* of the last accepted command */
    uint32_t echo_stamp_us;
    uint32_t board_ms;
    uint16_t bad_frames;
    uint16_t rejected;             /* valid frames outside the sequence window or without a session */
    uint16_t caps[DIRECTIONS];     /* of the guard, in force now */
    uint8_t guard_bits;            /* of guard.h */
} telemetry;

/* False: the frame has another type or length. */
bool protocol_read_hello(const frame *source, hello *message);
bool protocol_read_command(const frame *source, command *message);
bool protocol_read_limit(const frame *source, limit *message);

/* Fill type, length and payload of the frame; the caller sets its sequence. */
void protocol_write_hello_reply(const hello_reply *message, frame *result);
void protocol_write_telemetry(const telemetry *message, frame *result);

#endif
