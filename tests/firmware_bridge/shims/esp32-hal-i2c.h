/* The part of the Arduino core for ESP32 that the firmware calls, as declarations only; bodies in fake_esp32.c. */
#ifndef SHIM_ESP32_HAL_I2C_H
#define SHIM_ESP32_HAL_I2C_H

#include <stddef.h>
#include <stdint.h>

#include "esp_err.h"

esp_err_t i2cInit(uint8_t bus, int8_t sda, int8_t scl, uint32_t frequency);
esp_err_t i2cWrite(uint8_t bus, uint16_t address, const uint8_t *bytes, size_t size, uint32_t timeout_ms);
esp_err_t i2cRead(uint8_t bus, uint16_t address, uint8_t *bytes, size_t size, uint32_t timeout_ms, size_t *count);

#endif
