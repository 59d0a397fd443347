/* An external MCP4728, four 12-bit converters on I2C, by the Arduino core's C functions; channels A and B are used.
 * Commands and registers after Microchip's data sheet DS22187. Its EEPROM holds neutral, so that it powers up there;
 * every boot checks this and writes it if needed. Compiled in the tests against a shim; NOT RUN ON HARDWARE. */
#include "dac.h"

#include <stddef.h>

#include "esp32-hal-i2c.h"
#include "esp32-hal.h"
#include "pins.h"

enum {
    BUS = 0,
    BUS_HZ = 400000,
    ADDRESS = 0x60,
    TIMEOUT_MS = 3,                /* five bytes take 0.12 ms */
    SEQUENTIAL_WRITE = 0x50,       /* input registers and EEPROM, from channel A on */
    EEPROM_MS = 50,                /* longest time of an EEPROM write */
    REGISTERS = 24,                /* four channels with 3 bytes of input register and 3 bytes of EEPROM each */
    CHANNEL_BYTES = 6,
    EEPROM_OFFSET = 3,
    EEPROM_WRITE = 1 + 4 * 2
};

const uint8_t DAC_BITS = 12;

/* The bits above the 12 data bits are zero, in the EEPROM too: supply as reference, powered, gain 1. */
static bool holds(const uint8_t *registers, int channel, uint16_t counts)
{
    const uint8_t *stored = registers + channel * CHANNEL_BYTES + EEPROM_OFFSET;
    return stored[1] == counts >> 8 && stored[2] == (counts & 0xFF);
}

static bool wakes_up_at(uint16_t counts)
{
    uint8_t registers[REGISTERS];
    size_t count = 0;
    if (i2cRead(BUS, ADDRESS, registers, sizeof registers, TIMEOUT_MS, &count) != ESP_OK || count != REGISTERS)
        return false;
    return holds(registers, AXIS_FORWARD, counts) && holds(registers, AXIS_TURN, counts);
}

static bool store(uint16_t counts)
{
    uint8_t bytes[EEPROM_WRITE] = {SEQUENTIAL_WRITE};
    for (int channel = 0; channel < 4; channel++) {
        bytes[1 + 2 * channel] = (uint8_t)(counts >> 8);
        bytes[2 + 2 * channel] = (uint8_t)counts;
    }
    const bool written = i2cWrite(BUS, ADDRESS, bytes, sizeof bytes, TIMEOUT_MS) == ESP_OK;
    delay(EEPROM_MS);
    return written;
}

/* Fast write: two bytes a channel, upper nibble 0 is normal power. */
bool dac_put(const uint16_t counts[AXES])
{
    const uint8_t bytes[2 * AXES] = {(uint8_t)(counts[AXIS_FORWARD] >> 8), (uint8_t)counts[AXIS_FORWARD],
                                     (uint8_t)(counts[AXIS_TURN] >> 8), (uint8_t)counts[AXIS_TURN]};
    return i2cWrite(BUS, ADDRESS, bytes, sizeof bytes, TIMEOUT_MS) == ESP_OK;
}

bool dac_begin(uint16_t neutral_counts)
{
    if (i2cInit(BUS, PIN_SDA, PIN_SCL, BUS_HZ) != ESP_OK)
        return false;
    const bool ready = wakes_up_at(neutral_counts) || (store(neutral_counts) && wakes_up_at(neutral_counts));
    const uint16_t counts[AXES] = {neutral_counts, neutral_counts};
    return dac_put(counts) && ready;
}
