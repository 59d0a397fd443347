/* Frames on the serial line: see frame.h. */
#include "frame.h"

#include <string.h>

static const uint16_t CRC_START = 0xFFFF;
static const uint16_t CRC_POLYNOMIAL = 0x1021;

uint16_t frame_crc(const uint8_t *bytes, size_t length)
{
    uint16_t crc = CRC_START;
    for (size_t i = 0; i < length; i++) {
        crc = (uint16_t)(crc ^ (uint16_t)(bytes[i] << 8));
        for (int bit = 0; bit < 8; bit++)
            crc = (uint16_t)((crc & 0x8000) ? (uint16_t)(crc << 1) ^ CRC_POLYNOMIAL : crc << 1);
    }
    return crc;
}

/* COBS of fewer than 254 bytes: every zero becomes the distance to the next one. The closing zero is included. */
static size_t stuff(const uint8_t *plain, size_t length, uint8_t *wire)
{
    size_t code = 0;
    for (size_t i = 0; i < length; i++) {
        wire[i + 1] = plain[i];
        if (plain[i] == 0) {
            wire[code] = (uint8_t)(i + 1 - code);
            code = i + 1;
        }
    }
    wire[code] = (uint8_t)(length + 1 - code);
    wire[length + 1] = 0;
    return length + 2;
}

/* The reverse, in place and without the closing zero: returns the plain length, or 0 if a code points past the end. */
static size_t unstuff(uint8_t *bytes, size_t length)
{
    size_t code = 0;
    while (code < length) {
        const size_t next = code + bytes[code];
        bytes[code] = 0;
        code = next;
    }
    if (code != length)
        return 0;
    memmove(bytes, bytes + 1, length - 1);
    return length - 1;
}

size_t frame_encode(const frame *source, uint8_t *wire)
{
    uint8_t plain[FRAME_PLAIN_MAX];
    size_t length = FRAME_HEAD + (size_t)source->length;
    plain[0] = source->type;
    plain[1] = (uint8_t)source->sequence;
    plain[2] = (uint8_t)(source->sequence >> 8);
    memcpy(plain + FRAME_HEAD, source->payload, source->length);
    const uint16_t crc = frame_crc(plain, length);
    plain[length++] = (uint8_t)crc;
    plain[length++] = (uint8_t)(crc >> 8);
    return stuff(plain, length, wire);
}

void frame_decoder_init(frame_decoder *decoder)
{
    decoder->length = 0;
}

static decoded finish(uint8_t *bytes, size_t wire_length, frame *result)
{
    const size_t length = unstuff(bytes, wire_length);
    if (length < FRAME_HEAD + FRAME_CRC)
        return DECODED_BAD;
    const size_t end = length - FRAME_CRC;
    if (frame_crc(bytes, end) != (bytes[end] | (bytes[end + 1] << 8)))
        return DECODED_BAD;
    result->type = bytes[0];
    result->sequence = (uint16_t)(bytes[1] | (bytes[2] << 8));
    result->length = (uint8_t)(end - FRAME_HEAD);
    memcpy(result->payload, bytes + FRAME_HEAD, result->length);
    return DECODED_FRAME;
}

decoded frame_decode(frame_decoder *decoder, uint8_t byte, frame *result)
{
    const size_t length = decoder->length;
    if (byte != 0) {
        if (length < FRAME_WIRE_MAX - 1)
            decoder->bytes[length] = byte;
        if (length < FRAME_WIRE_MAX)
            decoder->length = length + 1;
        return DECODED_NOTHING;
    }
    decoder->length = 0;
    if (length == 0)
        return DECODED_NOTHING; /* zeros between frames are padding */
    if (length >= FRAME_WIRE_MAX)
        return DECODED_BAD;
    return finish(decoder->bytes, length, result);
}
