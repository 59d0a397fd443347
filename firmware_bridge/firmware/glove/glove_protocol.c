/* Messages between computer and glove: see glove_protocol.h. */
#include "glove_protocol.h"

#include <string.h>

#include "../bytes.h"

enum { HELLO_LENGTH = 22, PLAY_HEAD = 3, STEP_LENGTH = 7, ALIVE_LENGTH = 1 };

bool glove_read_hello(const frame *source, glove_hello *message)
{
    if (source->type != FRAME_GLOVE_HELLO || source->length != HELLO_LENGTH)
        return false;
    message->version = source->payload[0];
    message->layout_hash = get_u32(source->payload + 1);
    memcpy(message->device_id, source->payload + 5, GLOVE_ID_LENGTH);
    message->layout = source->payload[5 + GLOVE_ID_LENGTH];
    return true;
}

static bool read_play(const frame *source, glove_pattern *pattern)
{
    const int steps = source->length - PLAY_HEAD;
    if (steps < 0 || steps % STEP_LENGTH != 0 || steps / STEP_LENGTH > GLOVE_STEPS_MAX)
        return false;
    pattern->priority = source->payload[0];
    pattern->valid_ms = get_u16(source->payload + 1);
    pattern->count = (uint8_t)(steps / STEP_LENGTH);
    pattern->sequence = source->sequence;
    for (int i = 0; i < pattern->count; i++) {
        const uint8_t *bytes = source->payload + PLAY_HEAD + i * STEP_LENGTH;
        pattern->steps[i] = (glove_step){get_u16(bytes), bytes[2], get_u16(bytes + 3), get_u16(bytes + 5)};
    }
    return true;
}

static bool has_length(const frame *source, glove_message *message, glove_event event, int length)
{
    message->event = (uint8_t)event;
    return source->length == length;
}

bool glove_read_order(const frame *source, glove_message *message)
{
    message->sequence = source->sequence;
    switch (source->type) {
    case FRAME_GLOVE_PLAY:
        message->event = GLOVE_PLAY;
        return read_play(source, &message->pattern);
    case FRAME_GLOVE_STOP:
        return has_length(source, message, GLOVE_STOP, 0);
    case FRAME_GLOVE_GAIN:
        if (!has_length(source, message, GLOVE_GAIN, GLOVE_MOTORS_MAX))
            return false;
        memcpy(message->gain, source->payload, GLOVE_MOTORS_MAX);
        return true;
    case FRAME_GLOVE_ALIVE:
        if (!has_length(source, message, GLOVE_ALIVE, ALIVE_LENGTH) || source->payload[0] > 1)
            return false;
        message->armed = source->payload[0] == 1;
        return true;
    default:
        return false;
    }
}

void glove_write_reply(const glove_reply *message, frame *result)
{
    uint8_t *at = result->payload;
    result->type = FRAME_GLOVE_REPLY;
    at = put_u8(at, message->version);
    at = put_u32(at, message->layout_hash);
    at = put_u16(at, message->firmware_version);
    memcpy(at, message->device_id, GLOVE_ID_LENGTH);
    at = put_u8(at + GLOVE_ID_LENGTH, message->layout);
    at = put_u8(at, message->motors);
    at = put_u8(at, message->hand);
    at = put_u8(at, message->refused);
    result->length = (uint8_t)(at - result->payload);
}

void glove_write_status(const glove_status *message, frame *result)
{
    uint8_t *at = result->payload;
    result->type = FRAME_GLOVE_STATUS;
    at = put_u8(at, message->state);
    at = put_u8(at, message->playing);
    at = put_u16(at, message->sequence);
    at = put_u8(at, message->step);
    at = put_u16(at, message->on);
    at = put_u16(at, message->judged);
    at = put_u8(at, message->refused);
    at = put_u8(at, message->cut);
    at = put_u16(at, message->open);
    at = put_u16(at, message->shorted);
    at = put_u8(at, message->worn);
    at = put_u8(at, message->presses[BUTTON_REPEAT]);
    at = put_u8(at, message->presses[BUTTON_YES]);
    at = put_u8(at, (uint8_t)message->temperature_c);
    at = put_u32(at, message->board_ms);
    at = put_u16(at, message->bad_frames);
    at = put_u16(at, message->rejected);
    result->length = (uint8_t)(at - result->payload);
}
