/* The chip's own devices, each with its interrupts, so that nothing here ever waits. */
#ifndef HARDWARE_H
#define HARDWARE_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* clock.c: milliseconds since boot. They wrap after 49.7 days, so compare differences. */
void clock_begin(void);
uint32_t clock_ms(void);

/* serial.c */
void serial_begin(void);
/* All of it or, where there is no room, nothing: the host sees by the number that a line lacks. */
void serial_write(const char *data, uint8_t length);

typedef struct {
    int16_t mm;  /* or ECHOGRID_NOTHING_SEEN, ECHOGRID_TOO_CLOSE */
    uint32_t ms; /* when it was so */
} range_reading;

/* sonar.c */
#define SONAR_TAKES_MS 30 /* sound comes back from 4 m within 24 ms; timer 1 goes round in 32.8 */
typedef enum { SONAR_WORKS, SONAR_SILENT, SONAR_STUCK } sonar_state;
void sonar_begin(void);
void sonar_ping(void);
/* What came of the ping, SONAR_TAKES_MS after it. SILENT: no pulse; STUCK: the pin stayed high. */
sonar_state sonar_read(range_reading *reading);

/* infrared.c */
#define INFRARED_TAKES_MS 2
void infrared_begin(void);
void infrared_start(void);
/* What came of it, INFRARED_TAKES_MS later. */
range_reading infrared_read(void);

/* head.c */
void head_begin(void);
/* Send the servo where it should be now; call it often. */
void head_follow(void);
/* Where the head looked at `ms`, in hundredths of a degree, counter-clockwise. */
int16_t head_centidegrees(uint32_t ms);

/* wheels.c */
typedef struct {
    uint16_t left, right; /* quarter periods of the encoders; forwards counts up; may wrap */
    uint16_t missed;      /* steps that came too fast to know their direction */
} wheel_counts;
void wheels_begin(void);
wheel_counts wheels_read(void);

#ifdef __cplusplus
}
#endif

#endif
