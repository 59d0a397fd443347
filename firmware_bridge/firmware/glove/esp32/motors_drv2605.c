/* Up to sixteen motors, each on a DRV2605L (Texas Instruments, SLOS854) in real-time playback, behind two TCA9548A
 * multiplexers (SCPS207), by the Arduino core's C functions. All drivers have one address, so that motors of equal
 * level are written at once. Compiled in the tests against shims; NOT RUN ON HARDWARE. */
#include <stdbool.h>
#include <stddef.h>
#include <string.h>

#include "esp32-hal-i2c.h"
#include "esp32-hal.h"
#include "motors.h"
#include "pins.h"

enum {
    BUS = 0,
    BUS_HZ = 400000,
    TIMEOUT_MS = 3,                /* two bytes take 0.1 ms */
    MULTIPLEXER = 0x70,            /* and the next address for motors 8 to 15 */
    PORTS = 8,
    DRIVER = 0x5A,
    START_MS = 1,                  /* from EN to the first command: 250 us */
    DIAGNOSIS_MS = 200
};

enum { STATUS = 0x00, MODE = 0x01, LEVEL = 0x02, GO = 0x0C, CONTROL_3 = 0x1D };
enum { MODE_LEVEL = 0x05, MODE_DIAGNOSIS = 0x06 };
enum { STATUS_OVERCURRENT = 1 << 0, STATUS_DIAGNOSIS = 1 << 3 };
enum { CONTROL_3_OPEN_LOOP_UNSIGNED = 0xA0 | 1 << 3 }; /* its default, and levels from 0 to 255 */

static uint8_t motor_count;
static uint8_t written[GLOVE_MOTORS_MAX];
static uint16_t open_motors, shorted_motors;
static bool bus_ok;

static bool select_motors(uint16_t mask)
{
    for (int half = 0; half * PORTS < motor_count; half++) {
        const uint8_t ports = (uint8_t)(mask >> (half * PORTS));
        if (i2cWrite(BUS, (uint16_t)(MULTIPLEXER + half), &ports, 1, TIMEOUT_MS) != ESP_OK)
            return false;
    }
    return true;
}

static bool write_register(uint8_t where, uint8_t value)
{
    const uint8_t bytes[2] = {where, value};
    return i2cWrite(BUS, DRIVER, bytes, sizeof bytes, TIMEOUT_MS) == ESP_OK;
}

static bool read_register(uint8_t where, uint8_t *value)
{
    size_t count = 0;
    return i2cWrite(BUS, DRIVER, &where, 1, TIMEOUT_MS) == ESP_OK &&
           i2cRead(BUS, DRIVER, value, 1, TIMEOUT_MS, &count) == ESP_OK && count == 1;
}

static uint16_t all_motors(void)
{
    return (uint16_t)((1u << motor_count) - 1u);
}

/* A driver that is not obeyed could vibrate on: all drivers lose their EN, and every motor counts as open. */
static void give_up(void)
{
    digitalWrite(PIN_ENABLE, LOW);
    bus_ok = false;
    open_motors = all_motors();
}

/* Whether the driver answered; the motor behind it is judged. */
static bool diagnose(int motor)
{
    uint8_t busy = 1, status = 0;
    if (!select_motors((uint16_t)(1u << motor)) || !write_register(CONTROL_3, CONTROL_3_OPEN_LOOP_UNSIGNED) ||
        !write_register(MODE, MODE_DIAGNOSIS) || !write_register(GO, 1))
        return false;
    for (int ms = 0; ms < DIAGNOSIS_MS && busy != 0; ms++) {
        delay(1);
        if (!read_register(GO, &busy))
            return false;
    }
    if (!read_register(STATUS, &status))
        return false;
    if (status & STATUS_OVERCURRENT)
        shorted_motors = (uint16_t)(shorted_motors | 1u << motor);
    else if (busy != 0 || (status & STATUS_DIAGNOSIS))
        open_motors = (uint16_t)(open_motors | 1u << motor);
    return write_register(LEVEL, 0) && write_register(MODE, MODE_LEVEL);
}

void motors_begin(uint8_t count)
{
    motor_count = count;
    open_motors = shorted_motors = 0;
    memset(written, 0, sizeof written);
    pinMode(PIN_ENABLE, OUTPUT);
    digitalWrite(PIN_ENABLE, HIGH);
    delay(START_MS);
    bus_ok = i2cInit(BUS, PIN_SDA, PIN_SCL, BUS_HZ) == ESP_OK;
    for (int motor = 0; bus_ok && motor < motor_count; motor++)
        bus_ok = diagnose(motor);
    if (!bus_ok)
        give_up();
}

static bool write_level(uint8_t level, uint16_t mask)
{
    return select_motors(mask) && write_register(LEVEL, level);
}

/* Motors whose level changes to that of `first`, by bit. */
static uint16_t changing_alike(const uint8_t level[GLOVE_MOTORS_MAX], int first)
{
    unsigned mask = 0;
    for (int motor = first; motor < motor_count; motor++)
        mask |= (unsigned)(level[motor] == level[first] && level[motor] != written[motor]) << motor;
    return (uint16_t)mask;
}

void motors_put(const uint8_t level[GLOVE_MOTORS_MAX], uint32_t now_ms)
{
    (void)now_ms;
    for (int first = 0; bus_ok && first < motor_count; first++) {
        if (level[first] == written[first])
            continue;
        const uint16_t mask = changing_alike(level, first);
        if (!write_level(level[first], mask)) {
            give_up();
            return;
        }
        for (int motor = first; motor < motor_count; motor++)
            if (mask >> motor & 1)
                written[motor] = level[motor];
    }
}

uint16_t motors_open(void)
{
    return open_motors;
}

uint16_t motors_shorted(void)
{
    return shorted_motors;
}
