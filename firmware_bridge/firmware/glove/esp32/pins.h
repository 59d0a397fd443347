/* Wiring of the ESP32 glove; see the diagram in firmware_bridge/README.md. Analogue inputs are on ADC1, which works while
 * the radio is on. */
#ifndef WAYCHAIR_GLOVE_PINS_H
#define WAYCHAIR_GLOVE_PINS_H

enum {
    PIN_REPEAT = 32,               /* buttons to ground; low: pressed */
    PIN_YES = 33,
    PIN_WORN = 35,                 /* of a capacitive touch switch under the palm; high: worn */
    PIN_TEMPERATURE = 36,          /* of a TMP36 between the motors: 500 mV at 0 C, 10 mV a degree */
    PIN_SHUNT = 39,                /* PWM: voltage on the motors' common shunt, amplified */
    PIN_SDA = 21,                  /* DRV2605L */
    PIN_SCL = 22,
    PIN_ENABLE = 23                /* DRV2605L: all drivers' EN; pulled down, so that a board in reset rests */
};

/* PWM: gates of the motors' transistors, each pulled down, so that a board in reset rests. */
enum { PWM_PINS = 9 };
static const uint8_t PIN_MOTOR[PWM_PINS] = {13, 14, 16, 17, 18, 19, 25, 26, 27};

#endif
