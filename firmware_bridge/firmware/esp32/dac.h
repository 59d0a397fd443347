/* The two converters that an ESP32 board can have. Exactly one of dac_internal.c and dac_mcp4728.c is linked. */
#ifndef WAYCHAIR_DAC_H
#define WAYCHAIR_DAC_H

#include <stdbool.h>
#include <stdint.h>

#include "../safety_core.h"

extern const uint8_t DAC_BITS;

/* Sets it to these counts and, if it has a memory, makes it power up there; false on failure. */
bool dac_begin(uint16_t neutral_counts);

bool dac_put(const uint16_t counts[AXES]);

#endif
