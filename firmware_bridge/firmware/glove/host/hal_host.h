/* The HAL of a glove on a computer: a file descriptor instead of a UART, numbers instead of motors and sensors. */
#ifndef WAYCHAIR_GLOVE_HAL_HOST_H
#define WAYCHAIR_GLOVE_HAL_HOST_H

#include "../glove_hal.h"

enum { HOST_WATCHDOG_MS = 100 }; /* without a kick for so long the processor is reset */

typedef struct {
    int serial;                    /* open, not blocking; -1 without a cable */
    uint32_t received;             /* bytes since the start, modulo 2^32 */
    uint32_t sent;
    uint32_t now_ms;
    uint32_t kick_ms;
    glove_inputs sensed;
    uint8_t driven[GLOVE_MOTORS_MAX];
} glove_host;

extern glove_host GLOVE_HOST;

/* Reads the line, and waits up to a second until `total` bytes have come since the start: a pseudo-terminal delivers
 * bytes a little later than it accepts them. */
void glove_host_receive(uint32_t total);

/* The levels that the motors really get: an open or shorted one does not vibrate. */
void glove_host_levels(uint8_t level[GLOVE_MOTORS_MAX]);

#endif
