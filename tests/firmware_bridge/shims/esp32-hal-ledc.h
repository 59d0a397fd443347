/* The part of the Arduino core for ESP32 that the firmware calls, as declarations only. */
#ifndef SHIM_ESP32_HAL_LEDC_H
#define SHIM_ESP32_HAL_LEDC_H

#include <stdbool.h>
#include <stdint.h>

bool ledcAttach(uint8_t pin, uint32_t frequency, uint8_t resolution);
bool ledcWrite(uint8_t pin, uint32_t duty);

#endif
