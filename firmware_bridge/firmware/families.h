/* Joystick families as data: what the chair's controller expects on its two lines, and how the board reaches it.
 * The board never arms without one. All voltages in millivolts on the chair's lines, against its ground. */
#ifndef WAYCHAIR_FAMILIES_H
#define WAYCHAIR_FAMILIES_H

#include <stdint.h>

typedef enum { FAMILY_NONE, FAMILY_HALL_5V, FAMILY_INDUCTIVE_12V, FAMILY_EIGHT_PIN_3V3, FAMILY_COUNT } family_id;

typedef struct {
    const char *name;
    int32_t supply_mv;            /* what the chair feeds the stick */
    int32_t reference_mv;         /* the reference line, which is also the lines' neutral; they scale with it */
    int32_t swing_mv;             /* farthest from neutral on either axis that the board will ever put out */
    int32_t fault_low_mv;         /* a line beyond these two is a broken wire or a short, never a stick */
    int32_t fault_high_mv;
    int32_t source_ohm;           /* of the stick: the board's output must not be weaker, its pull resistors 10 x */
    int32_t dac_low_mv;           /* gain and offset stage: the line at the converter's lowest value, */
    int32_t dac_high_mv;          /* and at its highest */
    int32_t test_mv[3];           /* bench test with a meter at commands -100 %, 0, +100 % */
} joystick_family;

/* The family's data, or NULL for FAMILY_NONE and for any number that is no family. */
const joystick_family *family_find(uint8_t id);

#endif
