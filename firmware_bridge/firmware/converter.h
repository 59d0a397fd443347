/* From line millivolts to counts of a converter behind a family's gain and offset stage. */
#ifndef WAYCHAIR_CONVERTER_H
#define WAYCHAIR_CONVERTER_H

#include <stdint.h>

#include "families.h"

/* The nearest count, within 0 and `counts_max`. */
uint16_t converter_counts(const joystick_family *family, uint16_t counts_max, int32_t line_mv);

/* The line voltage at these counts. */
int32_t converter_line_mv(const joystick_family *family, uint16_t counts_max, uint16_t counts);

#endif
