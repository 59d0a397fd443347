/* Wiring of the ESP32 board; see the diagram in firmware_bridge/README.md. Analogue inputs are on ADC1, which works
 * while the radio is on. */
#ifndef WAYCHAIR_PINS_H
#define WAYCHAIR_PINS_H

enum {
    PIN_STICK_FORWARD = 32,
    PIN_STICK_TURN = 33,
    PIN_LINE_FORWARD = 34,
    PIN_LINE_TURN = 35,
    PIN_REFERENCE = 36,
    PIN_DAC_FORWARD = 25,          /* the ESP32's own two converters, as in Pai et al. (2026) */
    PIN_DAC_TURN = 26,
    PIN_SDA = 21,
    PIN_SCL = 22,
    PIN_ESTOP = 27,                /* high: released; with the pull-down a broken wire reads as pressed */
    PIN_SWITCH = 16,               /* high: lines at the board; the relay falls back to the joystick */
    PIN_CUT = 17,                  /* low: lines cut; high-side driver, whose pull-up keeps them closed without power */
    PIN_KICK = 4
};

/* The dividers before the analogue inputs bring the family's upper fault limit to this voltage at the pin. */
enum { PIN_FULL_MV = 3000 };

#endif
