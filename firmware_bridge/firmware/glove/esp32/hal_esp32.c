/* The HAL of a glove on an ESP32 by the Arduino core's C functions. Compiled in the tests against shims of its headers; NOT
 * RUN ON HARDWARE. */
#include "../glove_hal.h"

#include "esp32-hal.h"
#include "esp_task_wdt.h"
#include "motors.h"
#include "pins.h"

enum {
    UART = 0,
    BAUD = 115200,
    RX_BUFFER = 1024,
    TX_BUFFER = 512,
    RX_THRESHOLD = 1,
    PIN_DEFAULT = -1,
    WATCHDOG_MS = 100,
    ZERO_MV = 500,                 /* TMP36 at 0 C */
    DEGREE_MV = 10
};

static uart_t *serial;

void glove_hal_begin(uint8_t motors)
{
    const esp_task_wdt_config_t watchdog = {.timeout_ms = WATCHDOG_MS, .idle_core_mask = 0, .trigger_panic = true};
    motors_begin(motors);
    pinMode(PIN_REPEAT, INPUT_PULLUP);
    pinMode(PIN_YES, INPUT_PULLUP);
    pinMode(PIN_WORN, INPUT);
    serial = uartBegin(UART, BAUD, SERIAL_8N1, PIN_DEFAULT, PIN_DEFAULT, RX_BUFFER, TX_BUFFER, false, RX_THRESHOLD);
    (void)esp_task_wdt_reconfigure(&watchdog);
    (void)esp_task_wdt_add(NULL);
}

uint32_t glove_hal_now_ms(void)
{
    return (uint32_t)millis();
}

bool glove_hal_read_byte(uint8_t *byte)
{
    if (uartAvailable(serial) == 0)
        return false;
    *byte = uartRead(serial);
    return true;
}

void glove_hal_write(const uint8_t *bytes, size_t length)
{
    if (uartAvailableForWrite(serial) >= length)
        uartWriteBuf(serial, bytes, length);
}

/* A sensor that is not there reads far outside, and counts as hot. */
static int8_t temperature_c(void)
{
    const int32_t degrees = ((int32_t)analogReadMilliVolts(PIN_TEMPERATURE) - ZERO_MV) / DEGREE_MV;
    return (int8_t)(degrees < -20 || degrees > INT8_MAX ? INT8_MAX : degrees);
}

void glove_hal_sense(glove_inputs *inputs)
{
    inputs->worn = digitalRead(PIN_WORN) == HIGH;
    inputs->pressed[BUTTON_REPEAT] = digitalRead(PIN_REPEAT) == LOW;
    inputs->pressed[BUTTON_YES] = digitalRead(PIN_YES) == LOW;
    inputs->open = motors_open();
    inputs->shorted = motors_shorted();
    inputs->temperature_c = temperature_c();
}

void glove_hal_put(const uint8_t level[GLOVE_MOTORS_MAX])
{
    motors_put(level, glove_hal_now_ms());
}

void glove_hal_kick(void)
{
    (void)esp_task_wdt_reset();
}
