/* An ESP32 on paper: pins, analogue inputs, a UART, and an MCP4728 with its registers and EEPROM. Line voltages follow
 * the converter through the gain stage of the 5 V Hall family, the switch and the dividers, as they would on a bench.
 * Pins are as in the Arduino core from 3.0 on: digitalWrite does nothing to one that pinMode has not made an output,
 * and one that becomes it is at the level of its register, LOW after a boot. */
#include <string.h>

#include "converter.h"
#include "dac.h"
#include "driver/gpio.h"
#include "esp32-hal-dac.h"
#include "esp32-hal-i2c.h"
#include "esp32-hal.h"
#include "pins.h"

enum { PINS = 40, BUFFER = 8192 };

unsigned long fake_ms;
uint8_t fake_pins[PINS];
static uint8_t levels[PINS], outputs[PINS];
uint8_t fake_rx[BUFFER], fake_tx[BUFFER];
uint32_t fake_rx_at, fake_rx_end, fake_tx_end;
uint8_t fake_registers[24];
uint16_t fake_counts[AXES];
int fake_i2c_dead, fake_eeprom_writes, fake_eeprom_worn, fake_kicks, fake_cuts;
uint16_t fake_stick_mv[AXES] = {2500, 2500};

unsigned long millis(void)
{
    return fake_ms;
}

void delay(uint32_t ms)
{
    fake_ms += ms;
}

static void drive(uint8_t pin)
{
    if (!outputs[pin])
        return;
    fake_cuts += pin == PIN_CUT && levels[pin] == LOW;
    fake_pins[pin] = levels[pin];
}

esp_err_t gpio_set_level(gpio_num_t pin, uint32_t level)
{
    levels[pin] = level != 0;
    drive((uint8_t)pin);
    return ESP_OK;
}

void pinMode(uint8_t pin, uint8_t mode)
{
    outputs[pin] = mode == OUTPUT;
    drive(pin);
}

void digitalWrite(uint8_t pin, uint8_t value)
{
    if (!outputs[pin])
        return;
    fake_kicks += pin == PIN_KICK && value == HIGH;
    (void)gpio_set_level((gpio_num_t)pin, value);
}

int digitalRead(uint8_t pin)
{
    return fake_pins[pin];
}

static uint32_t line_mv(int axis)
{
    if (fake_pins[PIN_CUT] == LOW)
        return 2500;
    if (fake_pins[PIN_SWITCH] == LOW)
        return fake_stick_mv[axis];
    const uint16_t top = (uint16_t)((1u << DAC_BITS) - 1);
    return (uint32_t)converter_line_mv(family_find(FAMILY_HALL_5V), top, fake_counts[axis]);
}

uint32_t analogReadMilliVolts(uint8_t pin)
{
    switch (pin) {
    case PIN_REFERENCE:
        return 2500 * 2 / 3 + 1;
    case PIN_LINE_FORWARD:
        return line_mv(AXIS_FORWARD) * 2 / 3;
    case PIN_LINE_TURN:
        return line_mv(AXIS_TURN) * 2 / 3;
    default:
        return fake_stick_mv[pin == PIN_STICK_TURN] * 2u / 3;
    }
}

uart_t *uartBegin(uint8_t number, uint32_t baud, uint32_t config, int8_t rx_pin, int8_t tx_pin, uint32_t rx_buffer,
                  uint32_t tx_buffer, bool inverted, uint8_t rx_threshold)
{
    (void)number, (void)config, (void)rx_pin, (void)tx_pin, (void)rx_buffer, (void)tx_buffer, (void)inverted;
    (void)rx_threshold;
    return baud == 115200 ? (uart_t *)fake_rx : NULL;
}

uint32_t uartAvailable(uart_t *uart)
{
    return uart == NULL ? 0 : fake_rx_end - fake_rx_at;
}

uint32_t uartAvailableForWrite(uart_t *uart)
{
    return uart == NULL ? 0 : BUFFER - fake_tx_end;
}

uint8_t uartRead(uart_t *uart)
{
    (void)uart;
    return fake_rx[fake_rx_at++];
}

void uartWriteBuf(uart_t *uart, const uint8_t *data, size_t length)
{
    (void)uart;
    memcpy(fake_tx + fake_tx_end, data, length);
    fake_tx_end += (uint32_t)length;
}

bool dacWrite(uint8_t pin, uint8_t value)
{
    fake_counts[pin == PIN_DAC_TURN] = value;
    return pin == PIN_DAC_FORWARD || pin == PIN_DAC_TURN;
}

esp_err_t i2cInit(uint8_t bus, int8_t sda, int8_t scl, uint32_t frequency)
{
    return bus == 0 && sda == PIN_SDA && scl == PIN_SCL && frequency <= 400000 && !fake_i2c_dead ? ESP_OK : ESP_FAIL;
}

/* Data sheet DS22187: fast write when the two upper bits are 0, sequential write (01010, channel, UDAC) otherwise. */
esp_err_t i2cWrite(uint8_t bus, uint16_t address, const uint8_t *bytes, size_t size, uint32_t timeout_ms)
{
    (void)timeout_ms;
    if (fake_i2c_dead || bus != 0 || address != 0x60)
        return ESP_FAIL;
    const bool sequential = (bytes[0] & 0xF8) == 0x50;
    if (!sequential && (bytes[0] & 0xC0) != 0)
        return ESP_FAIL;
    for (size_t channel = 0, at = sequential; at + 1 < size; channel++, at += 2) {
        uint8_t *registers = fake_registers + 6 * channel;
        memcpy(registers + 1, bytes + at, 2);
        if (sequential && !fake_eeprom_worn)
            memcpy(registers + 4, bytes + at, 2);
        if (channel < AXES)
            fake_counts[channel] = (uint16_t)(((bytes[at] & 0x0F) << 8) | bytes[at + 1]);
    }
    fake_eeprom_writes += sequential;
    return ESP_OK;
}

esp_err_t i2cRead(uint8_t bus, uint16_t address, uint8_t *bytes, size_t size, uint32_t timeout_ms, size_t *count)
{
    (void)timeout_ms;
    if (fake_i2c_dead || bus != 0 || address != 0x60 || size > sizeof fake_registers)
        return ESP_FAIL;
    memcpy(bytes, fake_registers, size);
    *count = size;
    return ESP_OK;
}
