/* The HAL of a glove on a computer: see hal_host.h. */
#include "hal_host.h"

#include <poll.h>
#include <string.h>
#include <unistd.h>

enum { RECEIVE_BUFFER = 4096, PATIENCE_MS = 1000 };

glove_host GLOVE_HOST = {.serial = -1};

static uint8_t buffer[RECEIVE_BUFFER];
static size_t buffer_start, buffer_end;

static bool wait_for_bytes(void)
{
    struct pollfd line = {.fd = GLOVE_HOST.serial, .events = POLLIN};
    return poll(&line, 1, PATIENCE_MS) > 0;
}

static void fill(void)
{
    if (buffer_start == buffer_end)
        buffer_start = buffer_end = 0;
    const ssize_t count = read(GLOVE_HOST.serial, buffer + buffer_end, RECEIVE_BUFFER - buffer_end);
    if (count > 0) {
        buffer_end += (size_t)count;
        GLOVE_HOST.received += (uint32_t)count;
    }
}

void glove_host_receive(uint32_t total)
{
    fill();
    while ((int32_t)(total - GLOVE_HOST.received) > 0 && buffer_end < RECEIVE_BUFFER && wait_for_bytes())
        fill();
}

void glove_host_levels(uint8_t level[GLOVE_MOTORS_MAX])
{
    const unsigned dead = GLOVE_HOST.sensed.open | GLOVE_HOST.sensed.shorted;
    for (int motor = 0; motor < GLOVE_MOTORS_MAX; motor++)
        level[motor] = (dead >> motor & 1) ? 0 : GLOVE_HOST.driven[motor];
}

void glove_hal_begin(uint8_t motors)
{
    (void)motors;
    memset(GLOVE_HOST.driven, 0, sizeof GLOVE_HOST.driven);
    GLOVE_HOST.kick_ms = GLOVE_HOST.now_ms;
}

uint32_t glove_hal_now_ms(void)
{
    return GLOVE_HOST.now_ms;
}

bool glove_hal_read_byte(uint8_t *byte)
{
    if (buffer_start == buffer_end)
        return false;
    *byte = buffer[buffer_start++];
    return true;
}

void glove_hal_write(const uint8_t *bytes, size_t length)
{
    const ssize_t count = write(GLOVE_HOST.serial, bytes, length);
    if (count > 0)
        GLOVE_HOST.sent += (uint32_t)count;
}

void glove_hal_sense(glove_inputs *inputs)
{
    *inputs = GLOVE_HOST.sensed;
}

void glove_hal_put(const uint8_t level[GLOVE_MOTORS_MAX])
{
    memcpy(GLOVE_HOST.driven, level, sizeof GLOVE_HOST.driven);
}

void glove_hal_kick(void)
{
    GLOVE_HOST.kick_ms = GLOVE_HOST.now_ms;
}
