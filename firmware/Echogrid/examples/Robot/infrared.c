/* A Sharp GP2Y0A21 (or the DIRRS+'s like) on A0: eight conversions, summed by interrupt. */
#include "hardware.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/pgmspace.h>
#include <echogrid_line.h>

#include "settings.h"

#define CONVERSIONS 8
#define FULL_SCALE (1023UL * CONVERSIONS)

typedef struct {
    uint16_t mv, mm;
} point;

/* The typical curve of the data sheet (fig. 2). Another sensor: its own points, nearest first. */
static const point CURVE[] PROGMEM = {
    {2320, 100}, {2000, 120}, {1760, 140}, {1550, 160}, {1400, 180}, {1275, 200}, {1080, 250},
    {925, 300},  {810, 350},  {740, 400},  {610, 500},  {515, 600},  {450, 700},  {410, 800},
};
#define POINTS (sizeof CURVE / sizeof CURVE[0])

static volatile uint16_t sum;
static volatile uint8_t left;
static uint32_t start_ms;

ISR(ADC_vect)
{
    sum += ADC;
    if (--left > 0)
        ADCSRA |= 1 << ADSC;
}

void infrared_begin(void)
{
    ADMUX = 1 << REFS0; /* against the supply, channel 0 */
    DIDR0 = 1 << ADC0D;
    ADCSRA = 1 << ADEN | 1 << ADIE | 7; /* 125 kHz: 104 us each */
}

void infrared_start(void)
{
    start_ms = clock_ms();
    sum = 0;
    left = CONVERSIONS;
    ADCSRA |= 1 << ADSC;
}

static int16_t millimetres(uint16_t mv)
{
    point far, near = {pgm_read_word(&CURVE[0].mv), pgm_read_word(&CURVE[0].mm)};
    if (mv > near.mv)
        return ECHOGRID_TOO_CLOSE;
    for (uint8_t i = 1; i < POINTS; i++) {
        far = (point){pgm_read_word(&CURVE[i].mv), pgm_read_word(&CURVE[i].mm)};
        if (mv >= far.mv) { /* between these two: straight in 1/range, as light is */
            uint32_t share = ((uint32_t)(near.mv - mv) << 8) / (uint16_t)(near.mv - far.mv);
            uint32_t below = ((uint32_t)far.mm << 8) - share * (uint16_t)(far.mm - near.mm);
            return (int16_t)(((uint32_t)near.mm * far.mm << 8) / below);
        }
        near = far;
    }
    return ECHOGRID_NOTHING_SEEN;
}

range_reading infrared_read(void)
{
    uint16_t mv = (uint16_t)(sum * 5000UL / FULL_SCALE);
    return (range_reading){millimetres(mv), start_ms - INFRARED_AGE_MS};
}
