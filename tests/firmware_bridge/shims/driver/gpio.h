/* The part of Espressif's IDF that the firmware calls, as declarations only; bodies in fake_esp32.c. */
#ifndef SHIM_DRIVER_GPIO_H
#define SHIM_DRIVER_GPIO_H

#include <stdint.h>

#include "esp_err.h"

typedef enum { GPIO_NUM_0 = 0, GPIO_NUM_MAX = 40 } gpio_num_t;

esp_err_t gpio_set_level(gpio_num_t pin, uint32_t level);

#endif
