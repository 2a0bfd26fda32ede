/* Bytes wait in a ring and leave one by one, by interrupt. */
#include "hardware.h"

#include <avr/interrupt.h>
#include <avr/io.h>

#include "settings.h"

static volatile char ring[256]; /* so that indices of 8 bits wrap by themselves */
static volatile uint8_t first, next;

ISR(USART_UDRE_vect)
{
    UDR0 = (uint8_t)ring[first++];
    if (first == next)
        UCSR0B &= (uint8_t)~(1 << UDRIE0);
}

void serial_begin(void)
{
    UCSR0A = 1 << U2X0;
    UBRR0 = (F_CPU / 4 / BAUD - 1) / 2;
    UCSR0B = 1 << TXEN0;
    UCSR0C = 1 << UCSZ01 | 1 << UCSZ00; /* 8N1 */
}

void serial_write(const char *data, uint8_t length)
{
    uint8_t room = (uint8_t)(first - next - 1);
    if (length > room)
        return;
    uint8_t end = next;
    while (length-- > 0)
        ring[end++] = *data++;
    next = end;
    UCSR0B |= 1 << UDRIE0;
}
