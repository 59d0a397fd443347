/* The hardware abstraction layer of a glove: clock, serial line, sensors, buttons and motors. Each board implements all
 * of it in its own folder. No call may wait. */
#ifndef WAYCHAIR_GLOVE_HAL_H
#define WAYCHAIR_GLOVE_HAL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "glove_core.h"

/* Starts the hardware with all motors at rest. */
void glove_hal_begin(uint8_t motors);

/* Monotonic milliseconds, modulo 2^32. */
uint32_t glove_hal_now_ms(void);

/* Takes one received byte; false if there is none. */
bool glove_hal_read_byte(uint8_t *byte);

/* Bytes beyond the buffer are lost: the next report follows 50 ms later. */
void glove_hal_write(const uint8_t *bytes, size_t length);

/* Fills all inputs except `host`. */
void glove_hal_sense(glove_inputs *inputs);

/* Drives the motors. */
void glove_hal_put(const uint8_t level[GLOVE_MOTORS_MAX]);

/* Tells the watchdog that the loop is alive; without it the processor is reset, which stops the motors. */
void glove_hal_kick(void);

#endif
