/* The HAL on a computer: see hal_host.h. */
#include "hal_host.h"

#include <poll.h>
#include <unistd.h>

enum { RECEIVE_BUFFER = 4096, PATIENCE_MS = 1000 };

host_hal HOST = {.serial = -1};

static uint8_t buffer[RECEIVE_BUFFER];
static size_t buffer_start, buffer_end;

static bool wait_for_bytes(void)
{
    struct pollfd line = {.fd = HOST.serial, .events = POLLIN};
    return poll(&line, 1, PATIENCE_MS) > 0;
}

static void fill(void)
{
    if (buffer_start == buffer_end)
        buffer_start = buffer_end = 0;
    const ssize_t count = read(HOST.serial, buffer + buffer_end, RECEIVE_BUFFER - buffer_end);
    if (count > 0) {
        buffer_end += (size_t)count;
        HOST.received += (uint32_t)count;
    }
}

void host_receive(uint32_t total)
{
    fill();
    while ((int32_t)(total - HOST.received) > 0 && buffer_end < RECEIVE_BUFFER && wait_for_bytes())
        fill();
}

void hal_begin(const joystick_family *family)
{
    hardware_begin(&HOST.around, family, HOST.converter.counts_max);
}

hal_converter hal_converter_of_board(void)
{
    return HOST.converter;
}

uint32_t hal_now_ms(void)
{
    return HOST.around.now_ms;
}

bool hal_read_byte(uint8_t *byte)
{
    if (buffer_start == buffer_end)
        return false;
    *byte = buffer[buffer_start++];
    return true;
}

void hal_write(const uint8_t *bytes, size_t length)
{
    const ssize_t count = write(HOST.serial, bytes, length);
    if (count > 0)
        HOST.sent += (uint32_t)count;
}

void hal_sense(safety_inputs *inputs)
{
    for (int axis = 0; axis < AXES; axis++) {
        inputs->joystick_mv[axis] = hardware_stick_mv(&HOST.around, axis);
        inputs->line_mv[axis] = hardware_line_mv(&HOST.around, axis);
    }
    inputs->reference_mv = HOST.around.reference_mv;
    inputs->estop_released = HOST.around.estop_released;
    inputs->board_ok = true;
}

bool hal_put(const uint16_t line_mv[AXES])
{
    return HOST.around.family == NULL || hardware_put(&HOST.around, line_mv);
}

void hal_switch(uint8_t holder)
{
    HOST.around.wanted = holder;
}

void hal_kick(void)
{
    hardware_kick(&HOST.around);
}
