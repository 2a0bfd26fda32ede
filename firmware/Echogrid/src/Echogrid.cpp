#include "Echogrid.h"

static const uint32_t HELLO_PERIOD_MS = 5000;

void Echogrid::begin(const char *robot, const char *firmware)
{
    this->robot = robot;
    this->firmware = firmware;
    hello();
}

void Echogrid::range(const char *sensor, int32_t mm, uint32_t ms)
{
    start("RNG", ms);
    echogrid_word(&line, sensor);
    echogrid_integer(&line, mm);
    send();
}

void Echogrid::head(int32_t centidegrees, uint32_t ms)
{
    start("HED", ms);
    echogrid_word(&line, "head");
    echogrid_integer(&line, centidegrees);
    send();
}

void Echogrid::wheels(int32_t left, int32_t right, uint32_t ms)
{
    start("WHL", ms);
    echogrid_integer(&line, left);
    echogrid_integer(&line, right);
    send();
}

void Echogrid::pose(int32_t x_mm, int32_t y_mm, int32_t centidegrees, uint32_t ms)
{
    start("POS", ms);
    echogrid_integer(&line, x_mm);
    echogrid_integer(&line, y_mm);
    echogrid_integer(&line, centidegrees);
    send();
}

void Echogrid::log(const char *text)
{
    start("LOG", millis());
    echogrid_word(&line, text);
    send();
}

void Echogrid::hello()
{
    hello_ms = millis();
    echogrid_start(&line, "HEL", seq, hello_ms);
    echogrid_integer(&line, ECHOGRID_PROTOCOL_VERSION);
    echogrid_word(&line, robot);
    echogrid_word(&line, firmware);
    send();
}

void Echogrid::start(const char *kind, uint32_t ms)
{
    if (robot != nullptr && millis() - hello_ms >= HELLO_PERIOD_MS)
        hello();
    echogrid_start(&line, kind, seq, ms);
}

void Echogrid::send()
{
    echogrid_end(&line);
    seq++;
    out.write((const uint8_t *)line.text, line.length);
}
