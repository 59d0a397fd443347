/* The HAL on an ESP32 by the Arduino core's C functions. Compiled in the tests against shims of its headers; NOT RUN ON
 * HARDWARE. */
#include "../hal.h"

#include "../converter.h"
#include "dac.h"
#include "driver/gpio.h"
#include "esp32-hal.h"
#include "pins.h"

enum { UART = 0, BAUD = 115200, RX_BUFFER = 1024, TX_BUFFER = 512, RX_THRESHOLD = 1, PIN_DEFAULT = -1 };

static const joystick_family *chair;
static uart_t *serial;
static bool converter_ready;

static uint16_t counts_max(void)
{
    return (uint16_t)((1u << DAC_BITS) - 1);
}

void hal_begin(const joystick_family *family)
{
    chair = family;
    /* Set before the pins become outputs, so that the lines stay at the joystick and uncut. It uses the IDF, because
     * from core 3.0 on digitalWrite ignores a pin that is not an output yet. */
    (void)gpio_set_level((gpio_num_t)PIN_SWITCH, LOW);
    (void)gpio_set_level((gpio_num_t)PIN_CUT, HIGH);
    pinMode(PIN_SWITCH, OUTPUT);
    pinMode(PIN_CUT, OUTPUT);
    pinMode(PIN_KICK, OUTPUT);
    pinMode(PIN_ESTOP, INPUT_PULLDOWN);
    if (family != NULL)
        converter_ready = dac_begin(converter_counts(family, counts_max(), family->reference_mv));
    serial = uartBegin(UART, BAUD, SERIAL_8N1, PIN_DEFAULT, PIN_DEFAULT, RX_BUFFER, TX_BUFFER, false, RX_THRESHOLD);
}

hal_converter hal_converter_of_board(void)
{
    return (hal_converter){DAC_BITS, counts_max()};
}

uint32_t hal_now_ms(void)
{
    return (uint32_t)millis();
}

bool hal_read_byte(uint8_t *byte)
{
    if (uartAvailable(serial) == 0)
        return false;
    *byte = uartRead(serial);
    return true;
}

void hal_write(const uint8_t *bytes, size_t length)
{
    if (uartAvailableForWrite(serial) >= length)
        uartWriteBuf(serial, bytes, length);
}

static uint16_t line_mv(uint8_t pin)
{
    const uint32_t at_pin = analogReadMilliVolts(pin);
    return (uint16_t)(chair == NULL ? at_pin : at_pin * (uint32_t)chair->fault_high_mv / PIN_FULL_MV);
}

void hal_sense(safety_inputs *inputs)
{
    inputs->joystick_mv[AXIS_FORWARD] = line_mv(PIN_STICK_FORWARD);
    inputs->joystick_mv[AXIS_TURN] = line_mv(PIN_STICK_TURN);
    inputs->line_mv[AXIS_FORWARD] = line_mv(PIN_LINE_FORWARD);
    inputs->line_mv[AXIS_TURN] = line_mv(PIN_LINE_TURN);
    inputs->reference_mv = line_mv(PIN_REFERENCE);
    inputs->estop_released = digitalRead(PIN_ESTOP) == HIGH;
    inputs->board_ok = converter_ready;
}

bool hal_put(const uint16_t mv[AXES])
{
    if (chair == NULL)
        return true;
    const uint16_t counts[AXES] = {converter_counts(chair, counts_max(), mv[AXIS_FORWARD]),
                                   converter_counts(chair, counts_max(), mv[AXIS_TURN])};
    return dac_put(counts);
}

void hal_switch(uint8_t holder)
{
    digitalWrite(PIN_CUT, holder == HOLDER_CUT ? LOW : HIGH);
    digitalWrite(PIN_SWITCH, holder == HOLDER_BOARD ? HIGH : LOW);
}

void hal_kick(void)
{
    digitalWrite(PIN_KICK, HIGH);
    digitalWrite(PIN_KICK, LOW);
}
