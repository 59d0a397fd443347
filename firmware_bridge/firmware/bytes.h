/* Little-endian numbers in bytes. */
#ifndef WAYCHAIR_BYTES_H
#define WAYCHAIR_BYTES_H

#include <stdint.h>

static inline uint16_t get_u16(const uint8_t *bytes)
{
    return (uint16_t)(bytes[0] | (bytes[1] << 8));
}

static inline uint32_t get_u32(const uint8_t *bytes)
{
    return (uint32_t)get_u16(bytes) | ((uint32_t)get_u16(bytes + 2) << 16);
}

/* Each returns the place after the number. */
static inline uint8_t *put_u8(uint8_t *bytes, uint8_t value)
{
    bytes[0] = value;
    return bytes + 1;
}

static inline uint8_t *put_u16(uint8_t *bytes, uint16_t value)
{
    return put_u8(put_u8(bytes, (uint8_t)value), (uint8_t)(value >> 8));
}

static inline uint8_t *put_u32(uint8_t *bytes, uint32_t value)
{
    return put_u16(put_u16(bytes, (uint16_t)value), (uint16_t)(value >> 16));
}

#endif
