// A robot for `echogrid record`: sonar and infrared ranger on a turning head, two wheel encoders.
// For an ATmega328P at 16 MHz (Uno, Nano). Your own values: settings.h. Wiring: docs/firmware.md.
//
// Every 50 ms a ping, an infrared reading and the wheels; then all are reported, in the order and
// with the times of their measurement. Nothing waits: interrupts do what is urgent, and the loop
// runs once a millisecond.

#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>

#include <echogrid_line.h>

#include "hardware.h"
#include "settings.h"

const uint8_t FRAME_MS = 50;  // a ping at its begin
const uint8_t INFRARED_AT_MS = 10;
const uint8_t REPORT_AT_MS = SONAR_TAKES_MS;
const uint32_t HELLO_PERIOD_MS = 5000;

static uint16_t seq = SEQ_AT_BOOT;
static echogrid_line line;
static uint32_t now_ms, hello_ms;
static uint8_t frame_at_ms;
static const char *trouble;  // the latest, until it is reported

static void start(const char *kind, uint32_t ms)
{
    echogrid_start(&line, kind, seq++, ms);
}

static void send()
{
    echogrid_end(&line);
    serial_write(line.text, line.length);
}

static void report_text(const char *text)
{
    start("LOG", clock_ms());
    echogrid_word(&line, text);
    send();
}

static void report_hello()
{
    start("HEL", clock_ms());
    echogrid_integer(&line, ECHOGRID_PROTOCOL_VERSION);
    echogrid_word(&line, ROBOT_NAME);
    echogrid_word(&line, FIRMWARE_NAME);
    send();
}

static void report_range(const char *sensor, range_reading reading)
{
    if (HEAD_SWEEP_DEG) {
        start("HED", reading.ms);
        echogrid_word(&line, "head");
        echogrid_integer(&line, head_centidegrees(reading.ms));
        send();
    }
    start("RNG", reading.ms);
    echogrid_word(&line, sensor);
    echogrid_integer(&line, reading.mm);
    send();
}

static void report_wheels()
{
    wheel_counts counts = wheels_read();
    start("WHL", clock_ms());
    echogrid_integer(&line, counts.left);
    echogrid_integer(&line, counts.right);
    send();
    if (counts.missed > 0)
        trouble = "wheels: steps too fast to count";
}

static void report_boot()
{
    uint8_t why = MCUSR;  // 0 where a boot loader has cleared it
    MCUSR = 0;
    report_text(why & 1 << BORF    ? "boot, brown-out: the supply broke down"
                : why & 1 << PORF  ? "boot, power on"
                : why & 1 << EXTRF ? "boot, reset"
                                   : "boot");
}

static void report_readings()
{
    if (HAS_INFRARED)
        report_range("dirrs", infrared_read());
    range_reading sonar;
    switch (sonar_read(&sonar)) {
    case SONAR_WORKS:
        report_range("ping", sonar);
        break;
    case SONAR_SILENT:
        trouble = "sonar: no pulse on pin 8";
        break;
    case SONAR_STUCK:
        trouble = "sonar: pin 8 stays high";
        break;
    }
    report_wheels();
}

void setup()
{
    cli();
    serial_begin();
    clock_begin();
    sonar_begin();
    infrared_begin();
    head_begin();
    wheels_begin();
    sei();
    report_hello();
    report_boot();
    hello_ms = clock_ms();
    while (clock_ms() - hello_ms < SETTLE_MS)
        sleep_mode();
    now_ms = clock_ms();
}

void loop()
{
    while (clock_ms() == now_ms)
        sleep_mode();
    now_ms++;  // and should it ever be late, it catches up
    head_follow();
    switch (frame_at_ms) {
    case 0:
        sonar_ping();
        break;
    case INFRARED_AT_MS:
        infrared_start();
        break;
    case REPORT_AT_MS:
        report_readings();
        break;
    }
    frame_at_ms = (uint8_t)((frame_at_ms + 1) % FRAME_MS);
    if (now_ms - hello_ms >= HELLO_PERIOD_MS) {
        hello_ms += HELLO_PERIOD_MS;
        report_hello();
        if (trouble)
            report_text(trouble);
        trouble = nullptr;
    }
}
