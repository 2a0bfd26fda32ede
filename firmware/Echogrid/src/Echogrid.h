/* Range readings and their like on the serial line, for `echogrid record`. Three lines are enough:
 *
 *     Echogrid robot(Serial);                        // beside setup() and loop()
 *     Serial.begin(115200), robot.begin("my_robot"); // in setup()
 *     robot.range("ping", millimetres);              // in loop()
 */
#ifndef ECHOGRID_H
#define ECHOGRID_H

#include <Arduino.h>

#include "echogrid_line.h"

class Echogrid {
public:
    static const int32_t NOTHING_SEEN = ECHOGRID_NOTHING_SEEN;
    static const int32_t TOO_CLOSE = ECHOGRID_TOO_CLOSE;

    explicit Echogrid(Print &out) : out(out) {}

    /* The robot's name and its firmware's: one word each, at most 32 characters. Sent now, and
     * again every 5 s. */
    void begin(const char *robot, const char *firmware = "arduino");

    /* `ms`: when it was measured, in milliseconds since boot. Left out, it was just now. */
    void range(const char *sensor, int32_t mm) { range(sensor, mm, millis()); }
    void range(const char *sensor, int32_t mm, uint32_t ms);
    /* Hundredths of a degree, counter-clockwise; 0 is straight ahead. Send it before the range. */
    void head(int32_t centidegrees) { head(centidegrees, millis()); }
    void head(int32_t centidegrees, uint32_t ms);
    /* Counts since boot; forwards counts up. */
    void wheels(int32_t left, int32_t right) { wheels(left, right, millis()); }
    void wheels(int32_t left, int32_t right, uint32_t ms);
    /* For a robot that knows where it is. */
    void pose(int32_t x_mm, int32_t y_mm, int32_t centidegrees) { pose(x_mm, y_mm, centidegrees, millis()); }
    void pose(int32_t x_mm, int32_t y_mm, int32_t centidegrees, uint32_t ms);
    void log(const char *text);

private:
    void start(const char *kind, uint32_t ms);
    void send();
    void hello();

    Print &out;
    const char *robot = nullptr;
    const char *firmware = nullptr;
    echogrid_line line;
    uint16_t seq = 0;
    uint32_t hello_ms = 0;
};

#endif
