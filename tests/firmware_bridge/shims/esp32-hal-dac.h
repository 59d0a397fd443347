/* The part of the Arduino core for ESP32 that the firmware calls, as declarations only; bodies in fake_esp32.c. */
#ifndef SHIM_ESP32_HAL_DAC_H
#define SHIM_ESP32_HAL_DAC_H

#include <stdbool.h>
#include <stdint.h>

bool dacWrite(uint8_t pin, uint8_t value);

#endif
