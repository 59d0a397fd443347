/* The loop of a glove: frames, core and hardware. `glove_board_step` is called once a millisecond. */
#ifndef WAYCHAIR_GLOVE_BOARD_H
#define WAYCHAIR_GLOVE_BOARD_H

#include "glove_core.h"
#include "glove_protocol.h"

enum { GLOVE_STATUS_MS = 50 };

typedef struct {
    char device_id[GLOVE_ID_LENGTH];
    uint8_t layout;
    uint8_t motors;
    uint8_t hand;
} glove_config;

typedef struct {
    glove_config config;
    glove_core core;
    frame_decoder decoder;
    uint16_t sequence;
    uint32_t status_ms;
    uint16_t bad_frames;
    uint16_t rejected;
} glove_board;

void glove_board_init(glove_board *self, const glove_config *config);

glove_outputs glove_board_step(glove_board *self);

#endif
