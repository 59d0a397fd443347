/* From line millivolts to converter counts: see converter.h. */
#include "converter.h"

uint16_t converter_counts(const joystick_family *family, uint16_t counts_max, int32_t line_mv)
{
    const int32_t span_mv = family->dac_high_mv - family->dac_low_mv;
    if (line_mv <= family->dac_low_mv)
        return 0;
    if (line_mv >= family->dac_high_mv)
        return counts_max;
    return (uint16_t)(((line_mv - family->dac_low_mv) * counts_max + span_mv / 2) / span_mv);
}

int32_t converter_line_mv(const joystick_family *family, uint16_t counts_max, uint16_t counts)
{
    const int32_t span_mv = family->dac_high_mv - family->dac_low_mv;
    return family->dac_low_mv + (counts * span_mv + counts_max / 2) / counts_max;
}
