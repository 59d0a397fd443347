/* Joystick families as data: see families.h. Sources of the figures:
 * - Hall, 5 V ratiometric: do-it-yourself builders measured neutral at half the supply and 1.2 V each way on common
 *   controllers (wheelchairdriver.com, topic 3261). Fault limits: 10 % and 90 % of the supply, the range of a working
 *   ratiometric Hall sensor.
 * - Inductive, 12 V: JC200 measured at 4.6 to 7.0 V (forum.arduino.cc, topic 201998). R-Net Omni2: swing 1.2 V, 1.1 to
 *   1.3 V accepted at calibration, more than 3.0 V from the reference is a fault (Curtiss-Wright manual SK81935).
 * - Eight-pin, 3.3 V: the stick of Pai et al. (2026), driven from a converter of 0 to 3.3 V without a stage.
 * Source impedances are assumptions until measured on the stick at hand. */
#include "families.h"

#include <stddef.h>

static const joystick_family FAMILIES[FAMILY_COUNT - 1] = {
    {
        .name = "hall_5v",
        .supply_mv = 5000,
        .reference_mv = 2500,
        .swing_mv = 1200,
        .fault_low_mv = 500,
        .fault_high_mv = 4500,
        .source_ohm = 1000,
        .dac_low_mv = 1100, /* 2500 mV +-5 % and a swing 5 % longer just fit */
        .dac_high_mv = 3900,
        .test_mv = {1300, 2500, 3700},
    },
    {
        .name = "inductive_12v",
        .supply_mv = 12000,
        .reference_mv = 5800,
        .swing_mv = 1200,
        .fault_low_mv = 2800,
        .fault_high_mv = 8800,
        .source_ohm = 2200,
        .dac_low_mv = 4200,
        .dac_high_mv = 7400,
        .test_mv = {4600, 5800, 7000},
    },
    {
        .name = "eight_pin_3v3",
        .supply_mv = 3300,
        .reference_mv = 1650,
        .swing_mv = 1200,
        .fault_low_mv = 200,
        .fault_high_mv = 3100,
        .source_ohm = 1000,
        .dac_low_mv = 0,
        .dac_high_mv = 3300,
        .test_mv = {450, 1650, 2850},
    },
};

const joystick_family *family_find(uint8_t id)
{
    if (id == FAMILY_NONE || id >= FAMILY_COUNT)
        return NULL;
    return &FAMILIES[id - 1];
}
