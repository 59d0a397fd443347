/* Messages between computer and glove, as payloads of frames (../frame.h), little endian, without padding.
 * firmware_bridge/glove/messages.py holds the same table; its CRC-32 is GLOVE_LAYOUT_HASH. Another hash is refused. */
#ifndef WAYCHAIR_GLOVE_PROTOCOL_H
#define WAYCHAIR_GLOVE_PROTOCOL_H

#include <stdbool.h>
#include <stdint.h>

#include "../frame.h"
#include "glove_core.h"

static const uint8_t GLOVE_PROTOCOL_VERSION = 1;
static const uint32_t GLOVE_LAYOUT_HASH = 0xE3CEC75Au;
static const uint16_t GLOVE_FIRMWARE_VERSION = 0x0100; /* major, minor */

enum { GLOVE_ID_LENGTH = 16 }; /* padded with zeros */

/* Other numbers than those of the chair's board, so that neither takes the other's frames. */
typedef enum {
    FRAME_GLOVE_HELLO = 65,
    FRAME_GLOVE_REPLY = 66,
    FRAME_GLOVE_PLAY = 67,
    FRAME_GLOVE_STOP = 68,
    FRAME_GLOVE_GAIN = 69,
    FRAME_GLOVE_ALIVE = 70,
    FRAME_GLOVE_STATUS = 71
} glove_frame_type;

enum {
    GLOVE_REFUSED_VERSION = 1 << 0,
    GLOVE_REFUSED_TABLE = 1 << 1,
    GLOVE_REFUSED_DEVICE = 1 << 2,
    GLOVE_REFUSED_LAYOUT = 1 << 3  /* the rider's patterns are for another layout of motors */
};

typedef enum { HAND_NONE, HAND_LEFT, HAND_RIGHT } glove_hand;

typedef struct {
    uint8_t version;
    uint32_t layout_hash;
    char device_id[GLOVE_ID_LENGTH];
    uint8_t layout;
} glove_hello;

typedef struct {
    uint8_t version;
    uint32_t layout_hash;
    uint16_t firmware_version;
    char device_id[GLOVE_ID_LENGTH];
    uint8_t layout;
    uint8_t motors;
    uint8_t hand;                  /* for which it is made */
    uint8_t refused;               /* GLOVE_REFUSED_ bits; 0: the computer may play */
} glove_reply;

typedef struct {
    uint8_t state;
    bool playing;
    uint16_t sequence;             /* of the PLAY that plays */
    uint8_t step;
    uint16_t on;                   /* motors that vibrate, by bit */
    uint16_t judged;               /* sequence of the last PLAY heard */
    uint8_t refused;               /* PLAY_ bits of it */
    uint8_t cut;                   /* CUT_ bits since the last report */
    uint16_t open;
    uint16_t shorted;
    bool worn;
    uint8_t presses[BUTTONS];
    int8_t temperature_c;
    uint32_t board_ms;
    uint16_t bad_frames;
    uint16_t rejected;             /* valid frames outside the sequence window or without a session */
} glove_status;

/* False: the frame has another type or length. */
bool glove_read_hello(const frame *source, glove_hello *message);

/* Fills event, sequence and content of PLAY, STOP, GAIN and ALIVE. */
bool glove_read_order(const frame *source, glove_message *message);

/* Fill type, length and payload of the frame; the caller sets its sequence. */
void glove_write_reply(const glove_reply *message, frame *result);
void glove_write_status(const glove_status *message, frame *result);

#endif
