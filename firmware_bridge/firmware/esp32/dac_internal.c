/* The ESP32's own 8-bit converters by the Arduino core's dacWrite. They have no memory: until dac_begin they give
 * 0 V, which never reaches the lines, because the switch is at the joystick. Compiled in the tests against a shim; NOT
 * RUN ON HARDWARE. */
#include "dac.h"

#include "esp32-hal-dac.h"
#include "pins.h"

const uint8_t DAC_BITS = 8;

bool dac_put(const uint16_t counts[AXES])
{
    const bool forward = dacWrite(PIN_DAC_FORWARD, (uint8_t)counts[AXIS_FORWARD]);
    const bool turn = dacWrite(PIN_DAC_TURN, (uint8_t)counts[AXIS_TURN]);
    return forward && turn;
}

bool dac_begin(uint16_t neutral_counts)
{
    const uint16_t counts[AXES] = {neutral_counts, neutral_counts};
    return dac_put(counts);
}
