/* The glove's loop on hardware of numbers, so that tests step it by the millisecond under a clock of their own. */
#include <string.h>

#include "glove/glove_board.h"
#include "glove/glove_hal.h"

enum { RX_MAX = 1 << 16, TX_MAX = 1 << 16 };

void rig_start(const char *device, uint8_t layout, uint8_t motors, uint8_t hand);
void rig_feed(const uint8_t *bytes, size_t length);
size_t rig_take(uint8_t *bytes);
void rig_sense(bool worn, uint8_t pressed, uint16_t open, uint16_t shorted, int8_t temperature_c);
void rig_run(uint32_t first_ms, uint32_t count, uint8_t *levels);
uint32_t rig_kicks(void);
uint32_t rig_motors(void);

static glove_board BOARD;
static uint8_t rx[RX_MAX], tx[TX_MAX];
static size_t rx_at, rx_end, tx_end;
static uint32_t clock_ms, kicks, begun_motors;
static glove_inputs sensed;
static uint8_t driven[GLOVE_MOTORS_MAX];

void rig_start(const char *device, uint8_t layout, uint8_t motors, uint8_t hand)
{
    glove_config config = {.layout = layout, .motors = motors, .hand = hand};
    memcpy(config.device_id, device, GLOVE_ID_LENGTH);
    rx_at = rx_end = tx_end = 0;
    clock_ms = kicks = begun_motors = 0;
    memset(&BOARD, 0xA5, sizeof BOARD);
    memset(driven, 0xA5, sizeof driven);
    glove_board_init(&BOARD, &config);
}

void rig_feed(const uint8_t *bytes, size_t length)
{
    if (rx_at == rx_end)
        rx_at = rx_end = 0;
    memcpy(rx + rx_end, bytes, length);
    rx_end += length;
}

size_t rig_take(uint8_t *bytes)
{
    const size_t length = tx_end;
    memcpy(bytes, tx, length);
    tx_end = 0;
    return length;
}

void rig_sense(bool worn, uint8_t pressed, uint16_t open, uint16_t shorted, int8_t temperature_c)
{
    memset(&sensed, 0, sizeof sensed);
    sensed.worn = worn;
    sensed.pressed[BUTTON_REPEAT] = (pressed & 1) != 0;
    sensed.pressed[BUTTON_YES] = (pressed & 2) != 0;
    sensed.open = open;
    sensed.shorted = shorted;
    sensed.temperature_c = temperature_c;
}

void rig_run(uint32_t first_ms, uint32_t count, uint8_t *levels)
{
    for (uint32_t i = 0; i < count; i++) {
        clock_ms = first_ms + i;
        (void)glove_board_step(&BOARD);
        memcpy(levels + (size_t)i * GLOVE_MOTORS_MAX, driven, sizeof driven);
    }
}

uint32_t rig_kicks(void)
{
    return kicks;
}

uint32_t rig_motors(void)
{
    return begun_motors;
}

void glove_hal_begin(uint8_t motors)
{
    begun_motors = motors;
    memset(driven, 0, sizeof driven);
}

uint32_t glove_hal_now_ms(void)
{
    return clock_ms;
}

bool glove_hal_read_byte(uint8_t *byte)
{
    if (rx_at == rx_end)
        return false;
    *byte = rx[rx_at++];
    return true;
}

void glove_hal_write(const uint8_t *bytes, size_t length)
{
    if (length > TX_MAX - tx_end)
        return;
    memcpy(tx + tx_end, bytes, length);
    tx_end += length;
}

void glove_hal_sense(glove_inputs *inputs)
{
    const glove_message host = inputs->host;
    *inputs = sensed;
    inputs->host = host;
}

void glove_hal_put(const uint8_t level[GLOVE_MOTORS_MAX])
{
    memcpy(driven, level, sizeof driven);
}

void glove_hal_kick(void)
{
    kicks++;
}
