/* What a board must offer: a clock, a serial line, its senses, a converter, the line switch and the external watchdog.
 * Each board implements all of it in its own folder; nothing above this file knows which one it is. No call may wait. */
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

/* Bring the hardware up with the lines at the joystick; sees that the converter wakes up at neutral. */
void hal_begin(const joystick_family *family);

hal_converter hal_converter_of_board(void);

/* Monotonic milliseconds, modulo 2^32. */
uint32_t hal_now_ms(void);

/* One received byte, if there is one. */
bool hal_read_byte(uint8_t *byte);

/* Bytes that find no room are lost: the computer is told again 20 ms later. */
void hal_write(const uint8_t *bytes, size_t length);

/* Fill everything but `host`. */
void hal_sense(safety_inputs *inputs);

/* Put the converter at these line voltages; false when it did not take them. */
bool hal_put(const uint16_t line_mv[AXES]);

/* Who is on the lines. The joystick is what an unpowered or reset board leaves (normally closed). */
void hal_switch(uint8_t holder);

/* Tell the external window watchdog that the loop is alive. */
void hal_kick(void);

#endif
