// A Sharp GP2Y0A21 (10 to 80 cm) on A0: 25 readings a second for `echogrid record`.
#include <Echogrid.h>

Echogrid robot(Serial);

void setup()
{
    Serial.begin(115200);
    robot.begin("infrared_example");
}

void loop()
{
    float volts = analogRead(A0) * 5.0 / 1023.0;
    long mm = 270.0 * pow(volts, -1.2);  // within 3 % of the typical curve of the data sheet
    if (volts < 0.43)
        mm = Echogrid::NOTHING_SEEN;
    else if (volts > 2.4)
        mm = Echogrid::TOO_CLOSE;
    robot.range("dirrs", mm);
    delay(40);  // the sensor measures every 38 ms
}
