/* The two ways in which an ESP32 board can drive its motors. Exactly one of motors_pwm.c and motors_drv2605.c is linked. */
#ifndef WAYCHAIR_GLOVE_MOTORS_H
#define WAYCHAIR_GLOVE_MOTORS_H

#include <stdint.h>

#include "../glove_core.h"

/* Sets all motors to rest; may take a second. */
void motors_begin(uint8_t count);

void motors_put(const uint8_t level[GLOVE_MOTORS_MAX], uint32_t now_ms);

/* Motors by bit that were found broken. */
uint16_t motors_open(void);
uint16_t motors_shorted(void);

#endif
