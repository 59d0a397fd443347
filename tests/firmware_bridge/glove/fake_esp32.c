/* An ESP32 glove on paper: pins, PWM channels with a shunt, a UART, a watchdog, and DRV2605L behind two TCA9548A. */
#include <stddef.h>
#include <string.h>

#include "esp32-hal-i2c.h"
#include "esp32-hal-ledc.h"
#include "esp32-hal.h"
#include "esp_task_wdt.h"
#include "pins.h"

enum { PINS = 40, BUFFER = 8192, MOTORS = 16, REGISTERS = 0x24 };

unsigned long fake_ms;
uint8_t fake_pins[PINS];
uint32_t fake_mv[PINS];
uint8_t fake_rx[BUFFER], fake_tx[BUFFER];
uint32_t fake_rx_at, fake_rx_end, fake_tx_end;
uint32_t fake_kicks, fake_watchdog_ms, fake_watched;
uint32_t fake_open, fake_shorted;              /* motors by bit */
uint8_t fake_duty[MOTORS];                     /* of PWM channels by motor */
uint8_t fake_drivers[MOTORS][REGISTERS];
uint32_t fake_bus_dead, fake_writes;
static uint8_t outputs[PINS], attached[PINS], ports[2], pointer;

unsigned long millis(void)
{
    return fake_ms;
}

void delay(uint32_t ms)
{
    fake_ms += ms;
}

void pinMode(uint8_t pin, uint8_t mode)
{
    outputs[pin] = mode == OUTPUT;
}

void digitalWrite(uint8_t pin, uint8_t value)
{
    if (outputs[pin])
        fake_pins[pin] = value;
}

int digitalRead(uint8_t pin)
{
    return fake_pins[pin];
}

/* 60 mA of a whole motor at full duty are 600 mV. */
static uint32_t shunt_mv(void)
{
    uint32_t mv = 0;
    for (int motor = 0; motor < PWM_PINS; motor++) {
        if (fake_open >> motor & 1)
            continue;
        mv += (uint32_t)fake_duty[motor] * (fake_shorted >> motor & 1 ? 3000u : 600u) / 255u;
    }
    return mv;
}

uint32_t analogReadMilliVolts(uint8_t pin)
{
    return pin == PIN_SHUNT ? shunt_mv() : fake_mv[pin];
}

bool ledcAttach(uint8_t pin, uint32_t frequency, uint8_t resolution)
{
    attached[pin] = frequency > 0 && resolution == 8;
    return attached[pin];
}

bool ledcWrite(uint8_t pin, uint32_t duty)
{
    for (int motor = 0; motor < PWM_PINS; motor++)
        if (PIN_MOTOR[motor] == pin && attached[pin])
            fake_duty[motor] = (uint8_t)duty;
    return attached[pin] && duty <= 255;
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

esp_err_t esp_task_wdt_reconfigure(const esp_task_wdt_config_t *config)
{
    fake_watchdog_ms = config->trigger_panic ? config->timeout_ms : 0;
    return ESP_OK;
}

esp_err_t esp_task_wdt_add(TaskHandle_t task)
{
    fake_watched += task == NULL;
    return ESP_OK;
}

esp_err_t esp_task_wdt_reset(void)
{
    fake_kicks++;
    return ESP_OK;
}

esp_err_t i2cInit(uint8_t bus, int8_t sda, int8_t scl, uint32_t frequency)
{
    return bus == 0 && sda == PIN_SDA && scl == PIN_SCL && frequency <= 400000 && !fake_bus_dead ? ESP_OK : ESP_FAIL;
}

static unsigned selected(void)
{
    return ports[0] | (unsigned)ports[1] << 8;
}

/* A diagnosis ends at once, with its result in STATUS. */
static void set_register(int motor, uint8_t where, uint8_t value)
{
    uint8_t *registers = fake_drivers[motor];
    registers[where] = value;
    if (where != 0x0C || registers[0x01] != 0x06 || value != 1)
        return;
    registers[0x0C] = 0;
    registers[0x00] = (uint8_t)((fake_shorted >> motor & 1) | (fake_open >> motor & 1) << 3);
}

esp_err_t i2cWrite(uint8_t bus, uint16_t address, const uint8_t *bytes, size_t size, uint32_t timeout_ms)
{
    (void)timeout_ms;
    if (fake_bus_dead || bus != 0 || fake_pins[PIN_ENABLE] == LOW)
        return ESP_FAIL;
    fake_writes++;
    if (address == 0x70 || address == 0x71) {
        ports[address - 0x70] = bytes[0];
        return size == 1 ? ESP_OK : ESP_FAIL;
    }
    if (address != 0x5A || selected() == 0 || size > 2)
        return ESP_FAIL;
    pointer = bytes[0];
    for (int motor = 0; size == 2 && motor < MOTORS; motor++)
        if (selected() >> motor & 1)
            set_register(motor, pointer, bytes[1]);
    return ESP_OK;
}

esp_err_t i2cRead(uint8_t bus, uint16_t address, uint8_t *bytes, size_t size, uint32_t timeout_ms, size_t *count)
{
    (void)timeout_ms;
    if (fake_bus_dead || bus != 0 || address != 0x5A || size != 1)
        return ESP_FAIL;
    for (int motor = 0; motor < MOTORS; motor++)
        if (selected() == 1u << motor)
            bytes[0] = fake_drivers[motor][pointer];
    *count = 1;
    return ESP_OK;
}
