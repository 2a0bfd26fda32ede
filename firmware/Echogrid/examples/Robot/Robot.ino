// A robot for `echogrid record`: sonar and infrared ranger on a turning head, two wheel encoders.
// For an ATmega328P at 16 MHz (Uno, Nano). Your own values: settings.h. Wiring: docs/firmware.md.
//
// Every 50 ms: a ping, the wheels, an infrared reading; each is reported with the time at which it
// was measured. Nothing waits: interrupts do what is urgent, and the loop runs once a millisecond.

#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>

#include <echogrid_line.h>

#include "hardware.h"
#include "settings.h"

const uint8_t FRAME_MS = 50;
const uint8_t INFRARED_AT_MS = 25;
const uint32_t HELLO_PERIOD_MS = 5000;

static uint16_t seq = SEQ_AT_BOOT;
static echogrid_line line;
static uint32_t frame_ms, hello_ms;
static bool infrared_due;
static const char *trouble;  // the latest, until it is told

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

static void report_range(const char *sensor, int16_t mm, uint32_t ms)
{
    if (HEAD_SWEEP_DEG) {
        start("HED", ms);
        echogrid_word(&line, "head");
        echogrid_integer(&line, head_centidegrees(ms));
        send();
    }
    start("RNG", ms);
    echogrid_word(&line, sensor);
    echogrid_integer(&line, mm);
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

static void take_readings()
{
    sonar_reading sonar = sonar_read();
    if (sonar.state == SONAR_MEASURED)
        report_range("ping", sonar.mm, sonar.ms);
    else if (sonar.state == SONAR_SILENT)
        trouble = "sonar: no pulse on pin 8";
    else if (sonar.state == SONAR_STUCK)
        trouble = "sonar: pin 8 stays high";
    infrared_reading infrared = infrared_read();
    if (infrared.done)
        report_range("dirrs", infrared.mm, infrared.ms);
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
    frame_ms = hello_ms = clock_ms();
}

void loop()
{
    static uint32_t now_ms;
    while (clock_ms() == now_ms)
        sleep_mode();
    now_ms = clock_ms();
    head_follow();
    take_readings();
    if (infrared_due && now_ms - frame_ms >= INFRARED_AT_MS) {
        infrared_due = false;
        infrared_start();
    }
    if (now_ms - frame_ms >= FRAME_MS) {
        frame_ms += FRAME_MS;
        infrared_due = true;
        sonar_ping();
        report_wheels();
    }
    if (now_ms - hello_ms >= HELLO_PERIOD_MS) {
        hello_ms += HELLO_PERIOD_MS;
        report_hello();
        if (trouble)
            report_text(trouble);
        trouble = nullptr;
    }
}
