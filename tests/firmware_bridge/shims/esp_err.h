/* The part of Espressif's IDF that the firmware uses. */
#ifndef SHIM_ESP_ERR_H
#define SHIM_ESP_ERR_H

typedef int esp_err_t;
enum { ESP_OK = 0, ESP_FAIL = -1 };

#endif
