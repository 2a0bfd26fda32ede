/* The echo's pulse is timed by timer 1's capture unit: to half a microsecond, whatever else runs. */
#include "hardware.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <echogrid_line.h>
#include <util/atomic.h>
#include <util/delay.h>

#include "settings.h"

#define ECHO PB0    /* pin 8, the capture unit's */
#define TRIGGER PD7 /* pin 7 */
#define TICKS_PER_MS (F_CPU / 8 / 1000)
#define SOUND_CM_PER_S ((331300UL + 606UL * AIR_CELSIUS) / 10)

typedef enum { BLOCKED, WAIT_FOR_RISE, WAIT_FOR_FALL, TIMED } phase;

static volatile phase now;
static volatile uint16_t rise, width;
static uint32_t ping_ms;

ISR(TIMER1_CAPT_vect)
{
    uint16_t edge = ICR1;
    if (now == WAIT_FOR_RISE) {
        rise = edge;
        now = WAIT_FOR_FALL;
        TCCR1B &= (uint8_t)~(1 << ICES1);
        TIFR1 = 1 << ICF1; /* changing the edge may count as one */
    } else {
        width = edge - rise;
        now = TIMED;
        TIMSK1 &= (uint8_t)~(1 << ICIE1);
    }
}

void sonar_begin(void)
{
    TCCR1A = 0;                      /* free running: Arduino's core makes it count to and fro */
    TCCR1B = 1 << ICNC1 | 1 << CS11; /* at 2 MHz, also for the servo; no short spikes */
#if !SONAR_HAS_ONE_WIRE
    DDRD |= 1 << TRIGGER;
#endif
}

void sonar_ping(void)
{
    ping_ms = clock_ms();
    if (PINB & 1 << ECHO) {
        now = BLOCKED;
        return;
    }
#if SONAR_HAS_ONE_WIRE
    PORTB |= 1 << ECHO; /* its pull-up first, so that there is no step between */
    DDRB |= 1 << ECHO;
    _delay_us(5);
    PORTB &= (uint8_t)~(1 << ECHO);
    DDRB &= (uint8_t)~(1 << ECHO);
#else
    PORTD |= 1 << TRIGGER;
    _delay_us(10);
    PORTD &= (uint8_t)~(1 << TRIGGER);
#endif
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
    {
        now = WAIT_FOR_RISE;
        TCCR1B |= 1 << ICES1;
        TIFR1 = 1 << ICF1;
        TIMSK1 |= 1 << ICIE1;
    }
}

static int16_t millimetres(uint16_t ticks)
{
    uint32_t mm = (ticks * SOUND_CM_PER_S + TICKS_PER_MS * 100) / (TICKS_PER_MS * 200);
    if (mm > SONAR_MAX_MM)
        return ECHOGRID_NOTHING_SEEN;
    return mm < SONAR_MIN_MM ? ECHOGRID_TOO_CLOSE : (int16_t)mm;
}

sonar_state sonar_read(range_reading *reading)
{
    TIMSK1 &= (uint8_t)~(1 << ICIE1);
    *reading = (range_reading){ECHOGRID_NOTHING_SEEN, ping_ms};
    if (now == TIMED) {
        reading->mm = millimetres(width);
        reading->ms += width / (2 * TICKS_PER_MS); /* when the sound met the obstacle */
    }
    return now == BLOCKED ? SONAR_STUCK : now == WAIT_FOR_RISE ? SONAR_SILENT : SONAR_WORKS;
}
