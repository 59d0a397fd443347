/* Patterns, priorities, silence, heat and nuisance limits of a glove as one function: data in, data out, no heap, no
 * float, no clock. The board keeps the time of every step itself; the computer only says what to play. */
#ifndef WAYCHAIR_GLOVE_CORE_H
#define WAYCHAIR_GLOVE_CORE_H

#include <stdbool.h>
#include <stdint.h>

enum {
    GLOVE_MOTORS_MAX = 16,
    GLOVE_STEPS_MAX = 16
};

enum {
    GLOVE_SILENCE_MS = 500,        /* without an accepted frame: nobody speaks */
    GLOVE_CLOCK_MS = 50,           /* a longer step: the clock jumped or the loop hung */
    GLOVE_ON_MAX_MS = 500,         /* longest vibration of a motor without a rest */
    GLOVE_OFF_MAX_MS = 2000,       /* longest rest within a pattern */
    GLOVE_DUTY_MAX_MS = 5000,      /* most vibration of a motor in GLOVE_BINS - 1 bins, that is 10 s */
    GLOVE_BIN_MS = 100,
    GLOVE_BINS = 101,
    GLOVE_CROWD = 4,               /* more motors than these at once are a crowd */
    GLOVE_CROWD_MS = 250,          /* longest time of crowds before a rest from them */
    GLOVE_CALM_MS = 250,           /* that rest */
    GLOVE_HOT_C = 43,              /* skin is not touched by more for minutes (IEC 60601-1) */
    GLOVE_COOL_C = 41,
    GLOVE_DEBOUNCE_MS = 20,
    GLOVE_SEQUENCE_WINDOW = 32
};

typedef enum { GLOVE_WAITING, GLOVE_READY, GLOVE_ARMED, GLOVE_LOST } glove_state;

typedef enum {
    GLOVE_NOTHING,
    GLOVE_HELLO,
    GLOVE_PLAY,
    GLOVE_STOP,
    GLOVE_GAIN,
    GLOVE_ALIVE
} glove_event;

/* Why a PLAY is not played; 0: it is played or queued. */
enum {
    PLAY_STEPS = 1 << 0,           /* no steps, no such motor, or a time or strength out of its limits */
    PLAY_FAULTY = 1 << 1,          /* all motors of one of its steps are open, shorted or off */
    PLAY_NOT_WORN = 1 << 2,
    PLAY_HOT = 1 << 3,
    PLAY_DUTY = 1 << 4,            /* one of its motors has vibrated too much in the last 10 s */
    PLAY_LOWER = 1 << 5            /* something of higher priority plays */
};

/* Why a pattern was stopped in its middle. */
enum {
    CUT_DUTY = 1 << 0,
    CUT_CROWD = 1 << 1,
    CUT_RUN = 1 << 2,              /* a motor vibrated for GLOVE_ON_MAX_MS without a rest */
    CUT_FAULTY = 1 << 3,
    CUT_NOT_WORN = 1 << 4,
    CUT_HOT = 1 << 5,
    CUT_CLOCK = 1 << 6
};

enum { BUTTON_REPEAT, BUTTON_YES, BUTTONS };

typedef struct {
    uint16_t mask;
    uint8_t strength;
    uint16_t on_ms;
    uint16_t off_ms;
} glove_step;

typedef struct {
    uint8_t priority;
    uint8_t count;
    uint16_t sequence;             /* of the PLAY's frame, by which STATUS names it */
    uint16_t valid_ms;             /* a queued pattern that has not begun by then is dropped */
    glove_step steps[GLOVE_STEPS_MAX];
} glove_pattern;

typedef struct {
    uint8_t event;
    bool hello_matches;
    bool armed;                    /* of ALIVE */
    uint16_t sequence;
    uint8_t gain[GLOVE_MOTORS_MAX];
    glove_pattern pattern;
} glove_message;

typedef struct {
    glove_message host;
    bool worn;
    bool pressed[BUTTONS];
    uint16_t open;                 /* motors by bit */
    uint16_t shorted;
    int8_t temperature_c;
} glove_inputs;

typedef struct {
    uint8_t level[GLOVE_MOTORS_MAX];
    bool heard;                    /* the message was accepted */
} glove_outputs;

typedef struct {
    bool started;
    uint32_t now_ms;
    uint8_t motors;
    uint8_t state;
    uint16_t last_sequence;
    uint32_t silent_ms;            /* since the last accepted frame */
    uint8_t gain[GLOVE_MOTORS_MAX];

    bool playing;
    glove_pattern pattern;
    uint8_t at;                    /* step of the pattern */
    bool on;                       /* within the step: vibration or rest */
    uint32_t left_ms;              /* of the vibration or rest */
    bool queued;
    glove_pattern next;
    uint32_t next_ms;              /* since `next` was heard */

    uint8_t level[GLOVE_MOTORS_MAX];                 /* at the last step */
    uint16_t run_ms[GLOVE_MOTORS_MAX];               /* of vibration without a rest */
    uint8_t bins[GLOVE_BINS][GLOVE_MOTORS_MAX];      /* vibration in each bin of time, ms */
    uint16_t duty_ms[GLOVE_MOTORS_MAX];              /* sum of the bins */
    uint8_t bin;
    uint32_t bin_ms;
    uint32_t crowd_ms;
    uint32_t calm_ms;
    bool hot;

    uint16_t judged;               /* sequence of the last PLAY */
    uint8_t refused;               /* PLAY_ bits of it */
    uint8_t cut;                   /* the last CUT_ since the report, which follows each PLAY */
    uint8_t presses[BUTTONS];      /* modulo 256 */
    uint16_t pressed_ms[BUTTONS];
} glove_core;

/* Of a core of zeros. */
void glove_init(glove_core *core, uint8_t motors);

void glove_step_core(glove_core *core, const glove_inputs *inputs, uint32_t now_ms, glove_outputs *outputs);

#endif
