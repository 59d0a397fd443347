/* The HAL on a computer: the model of hardware.h instead of pins, a file descriptor instead of a UART. */
#ifndef WAYCHAIR_HAL_HOST_H
#define WAYCHAIR_HAL_HOST_H

#include "../hal.h"
#include "hardware.h"

typedef struct {
    hardware around;
    hal_converter converter;
    int serial;                    /* open, not blocking; -1 without a cable */
    uint32_t received;             /* bytes since the start, modulo 2^32 */
    uint32_t sent;
} host_hal;

extern host_hal HOST;

/* Reads the line into the receive buffer, and waits up to a second until `total` bytes have come since the start: a
 * pseudo-terminal delivers bytes a little later than it accepts them. */
void host_receive(uint32_t total);

#endif
