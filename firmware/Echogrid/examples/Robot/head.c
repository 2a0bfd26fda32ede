/* The servo's pulses, by interrupts of timer 1: right to some 5 us, thus to half a degree. */
#include "hardware.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>

#include "settings.h"

#define SERVO PB1 /* pin 9 */
#define TICKS_PER_US (F_CPU / 8 / 1000000)
#define PERIOD_TICKS ((uint16_t)(20000 * TICKS_PER_US))
#define SWEEP_CDEG (HEAD_SWEEP_DEG * 100L)
#define LAP_MS (4000L * HEAD_SWEEP_DEG / HEAD_DEG_PER_S) /* left, back, right, back */
#if LAP_MS > 10000
#error "so slow a head does not fit its arithmetic: at most 10 s from left to left"
#endif

static volatile uint16_t wanted_ticks = SERVO_AHEAD_US * TICKS_PER_US;
static uint32_t start_ms; /* of the sweep, and then of a lap */

ISR(TIMER1_COMPA_vect)
{
    static uint16_t width;
    if (PORTB & 1 << SERVO) {
        PORTB &= (uint8_t)~(1 << SERVO);
        OCR1A += (uint16_t)(PERIOD_TICKS - width);
    } else {
        PORTB |= 1 << SERVO;
        width = wanted_ticks;
        OCR1A += width;
    }
}

void head_begin(void)
{
    start_ms = clock_ms() + SETTLE_MS;
    DDRB |= 1 << SERVO;
    OCR1A = (uint16_t)(TCNT1 + 1000);
    TIMSK1 |= 1 << OCIE1A;
}

/* To and fro at a steady pace, left first: where the servo is asked to be at `ms`. */
static int16_t wanted_centidegrees(uint32_t ms)
{
#if HEAD_SWEEP_DEG
    int16_t since_ms = (int16_t)(ms - start_ms);
    if (since_ms < 0)
        return 0;
    int32_t at = (int32_t)(since_ms % LAP_MS) * HEAD_DEG_PER_S / 10; /* 0 to 4 sweeps */
    if (at < SWEEP_CDEG)
        return (int16_t)at;
    return (int16_t)(at < 3 * SWEEP_CDEG ? 2 * SWEEP_CDEG - at : at - 4 * SWEEP_CDEG);
#else
    (void)ms;
    return 0;
#endif
}

void head_follow(void)
{
    uint32_t ms = clock_ms();
#if HEAD_SWEEP_DEG
    if ((int16_t)(ms - start_ms) >= 2 * LAP_MS) /* so that the clock may wrap */
        start_ms += LAP_MS;
#endif
    int32_t turn_us = (int32_t)wanted_centidegrees(ms) * SERVO_US_PER_90_DEG / 9000;
    uint16_t ticks = (uint16_t)((SERVO_AHEAD_US + turn_us) * (int32_t)TICKS_PER_US);
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { wanted_ticks = ticks; }
}

int16_t head_centidegrees(uint32_t ms)
{
    return wanted_centidegrees(ms - HEAD_LAG_MS);
}
