/* The board's loop, the same on every board: one frame in, one safety step, lines out, telemetry back. */
#ifndef WAYCHAIR_BOARD_H
#define WAYCHAIR_BOARD_H

#include "frame.h"
#include "protocol.h"
#include "safety_core.h"

enum { TELEMETRY_MS = 20 };

typedef struct {
    char chair_id[CHAIR_ID_LENGTH];
    safety_config safety;
} board_config;

typedef struct {
    board_config config;
    bool configured;
    safety_core core;
    frame_decoder decoder;
    bool converter_ok;             /* the converter accepted the last voltages */
    uint16_t sequence;
    uint32_t telemetry_ms;
    uint16_t echo_sequence;
    uint32_t echo_stamp_us;
    uint16_t bad_frames;
    uint16_t rejected;
} board;

void board_init(board *self, const board_config *config);

/* To be called every millisecond; returns the decision of the safety core. */
safety_outputs board_step(board *self);

#endif
