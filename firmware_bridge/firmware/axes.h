/* The two axes of the joystick, their four directions, and the unit of set-points and caps. */
#ifndef WAYCHAIR_AXES_H
#define WAYCHAIR_AXES_H

enum { AXIS_FORWARD, AXIS_TURN, AXES };

/* Forward and right raise the voltage of their axis. */
enum { TO_FRONT, TO_REAR, TO_LEFT, TO_RIGHT, DIRECTIONS };

enum {
    SETPOINT_MAX = 10000,          /* the family's swing, in the unit of set-points and caps */
    PER_MILLE = 1000
};

#endif
