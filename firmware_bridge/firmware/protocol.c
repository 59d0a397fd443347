/* Messages between computer and board: see protocol.h. */
#include "protocol.h"

#include <string.h>

enum { HELLO_LENGTH = 22, COMMAND_LENGTH = 9, LIMIT_LENGTH = 13 };

static uint16_t get_u16(const uint8_t *bytes)
{
    return (uint16_t)(bytes[0] | (bytes[1] << 8));
}

static uint32_t get_u32(const uint8_t *bytes)
{
    return (uint32_t)get_u16(bytes) | ((uint32_t)get_u16(bytes + 2) << 16);
}

/* Two's complement, independent of the compiler's conversion. */
static int16_t get_i16(const uint8_t *bytes)
{
    const int32_t value = get_u16(bytes);
    return (int16_t)(value < 0x8000 ? value : value - 0x10000);
}

static void put_u8(frame *result, uint8_t value)
{
    result->payload[result->length++] = value;
}

static void put_u16(frame *result, uint16_t value)
{
    put_u8(result, (uint8_t)value);
    put_u8(result, (uint8_t)(value >> 8));
}

static void put_u32(frame *result, uint32_t value)
{
    put_u16(result, (uint16_t)value);
    put_u16(result, (uint16_t)(value >> 16));
}

bool protocol_read_hello(const frame *source, hello *message)
{
    if (source->type != FRAME_HELLO || source->length != HELLO_LENGTH)
        return false;
    message->version = source->payload[0];
    message->layout_hash = get_u32(source->payload + 1);
    memcpy(message->chair_id, source->payload + 5, CHAIR_ID_LENGTH);
    message->family = source->payload[5 + CHAIR_ID_LENGTH];
    return true;
}

bool protocol_read_command(const frame *source, command *message)
{
    if (source->type != FRAME_COMMAND || source->length != COMMAND_LENGTH)
        return false;
    message->setpoint[AXIS_FORWARD] = get_i16(source->payload);
    message->setpoint[AXIS_TURN] = get_i16(source->payload + 2);
    message->flags = source->payload[4];
    message->stamp_us = get_u32(source->payload + 5);
    return true;
}

bool protocol_read_limit(const frame *source, limit *message)
{
    if (source->type != FRAME_LIMIT || source->length != LIMIT_LENGTH)
        return false;
    for (int to = 0; to < DIRECTIONS; to++)
        message->caps[to] = get_u16(source->payload + 2 * to);
    message->flags = source->payload[8];
    message->stamp_us = get_u32(source->payload + 9);
    return true;
}

void protocol_write_hello_reply(const hello_reply *message, frame *result)
{
    result->type = FRAME_HELLO_REPLY;
    result->length = 0;
    put_u8(result, message->version);
    put_u32(result, message->layout_hash);
    put_u16(result, message->firmware_version);
    for (int i = 0; i < CHAIR_ID_LENGTH; i++)
        put_u8(result, (uint8_t)message->chair_id[i]);
    put_u8(result, message->family);
    put_u8(result, message->refused);
    put_u8(result, message->dac_bits);
    put_u16(result, message->dac_counts_max);
    put_u16(result, message->reference_mv);
    put_u16(result, message->swing_mv);
    put_u16(result, message->dac_low_mv);
    put_u16(result, message->dac_high_mv);
}

void protocol_write_telemetry(const telemetry *message, frame *result)
{
    result->type = FRAME_TELEMETRY;
    result->length = 0;
    put_u8(result, message->state);
    put_u8(result, message->holder);
    put_u16(result, message->faults);
    put_u16(result, message->set_mv[AXIS_FORWARD]);
    put_u16(result, message->set_mv[AXIS_TURN]);
    put_u16(result, message->line_mv[AXIS_FORWARD]);
    put_u16(result, message->line_mv[AXIS_TURN]);
    put_u16(result, message->reference_mv);
    put_u16(result, message->joystick_mv[AXIS_FORWARD]);
    put_u16(result, message->joystick_mv[AXIS_TURN]);
    put_u16(result, message->echo_sequence);
    put_u32(result, message->echo_stamp_us);
    put_u32(result, message->board_ms);
    put_u16(result, message->bad_frames);
    put_u16(result, message->rejected);
    for (int to = 0; to < DIRECTIONS; to++)
        put_u16(result, message->caps[to]);
    put_u8(result, message->guard_bits);
}
