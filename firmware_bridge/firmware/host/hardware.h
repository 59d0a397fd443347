/* A model of the hardware around the microcontroller: converter, gain stage, line switch, cut relay, e-stop contact,
 * external window watchdog, read-back. It works even when the firmware does not, and it can simulate defects. All
 * defects are on the board's side of the cut relay: after a cut, pull resistors hold the chair's lines at the
 * reference. */
#ifndef WAYCHAIR_HARDWARE_H
#define WAYCHAIR_HARDWARE_H

#include <stdbool.h>
#include <stdint.h>

#include "../families.h"
#include "../safety_core.h"

enum {
    WATCHDOG_EARLY_MS = 5,         /* a kick sooner than this after the last one: a runaway loop */
    WATCHDOG_LATE_MS = 50          /* no kick for longer than this: a hung loop */
};

typedef enum {
    DEFECT_NONE,
    DEFECT_STUCK,                  /* the converter keeps its last voltage on `axis` */
    DEFECT_OFFSET,                 /* `value` mV are added to the converter's `axis` */
    DEFECT_OPEN,                   /* the wire of `axis` is broken; the line is pulled to the reference */
    DEFECT_LOW,                    /* `axis` is shorted to ground */
    DEFECT_HIGH,                   /* `axis` is shorted to the supply */
    DEFECT_SWAP,                   /* the two lines are swapped */
    DEFECT_BRIDGE,                 /* the two lines are shorted to each other */
    DEFECT_STICK_OPEN,             /* the wire of `axis` to the rider's stick is broken */
    DEFECT_CONVERTER_SILENT,       /* the converter does not answer and keeps its voltages */
    DEFECT_WELDED,                 /* the switch stays where it is */
    DEFECT_FROZEN,                 /* the firmware hangs */
    DEFECT_BROWN_OUT,              /* the board has no power; it boots when this ends */
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
    uint8_t wanted;                /* holder that the firmware wants */
    uint8_t closed;                /* holder that the switch connects */
    bool watched;                  /* the watchdog lets the switch's coil and the microcontroller run */
    uint32_t kick_ms;
} hardware;

void hardware_begin(hardware *self, const joystick_family *family, uint16_t counts_max);

/* Runs watchdog and switch for one millisecond; true if the board has power. */
bool hardware_tick(hardware *self);

void hardware_kick(hardware *self);
bool hardware_put(hardware *self, const uint16_t line_mv[AXES]);
uint16_t hardware_stick_mv(const hardware *self, int axis);
uint16_t hardware_line_mv(const hardware *self, int axis);

#endif
