/* Joystick families as data: the voltages that the chair's controller expects on its two lines, and the board's
 * converter stage. The board never arms without a family. All voltages are millivolts on the chair's lines, against
 * its ground. */
#ifndef WAYCHAIR_FAMILIES_H
#define WAYCHAIR_FAMILIES_H

#include <stdint.h>

typedef enum { FAMILY_NONE, FAMILY_HALL_5V, FAMILY_INDUCTIVE_12V, FAMILY_EIGHT_PIN_3V3, FAMILY_COUNT } family_id;

typedef struct {
    const char *name;
    int32_t supply_mv;            /* the chair's supply of the stick */
    int32_t reference_mv;         /* the reference line, which is also the lines' neutral; they scale with it */
    int32_t swing_mv;             /* largest deviation from neutral that the board ever puts out, on either axis */
    int32_t fault_low_mv;         /* a line outside these two limits has a broken wire or a short */
    int32_t fault_high_mv;
    int32_t source_ohm;           /* of the stick: the board's output must not be weaker, its pull resistors are 10 x */
    int32_t dac_low_mv;           /* gain and offset stage: line voltage at the converter's lowest count */
    int32_t dac_high_mv;          /* and at its highest */
    int32_t test_mv[3];           /* expected readings of a bench test at commands -100 %, 0, +100 % */
} joystick_family;

/* The family's data; NULL for FAMILY_NONE and for any unknown number. */
const joystick_family *family_find(uint8_t id);

#endif
