/* The part of the Arduino core for ESP32 that the firmware calls, as declarations only; bodies in fake_esp32.c. */
#ifndef SHIM_ESP32_HAL_H
#define SHIM_ESP32_HAL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { LOW, HIGH };
enum { INPUT = 0x01, INPUT_PULLUP = 0x05, INPUT_PULLDOWN = 0x09, OUTPUT = 0x03, SERIAL_8N1 = 0x800001c };

typedef struct uart_struct_t uart_t;

unsigned long millis(void);
void delay(uint32_t ms);
void pinMode(uint8_t pin, uint8_t mode);
void digitalWrite(uint8_t pin, uint8_t value);
int digitalRead(uint8_t pin);
uint32_t analogReadMilliVolts(uint8_t pin);
uart_t *uartBegin(uint8_t number, uint32_t baud, uint32_t config, int8_t rx_pin, int8_t tx_pin, uint32_t rx_buffer,
                  uint32_t tx_buffer, bool inverted, uint8_t rx_threshold);
uint32_t uartAvailable(uart_t *uart);
uint32_t uartAvailableForWrite(uart_t *uart);
uint8_t uartRead(uart_t *uart);
void uartWriteBuf(uart_t *uart, const uint8_t *data, size_t length);

#endif
