/* The hardware around the microcontroller: see hardware.h. */
#include "hardware.h"

#include "../converter.h"

void hardware_begin(hardware *self, const joystick_family *family, uint16_t counts_max)
{
    self->family = family;
    self->counts_max = counts_max;
    self->wanted = HOLDER_JOYSTICK;
    self->watched = true;
    self->kick_ms = self->now_ms;
    for (int axis = 0; family != 0 && axis < AXES; axis++)
        self->counts[axis] = converter_counts(family, counts_max, family->reference_mv);
}

/* Without coil current the switch falls back to the joystick; the e-stop's own contact opens the cut relay. */
static uint8_t switch_position(const hardware *self, bool powered)
{
    if (self->broken.kind == DEFECT_WELDED)
        return self->closed;
    if (!self->estop_released)
        return HOLDER_CUT;
    return powered && self->watched ? self->wanted : HOLDER_JOYSTICK;
}

bool hardware_tick(hardware *self)
{
    const bool powered = self->broken.kind != DEFECT_BROWN_OUT;
    if (!powered || self->now_ms - self->kick_ms > WATCHDOG_LATE_MS)
        self->watched = false;
    self->closed = switch_position(self, powered);
    return powered;
}

void hardware_kick(hardware *self)
{
    if (self->now_ms - self->kick_ms < WATCHDOG_EARLY_MS)
        self->watched = false;
    self->kick_ms = self->now_ms;
}

bool hardware_put(hardware *self, const uint16_t line_mv[AXES])
{
    if (self->broken.kind == DEFECT_CONVERTER_SILENT)
        return false;
    for (int axis = 0; axis < AXES; axis++)
        if (self->broken.kind != DEFECT_STUCK || self->broken.axis != axis)
            self->counts[axis] = converter_counts(self->family, self->counts_max, line_mv[axis]);
    return true;
}

uint16_t hardware_stick_mv(const hardware *self, int axis)
{
    return self->broken.kind == DEFECT_STICK_OPEN && self->broken.axis == axis ? 0 : self->stick_mv[axis];
}

static int32_t source_mv(const hardware *self, int axis)
{
    if (self->closed == HOLDER_JOYSTICK)
        return hardware_stick_mv(self, axis);
    const bool shifted = self->broken.kind == DEFECT_OFFSET && self->broken.axis == axis;
    return converter_line_mv(self->family, self->counts_max, self->counts[axis]) + (shifted ? self->broken.value : 0);
}

static int32_t broken_mv(const hardware *self, int axis)
{
    switch (self->broken.kind) {
    case DEFECT_SWAP:
        return source_mv(self, AXES - 1 - axis);
    case DEFECT_BRIDGE:
        return (source_mv(self, AXIS_FORWARD) + source_mv(self, AXIS_TURN)) / 2;
    case DEFECT_OPEN:
        return self->broken.axis == axis ? self->reference_mv : source_mv(self, axis);
    case DEFECT_LOW:
        return self->broken.axis == axis ? 0 : source_mv(self, axis);
    case DEFECT_HIGH:
        return self->broken.axis == axis ? self->family->supply_mv : source_mv(self, axis);
    default:
        return source_mv(self, axis);
    }
}

uint16_t hardware_line_mv(const hardware *self, int axis)
{
    if (self->closed == HOLDER_CUT)
        return self->reference_mv;
    const int32_t mv = broken_mv(self, axis);
    return (uint16_t)(mv < 0 ? 0 : mv);
}
