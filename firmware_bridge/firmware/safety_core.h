/* The safety core: decides every millisecond which source drives the chair's two joystick lines, and the voltages.
 *
 *   SILENT   the rider's joystick is live; commands of the computer are ignored
 *   ARMED    the rider's joystick is live; the first non-zero command takes the lines
 *   DRIVE    the board holds the lines at the computer's command, within its own limits
 *   FAULT    latched until the computer asks for a reset while everything is in order
 *   GUARD    the board copies the rider's own stick to the lines, within the computer's caps (guard.h)
 *
 * A guard that ends by a fault never becomes wider: the caps stay narrow, or the lines are cut, until the stick has been
 * at rest for two seconds. Then the joystick is live.
 *
 * Data in, data out: no heap, no float, no clock, no I/O. Milliseconds are modulo 2^32. The faults F1 to F29 named here
 * are rows of the fault table in README.md. */
#ifndef WAYCHAIR_SAFETY_CORE_H
#define WAYCHAIR_SAFETY_CORE_H

#include <stdbool.h>
#include <stdint.h>

#include "axes.h"
#include "families.h"
#include "guard.h"

enum {
    HOST_BUDGET_MS = 100,          /* F1: from the last good frame to a live joystick */
    HANDOVER_MS = 20,              /* the command fades into the joystick; a jump would jolt the rider */
    WATCHDOG_MS = HOST_BUDGET_MS - HANDOVER_MS,
    RAMP_TO_CUT_MS = 200,          /* to neutral before a cut; faster than a hand releases a stick */
    NEUTRAL_HOLD_MS = 2000,        /* F7: the time for which chairs' controllers check for a displaced stick */
    BAD_FRAMES = 5,                /* F3: this many bad frames */
    BAD_FRAMES_MS = 500,           /*     within this time mean a broken line, not noise */
    SEQUENCE_WINDOW = 32,          /* F4: newer by 1 to 32; 0.64 s of lost frames at 50 Hz */
    LINE_FAULT_MS = 60,            /* F8-F10: a controller's own timeout for a wrong input (Curtis 1220 manual) */
    MISMATCH_MV = 60,              /* F8: four steps of an 8-bit converter, 80 mm/s */
    REFERENCE_PER_MILLE = 50,      /* F9: 5 % */
    CREEP_MV = 35,                 /* F21: 0.05 m/s at 1.33 mm/s per mV, with neither dead band nor brake */
    CREEP_MS = 300,
    STEP_MAX_MS = 50,              /* F16: a longer step means a broken clock or a board that hung */
    SLEW_STEP_MS = 20,             /* F6: a late step catches up at most one command period */
    WINDOW_MS = 100,               /* F6: in each window of this length a line moves at most by */
    WINDOW_PER_MILLE = 600,        /*     this part of the swing, for every configuration */
    KICK_MS = 10                   /* F29: period of the kicks that the external watchdog expects */
};

typedef enum { STATE_SILENT, STATE_ARMED, STATE_DRIVE, STATE_FAULT, STATE_GUARD } safety_state;
typedef enum { HOLDER_JOYSTICK, HOLDER_BOARD, HOLDER_CUT } line_holder;

enum {
    FAULT_HOST_SILENT = 1 << 0,    /* F1 */
    FAULT_BAD_FRAMES = 1 << 1,     /* F3 */
    FAULT_RANGE = 1 << 2,          /* F5 */
    FAULT_NEW_HOST = 1 << 3,       /* F22: a handshake while armed */
    FAULT_CLOCK = 1 << 4,          /* F16 */
    FAULT_BOARD = 1 << 5,          /* F29: the converter does not answer, or its stored neutral is wrong */
    FAULT_STICK = 1 << 6,          /* F10 at the rider's own stick: it could not override */
    FAULT_REFERENCE = 1 << 7,      /* F9 */
    FAULT_CREEP = 1 << 8,          /* F21 */
    FAULT_MISMATCH = 1 << 9,       /* F8 */
    FAULT_IMPOSSIBLE = 1 << 10,    /* F10 */
    FAULT_ESTOP = 1 << 11          /* F18 */
};

/* Stop classes, weakest first: the holder of the lines after a fault. */
enum {
    FAULTS_OF_HOST = FAULT_HOST_SILENT | FAULT_BAD_FRAMES | FAULT_RANGE | FAULT_NEW_HOST | FAULT_CLOCK,
    FAULTS_TO_JOYSTICK = FAULTS_OF_HOST | FAULT_BOARD,
    FAULTS_RAMP_TO_CUT = FAULT_STICK | FAULT_REFERENCE | FAULT_CREEP,
    FAULTS_CUT_AT_ONCE = FAULT_MISMATCH | FAULT_IMPOSSIBLE | FAULT_ESTOP
};

