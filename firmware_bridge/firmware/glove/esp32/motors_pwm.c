/* Up to nine motors on PWM channels, each with a transistor, by the Arduino core's ledc (3.x). One shunt carries the
 * current of all: a motor is judged while it vibrates alone. Compiled in the tests against shims; NOT RUN ON HARDWARE. */
#include <stdbool.h>

#include "esp32-hal-ledc.h"
#include "esp32-hal.h"
#include "motors.h"
#include "pins.h"

enum {
    PWM_HZ = 20000,                /* above hearing */
    PWM_BITS = 8,
    JUDGED_LEVEL = 128,            /* weaker motors draw too little to be judged */
    JUDGED_MS = 40,                /* the current after the motor's start */
    OPEN_MV = 100,                 /* 60 mA through 1 ohm, ten times amplified, are 600 mV */
    SHORT_MV = 1800
};

static uint8_t motor_count;
static int alone = -1;             /* the motor that vibrates alone */
static uint32_t alone_ms;
static uint16_t open_motors, shorted_motors;

void motors_begin(uint8_t count)
{
    motor_count = count < PWM_PINS ? count : PWM_PINS;
    open_motors = shorted_motors = 0;
    alone = -1;
    for (int motor = 0; motor < motor_count; motor++) {
        const bool attached = ledcAttach(PIN_MOTOR[motor], PWM_HZ, PWM_BITS);
        if (!attached || !ledcWrite(PIN_MOTOR[motor], 0))
            open_motors = (uint16_t)(open_motors | 1u << motor);
    }
}

static int only_one(const uint8_t level[GLOVE_MOTORS_MAX])
{
    int found = -1;
    for (int motor = 0; motor < motor_count; motor++) {
        if (level[motor] == 0)
            continue;
        if (found >= 0 || level[motor] < JUDGED_LEVEL)
            return -1;
        found = motor;
    }
    return found;
}

static void judge(int motor)
{
    const uint32_t mv = analogReadMilliVolts(PIN_SHUNT);
    const uint16_t bit = (uint16_t)(1u << motor);
    if (mv < OPEN_MV)
        open_motors |= bit;
    else
        open_motors = (uint16_t)(open_motors & ~bit);
    if (mv > SHORT_MV)
        shorted_motors |= bit;     /* until the next boot: it is not tried again */
}

void motors_put(const uint8_t level[GLOVE_MOTORS_MAX], uint32_t now_ms)
{
    for (int motor = 0; motor < motor_count; motor++)
        (void)ledcWrite(PIN_MOTOR[motor], level[motor]);
    const int before = alone;
    alone = only_one(level);
    if (alone != before)
        alone_ms = now_ms;
    else if (alone >= 0 && now_ms - alone_ms >= JUDGED_MS)
        judge(alone);
}

uint16_t motors_open(void)
{
    return open_motors;
}

uint16_t motors_shorted(void)
{
    return shorted_motors;
}
