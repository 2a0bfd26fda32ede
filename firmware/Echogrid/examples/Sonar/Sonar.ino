// An HC-SR04 (trigger on pin 7, echo on pin 8): 15 readings a second for `echogrid record`.
#include <Echogrid.h>

const int TRIGGER = 7, ECHO = 8;
Echogrid robot(Serial);

void setup()
{
    pinMode(TRIGGER, OUTPUT);
    Serial.begin(115200);
    robot.begin("sonar_example");
}

void loop()
{
    digitalWrite(TRIGGER, HIGH);
    delayMicroseconds(10);
    digitalWrite(TRIGGER, LOW);
    uint32_t now_ms = millis();
    uint32_t echo_us = pulseIn(ECHO, HIGH, 30000);  // sound goes 4 m there and back in 23 ms
    int32_t mm = echo_us * 343 / 2000;              // 343 m/s at 20 degrees Celsius
    robot.range("ping", echo_us == 0 ? Echogrid::NOTHING_SEEN : mm, now_ms);
    delay(50);  // let the last echoes die away
}
