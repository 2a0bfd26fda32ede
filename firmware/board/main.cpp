// What the Arduino IDE adds to a sketch, for a build without it.
void setup();
void loop();

int main()
{
    setup();
    for (;;)
        loop();
}
