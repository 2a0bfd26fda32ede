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

/* sonar.c */
typedef enum { SONAR_BUSY, SONAR_MEASURED, SONAR_SILENT, SONAR_STUCK } sonar_state;
typedef struct {
    sonar_state state;
    int16_t mm;  /* or one of ECHOGRID_NOTHING_SEEN and ECHOGRID_TOO_CLOSE */
    uint32_t ms; /* when the sound met the obstacle */
} sonar_reading;
void sonar_begin(void);
void sonar_ping(void);
/* BUSY until it is known what came of the ping; SILENT: no pulse; STUCK: the pin stayed high. */
sonar_reading sonar_read(void);

/* infrared.c */
typedef struct {
    bool done;
    int16_t mm;  /* as above */
    uint32_t ms;
} infrared_reading;
void infrared_begin(void);
void infrared_start(void);
infrared_reading infrared_read(void);

/* head.c */
void head_begin(void);
/* Send the servo where it should be now; call it often. */
void head_follow(void);
/* Where the head looked at `ms`, in hundredths of a degree, counter-clockwise. */
int16_t head_centidegrees(uint32_t ms);

/* wheels.c */
typedef struct {
    uint16_t left, right; /* quarter periods of the encoders; forwards counts up; may wrap */
    uint16_t missed;      /* steps that came too fast to tell their direction */
} wheel_counts;
void wheels_begin(void);
wheel_counts wheels_read(void);

#ifdef __cplusplus
}
#endif

#endif
