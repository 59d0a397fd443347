/* The hardware abstraction layer: clock, serial line, inputs, converter, line switch and external watchdog. Each board
 * implements all of it in its own folder; code above this file does not depend on the board. No call may wait. */
#ifndef WAYCHAIR_HAL_H
#define WAYCHAIR_HAL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "families.h"
#include "safety_core.h"

typedef struct {
    uint8_t bits;
    uint16_t counts_max;
} hal_converter;

/* Starts the hardware with the lines at the joystick and makes sure that the converter powers up at neutral. */
void hal_begin(const joystick_family *family);

hal_converter hal_converter_of_board(void);

/* Monotonic milliseconds, modulo 2^32. */
uint32_t hal_now_ms(void);

/* Takes one received byte; false if there is none. */
bool hal_read_byte(uint8_t *byte);

/* Bytes beyond the buffer are lost: the next telemetry follows 20 ms later. */
void hal_write(const uint8_t *bytes, size_t length);

/* Fills all inputs except `host`. */
void hal_sense(safety_inputs *inputs);

/* Sets the converter to these line voltages; false if it did not accept them. */
bool hal_put(const uint16_t line_mv[AXES]);

/* Connects a holder to the lines. Without power or in reset the joystick is connected (normally closed). */
void hal_switch(uint8_t holder);

/* Tells the external window watchdog that the loop is alive. */
void hal_kick(void);

#endif
