/* What is yours to change: which sensors there are, and how they are built in. */
#ifndef SETTINGS_H
#define SETTINGS_H

#define ROBOT_NAME "arduino"
#define FIRMWARE_NAME "echogrid-1.0"

/* Pins are fixed, as the chip's own timers and interrupts serve them:
 *   8  echo of the sonar (and its trigger, where it has one wire for both)
 *   7  trigger of an HC-SR04
 *   9  servo
 *   2, 4  left wheel's encoder A and B;  3, 5  the right one's
 *   A0 infrared ranger
 */

/* One wire for both (Parallax Ping))), SEN136B5B) or two (HC-SR04, US-100)? */
#ifndef SONAR_HAS_ONE_WIRE
#define SONAR_HAS_ONE_WIRE 0
#endif
#if SONAR_HAS_ONE_WIRE
#define SONAR_MAX_MM 3100 /* its pulse ends after 18.5 ms, echo or not */
#else
#define SONAR_MAX_MM 4000
#endif
#define SONAR_MIN_MM 20
/* Sound is faster when it is warm: 1.8 % in 10 degrees, thus 5 cm in 3 m. */
#define AIR_CELSIUS 20

/* 0 where there is none: an open pin shows anything. */
#ifndef HAS_INFRARED
#define HAS_INFRARED 1
#endif
/* Age of what the infrared ranger shows: it measures for 38 ms, shows it 5 ms later, for 38 ms. */
#define INFRARED_AGE_MS 43

/* How far the head turns to either side; 0: it looks ahead, and no line reports it. */
#ifndef HEAD_SWEEP_DEG
#define HEAD_SWEEP_DEG 60
#endif
#define HEAD_DEG_PER_S 60
#define SERVO_AHEAD_US 1500
#define SERVO_US_PER_90_DEG 1000 /* negative where a longer pulse turns it to the right */
#define HEAD_LAG_MS 15           /* the servo follows so late */

/* From boot to the first ping: the servo gets to its place, the infrared ranger to its first value. */
#define SETTLE_MS 400

/* A wheel that counts backwards: swap its wires A and B. */
#define BAUD 115200UL

/* For the tests: what the clock and the lines begin with. */
#ifndef CLOCK_AT_BOOT_MS
#define CLOCK_AT_BOOT_MS 0
#endif
#ifndef SEQ_AT_BOOT
#define SEQ_AT_BOOT 0
#endif

#endif
