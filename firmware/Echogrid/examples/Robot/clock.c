/* Timer 2 ticks once a millisecond. An Arduino's millis() stays free, but is not needed. */
#include "hardware.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>

#include "settings.h"

static volatile uint32_t ms = CLOCK_AT_BOOT_MS;

ISR(TIMER2_COMPA_vect)
{
    ms++;
}

void clock_begin(void)
{
    TCCR2A = 1 << WGM21;  /* from 0 to OCR2A */
    TCCR2B = 1 << CS22;   /* 16 MHz / 64 */
    OCR2A = F_CPU / 64 / 1000 - 1;
    TIMSK2 = 1 << OCIE2A;
}

uint32_t clock_ms(void)
{
    uint32_t now = 0;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { now = ms; }
    return now;
}
