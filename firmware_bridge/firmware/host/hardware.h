/* What stands around the microcontroller, as a model: converter, gain stage, line switch, cut relay, e-stop contact,
 * external window watchdog, read-back. It goes on working when the firmware does not, and it can be broken on purpose.
 * Board side of the cut relay: a cut takes every fault off the chair's lines, and pull resistors hold them at the
 * reference. */
#ifndef WAYCHAIR_HARDWARE_H
#define WAYCHAIR_HARDWARE_H

#include <stdbool.h>
#include <stdint.h>

#include "../families.h"
#include "../safety_core.h"

enum {
    WATCHDOG_EARLY_MS = 5,         /* a kick sooner than this after the last one is a runaway loop */
    WATCHDOG_LATE_MS = 50          /* none for longer than this is a hung one */
};

typedef enum {
    DEFECT_NONE,
    DEFECT_STUCK,                  /* the converter keeps its last voltage on `axis` */
    DEFECT_OFFSET,                 /* `value` mV are added to the converter's `axis` */
    DEFECT_OPEN,                   /* the wire of `axis` is off: pulled to the reference */
    DEFECT_LOW,                    /* `axis` is shorted to ground */
    DEFECT_HIGH,                   /* `axis` is shorted to the supply */
    DEFECT_SWAP,                   /* the lines are exchanged */
    DEFECT_BRIDGE,                 /* the lines touch each other */
    DEFECT_STICK_OPEN,             /* the rider's stick lost the wire of `axis` */
    DEFECT_CONVERTER_SILENT,       /* the converter answers no more and keeps its voltages */
    DEFECT_WELDED,                 /* the switch stays where it is */
    DEFECT_FROZEN,                 /* the firmware hangs */
    DEFECT_BROWN_OUT,              /* the board has no power; it boots afterwards */
    DEFECT_COUNT
} defect_kind;

typedef struct {
    uint8_t kind;
    uint8_t axis;
    int16_t value;
} defect;

typedef struct {
    const joystick_family *family;
    uint16_t counts_max;
    uint32_t now_ms;
    uint16_t stick_mv[AXES];
    uint16_t reference_mv;
    bool estop_released;
    defect broken;
    uint16_t counts[AXES];
    uint8_t wanted;                /* what the firmware told the switch */
    uint8_t closed;                /* where the switch is */
    bool watched;                  /* the watchdog holds the switch's coil and the reset line free */
    uint32_t kick_ms;
} hardware;

void hardware_begin(hardware *self, const joystick_family *family, uint16_t counts_max);

/* One millisecond: watchdog and switch. True when the microcontroller has power and is not held in reset. */
bool hardware_tick(hardware *self);

void hardware_kick(hardware *self);
bool hardware_put(hardware *self, const uint16_t line_mv[AXES]);
uint16_t hardware_stick_mv(const hardware *self, int axis);
uint16_t hardware_line_mv(const hardware *self, int axis);

#endif
