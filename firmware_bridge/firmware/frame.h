/* Frames on the serial line: type, sequence number, payload and CRC-16/IBM-3740, in COBS (Cheshire and Baker 1999)
 * between zero bytes. A decoder takes bytes in any pieces, needs a fixed buffer and resynchronises at every zero byte.
 * firmware_bridge/protocol.py is the same layout in Python. */
#ifndef WAYCHAIR_FRAME_H
#define WAYCHAIR_FRAME_H

#include <stddef.h>
#include <stdint.h>

/* Each board's longest payload, given to the compiler where it is not the chair's board's. */
#ifndef FRAME_PAYLOAD_LIMIT
#define FRAME_PAYLOAD_LIMIT 48                      /* the chair's board's longest payload is 41 bytes */
#endif

enum {
    FRAME_PAYLOAD_MAX = FRAME_PAYLOAD_LIMIT,    /* below 249, so that one COBS code byte reaches over a frame */
    FRAME_HEAD = 3,                             /* type u8, sequence u16 */
    FRAME_CRC = 2,
    FRAME_PLAIN_MAX = FRAME_HEAD + FRAME_PAYLOAD_MAX + FRAME_CRC,
    FRAME_WIRE_MAX = FRAME_PLAIN_MAX + 2        /* one COBS code byte (below 254 bytes) and the zero that ends it */
};

typedef struct {
    uint8_t type;
    uint16_t sequence;
    uint8_t length; /* of the payload */
    uint8_t payload[FRAME_PAYLOAD_MAX];
} frame;

typedef enum { DECODED_NOTHING, DECODED_FRAME, DECODED_BAD } decoded;

/* The bytes since the last zero byte; a `length` of one more than the buffer marks an overflow. */
typedef struct {
    uint8_t bytes[FRAME_WIRE_MAX];
    size_t length;
} frame_decoder;

uint16_t frame_crc(const uint8_t *bytes, size_t length);

/* Returns the bytes written to `wire` of FRAME_WIRE_MAX bytes; the frame's `length` is at most FRAME_PAYLOAD_MAX. */
size_t frame_encode(const frame *source, uint8_t *wire);

void frame_decoder_init(frame_decoder *decoder);

/* Takes one byte. DECODED_FRAME: `*result` is a frame with a correct CRC. DECODED_BAD: the bytes before this zero byte
 * are not a frame. */
decoded frame_decode(frame_decoder *decoder, uint8_t byte, frame *result);

#endif
