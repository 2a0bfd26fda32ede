/* Two quadrature encoders on port D; every change of either wire is counted. */
#include "hardware.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>

#define WIRES (1 << PD2 | 1 << PD3 | 1 << PD4 | 1 << PD5)
#define MISSED 2

/* By the wires before and now, each as A B: forwards they go 00, 10, 11, 01. */
static const int8_t STEP[16] = {0, -1, 1, MISSED, 1, 0, MISSED, -1, -1, MISSED, 0, 1, MISSED, 1, -1, 0};

static volatile wheel_counts counts;
static volatile uint8_t before;

static inline uint8_t wires_of(uint8_t port, uint8_t a, uint8_t b)
{
    return (uint8_t)((port >> a & 1) << 1 | (port >> b & 1));
}

static inline void count(volatile uint16_t *wheel, uint8_t was, uint8_t is)
{
    int8_t step = STEP[was << 2 | is];
    if (step == MISSED)
        counts.missed++;
    else
        *wheel += (uint16_t)step;
}

ISR(PCINT2_vect)
{
    uint8_t now = PIND;
    count(&counts.left, wires_of(before, PD2, PD4), wires_of(now, PD2, PD4));
    count(&counts.right, wires_of(before, PD3, PD5), wires_of(now, PD3, PD5));
    before = now;
}

void wheels_begin(void)
{
    PORTD |= WIRES; /* pull-ups, for encoders that only pull down, and for none at all */
    before = PIND;
    PCMSK2 = WIRES;
    PCICR |= 1 << PCIE2;
}

wheel_counts wheels_read(void)
{
    wheel_counts now = {0, 0, 0};
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
    {
        now.left = counts.left;
        now.right = counts.right;
        now.missed = counts.missed;
        counts.missed = 0;
    }
    return now;
}