enum {
    COMMAND_ENABLE = 1 << 0,       /* the computer wants to drive */
    COMMAND_RESET = 1 << 1,        /* its rising edge clears faults */
    COMMAND_ESTOP_ACK = 1 << 2,    /* with reset: the e-stop was released on purpose */
    LIMIT_GUARD = 1 << 3,          /* with enable, in a LIMIT only: the rider drives within its caps */
    LIMIT_HARD_SHIFT = 4           /* in a LIMIT only: from this bit on one for each direction, a drop-off */
};

typedef struct {
    uint8_t family;
    uint16_t neutral_per_mille;    /* of the swing: a stick within this is at rest */
    uint16_t override_per_mille;   /* of the swing: a stick beyond this takes over */
    uint16_t override_ms;          /* for at least this long; raise both for tremor or spasm */
    uint16_t slew_ms;              /* least time of a line from neutral to the end of its swing */
    uint16_t guard_lost_per_mille; /* of the swing: highest cap after the computer is lost; 1000 for a rider who sees */
} safety_config;

typedef enum { EVENT_NONE, EVENT_BAD_FRAME, EVENT_HELLO, EVENT_COMMAND, EVENT_LIMIT } host_event;

/* The message from the computer since the last step; at most one frame. */
typedef struct {
    uint8_t event;
    bool hello_matches;            /* same protocol, layout, chair and family */
    uint16_t sequence;
    int16_t setpoint[AXES];        /* of a command */
    uint8_t flags;
    uint16_t caps[DIRECTIONS];     /* of a limit */
} host_message;

typedef struct {
    uint16_t joystick_mv[AXES];    /* the rider's stick, before the switch */
    uint16_t line_mv[AXES];        /* the chair's lines, after the switch */
    uint16_t reference_mv;
    bool estop_released;           /* false: pressed, or its wire is broken */
    bool board_ok;                 /* the converter answers and its memory holds neutral */
    host_message host;
} safety_inputs;

typedef struct {
    uint8_t state;
    uint8_t holder;
    uint16_t faults;
    uint16_t line_mv[AXES];        /* for the converter, valid with every holder */
    bool kick;                     /* a kick of the external watchdog is due */
    bool heard;                    /* the frame of this step was an accepted command or limit */
    uint16_t caps[DIRECTIONS];     /* in force; none without a guard */
    uint8_t guard_bits;
} safety_outputs;

typedef struct {
    bool running;
    uint32_t since_ms;
} safety_timer;

enum { TIMER_HOLD, TIMER_OVERRIDE, TIMER_MISMATCH, TIMER_REFERENCE, TIMER_IMPOSSIBLE, TIMER_STICK, TIMER_CREEP,
       TIMER_ESTOP_RELEASE, TIMER_LOST, TIMER_COUNT };

typedef struct {
    safety_config config;
    const joystick_family *family; /* NULL: no arming */
    bool started;
    uint32_t now_ms;
    uint32_t elapsed_ms;           /* since the step before */
    safety_timer timers[TIMER_COUNT];
    safety_state state;
    line_holder holder;
    uint16_t faults;
    bool stopping;                 /* the lines ramp from the computer's command to the next holder */
    uint32_t stop_left_ms;
    int32_t line_mv[AXES];
    uint32_t window_start_ms;
    int32_t window_mv[AXES];
    bool session;                  /* the last handshake matched */
    bool host_present;
    uint32_t host_ms;              /* of the last accepted command */
    uint16_t sequence;
    int16_t setpoint[AXES];
    uint8_t flags;
    bool guarding;                 /* the lines copy the stick within the guard's caps */
    bool lost;                     /* a guard ended by a fault, and the stick has not been at rest for long enough since */
    guard guard;
    bool heard;                    /* this step's frame was an accepted command or limit */
    bool reset_asked;              /* and its reset flag has just been set */
    uint8_t bad_frames;
    uint32_t bad_frame_ms[BAD_FRAMES];
    uint32_t kick_ms;
} safety_core;

/* For a rider without tremor: stick at rest within 10 %, override beyond 20 % for 10 ms; full swing in 200 ms, about
 * the speed of a hand; a lost guard leaves 25 %, about 0.25 m/s. */
safety_config safety_defaults(uint8_t family);

/* Starts in SILENT with the joystick live. False: the configuration is invalid or has no family; it never arms. */
bool safety_init(safety_core *core, const safety_config *config);

safety_outputs safety_step(safety_core *core, const safety_inputs *inputs, uint32_t now_ms);

#endif
