"""An HC-SR04 on a Pico or ESP32: 15 readings a second. Copy it and echogrid.py onto the board.

The echo pin of an HC-SR04 gives 5 V, and these boards bear 3.3 V: put 1 kOhm between the echo and
the pin, and 2 kOhm between the pin and ground.
"""

import time

from machine import Pin, time_pulse_us

from echogrid import NOTHING_SEEN, Echogrid

TRIGGER, ECHO = Pin(14, Pin.OUT, value=0), Pin(15, Pin.IN)
robot = Echogrid("pico")

while True:
    TRIGGER.value(1)
    time.sleep_us(10)
    TRIGGER.value(0)
    ms = robot.now_ms()
    echo_us = time_pulse_us(ECHO, 1, 30000)  # negative: none
    mm = echo_us * 343 // 2000  # 343 m/s at 20 degrees Celsius
    robot.range("ping", mm if echo_us > 0 else NOTHING_SEEN, ms)
    time.sleep_ms(50)
