/* An Arduino on simavr: its serial line on a pseudo-terminal, its other pins in a world that is asked.
 *
 *     board FIRMWARE.elf WIRES SPEED      WIRES of the sonar: 1 or 2; SPEED 1 is real time
 *
 * Every question is a line on stdout, every answer a line on stdin; T is the chip's time in
 * microseconds, PULSE the length of the servo's latest pulse in microseconds (0: none yet).
 *
 *     pty PATH             (no answer) where the serial line is
 *     ping T PULSE         DELAY WIDTH: the echo's pulse, in microseconds; WIDTH 0: none at all
 *     analogue T PULSE     millivolts on A0
 *     tick T PULSE         LEFT RIGHT COMMAND, each 2 ms: quarter steps of the wheels' encoders
 *                          since the start; 0: go on, 1: reset button, 2: end, 3: brown-out
 *     end BUSY LONGEST     (no answer) share of the time awake; longest time awake at a stretch, us
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include <simavr/avr_adc.h>
#include <simavr/avr_extint.h>
#include <simavr/avr_ioport.h>
#include <simavr/parts/uart_pty.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_elf.h>

enum { CYCLES_PER_US = 16, STEP_US = 100, TICK_US = 2000, ECHO = 0, SERVO = 1, TRIGGER = 7 };
enum { MCUSR = 0x54, POWER_ON = 1, RESET_PIN = 2, BROWN_OUT = 4 };

DEFINE_FIFO(uint8_t, uart_pty_fifo);

static FILE *world;
static avr_t *avr;
static avr_cycle_count_t servo_rise, woken, awake, longest;
static uint64_t servo_us;
static uint32_t trigger_was, servo_was, echo_pulse_us;
static int wires, driving_echo;
static long wheel[2], wheel_target[2], command;
static uint8_t encoder_levels;

static uint64_t now_us(void)
{
    return avr->cycle / CYCLES_PER_US;
}

/* Asks the world; up to three numbers come back. */
static void ask(const char *what, long answer[3])
{
    char line[128];
    fprintf(world, "%s %" PRIu64 " %" PRIu64 "\n", what, now_us(), servo_us);
    fflush(world);
    answer[0] = answer[1] = answer[2] = 0;
    if (!fgets(line, sizeof line, stdin) || sscanf(line, "%ld %ld %ld", answer, answer + 1, answer + 2) < 1) {
        fprintf(stderr, "board: no answer to %s\n", what);
        exit(1);
    }
}

static avr_irq_t *pin(char port, int number)
{
    return avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ(port), number);
}

/* What is connected to a port's inputs, so that the chip's pull-ups do not win over it. */
static void connect(char port, uint8_t mask, uint8_t levels)
{
    avr_ioport_external_t external = {.name = (unsigned char)port, .mask = mask, .value = levels};
    avr_ioctl(avr, AVR_IOCTL_IOPORT_SET_EXTERNAL(port), &external);
    for (int i = 0; i < 8; i++)
        if (mask >> i & 1)
            avr_raise_irq(pin(port, i), levels >> i & 1);
}

static avr_cycle_count_t echo_falls(avr_t *a, avr_cycle_count_t when, void *unused)
{
    (void)a, (void)when, (void)unused;
    connect('B', 1 << ECHO, 0);
    driving_echo = 0;
    return 0;
}

static avr_cycle_count_t echo_rises(avr_t *a, avr_cycle_count_t when, void *unused)
{
    (void)when, (void)unused;
    connect('B', 1 << ECHO, 1 << ECHO);
    avr_cycle_timer_register(a, echo_pulse_us * CYCLES_PER_US, echo_falls, NULL);
    return 0;
}

static void trigger_changed(avr_irq_t *irq, uint32_t value, void *unused)
{
    (void)irq, (void)unused;
    int fell = trigger_was && !value;
    trigger_was = value;
    if (!fell || driving_echo)
        return;
    long answer[3];
    ask("ping", answer);
    if (answer[1] > 0) {
        driving_echo = 1;
        echo_pulse_us = (uint32_t)answer[1];
        avr_cycle_timer_register(avr, (uint32_t)answer[0] * CYCLES_PER_US, echo_rises, NULL);
    }
}

static void servo_changed(avr_irq_t *irq, uint32_t value, void *unused)
{
    (void)irq, (void)unused;
    if (value && !servo_was)
        servo_rise = avr->cycle;
    else if (!value && servo_was)
        servo_us = (avr->cycle - servo_rise) / CYCLES_PER_US;
    servo_was = value;
}

static void conversion_begins(avr_irq_t *irq, uint32_t value, void *unused)
{
    (void)irq, (void)value, (void)unused;
    long answer[3];
    ask("analogue", answer);
    avr_raise_irq(avr_io_getirq(avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_ADC0), (uint32_t)answer[0]);
}

static void turn_wheels(void)
{
    static const uint8_t levels[4] = {0, 1, 3, 2}; /* A is bit 0, B bit 1 */
    uint8_t both = 0;
    for (int i = 0; i < 2; i++) {
        wheel[i] += (wheel_target[i] > wheel[i]) - (wheel_target[i] < wheel[i]);
        uint8_t at = levels[wheel[i] & 3];
        both |= (uint8_t)((at & 1) << (2 + i) | (at >> 1) << (4 + i)); /* A: pins 2, 3; B: 4, 5 */
    }
    if (both != encoder_levels)
        connect('D', 0x3C, both);
    encoder_levels = both;
}

static avr_cycle_count_t world_turns(avr_t *a, avr_cycle_count_t when, void *unused)
{
    (void)a, (void)unused;
    static unsigned steps;
    if (steps++ % (TICK_US / STEP_US) == 0) {
        long answer[3];
        ask("tick", answer);
        wheel_target[0] = answer[0], wheel_target[1] = answer[1], command = answer[2];
    }
    turn_wheels();
    return when + STEP_US * CYCLES_PER_US;
}

/* The chip sleeps until something happens: jump there. */
static void sleep_until(avr_t *a, avr_cycle_count_t cycles)
{
    avr_cycle_count_t stretch = a->cycle - woken;
    awake += stretch;
    if (stretch > longest)
        longest = stretch;
    woken = a->cycle + 1 + cycles;
}

static void boot(uint8_t reset_cause)
{
    avr_reset(avr);
    avr->data[MCUSR] = reset_cause;
    for (uint8_t i = 0; i < 2; i++) /* else simavr looks at pins 2 and 3 after every instruction */
        avr_extint_set_strict_lvl_trig(avr, i, 0);
    avr_cycle_timer_cancel(avr, echo_rises, NULL);
    avr_cycle_timer_cancel(avr, echo_falls, NULL);
    avr_cycle_timer_cancel(avr, world_turns, NULL);
    driving_echo = 0;
    trigger_was = servo_was = 0;
    connect('B', 1 << ECHO, 0);
    connect('D', 0x3C, encoder_levels);
    avr_cycle_timer_register(avr, STEP_US * CYCLES_PER_US, world_turns, NULL);
}

/* The pseudo-terminal's thread may lag behind a fast chip. Wait, unless nobody reads at all. */
static void wait_for_reader(uart_pty_t *serial_line)
{
    static int nobody;
    for (int ms = 0; uart_pty_fifo_get_read_size(&serial_line->pty.in) > 256; ms++) {
        if (nobody)
            return;
        nobody = ms >= 1000;
        usleep(1000);
    }
    nobody = 0;
}

/* Keep to the wall clock: wait when ahead; when behind, hurry. */
static void keep_pace(double speed)
{
    static struct timespec start;
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    if (start.tv_sec == 0)
        start = now;
    double due_us = (double)now_us() / speed;
    double is_us = (double)(now.tv_sec - start.tv_sec) * 1e6 + (double)(now.tv_nsec - start.tv_nsec) / 1e3;
    if (due_us - is_us > 500.0) {
        struct timespec wait = {0, (long)((due_us - is_us) * 1e3)};
        nanosleep(&wait, NULL);
    }
}

int main(int argc, char **argv)
{
    elf_firmware_t firmware = {0};
    world = fdopen(dup(STDOUT_FILENO), "w");
    if (!world || !freopen("/dev/null", "w", stdout)) /* simavr prints there */
        return 1;
    if (argc != 4 || elf_read_firmware(argv[1], &firmware) != 0 || !(avr = avr_make_mcu_by_name("atmega328p"))) {
        fprintf(stderr, "usage: board FIRMWARE.elf WIRES SPEED\n");
        return 2;
    }
    wires = atoi(argv[2]);
    avr_init(avr);
    avr_load_firmware(avr, &firmware);
    avr->frequency = CYCLES_PER_US * 1000000;
    avr->vcc = avr->avcc = avr->aref = 5000;
    avr->sleep = sleep_until;

    static uart_pty_t serial_line;
    uart_pty_init(avr, &serial_line);
    uart_pty_connect(&serial_line, '0');
    unlink("/tmp/simavr-uart0"); /* a link that it leaves behind */
    fprintf(world, "pty %s\n", serial_line.pty.slavename);
    fflush(world);
    avr_irq_register_notify(wires == 1 ? pin('B', ECHO) : pin('D', TRIGGER), trigger_changed, NULL);
    avr_irq_register_notify(pin('B', SERVO), servo_changed, NULL);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_OUT_TRIGGER), conversion_begins, NULL);

    boot(POWER_ON);
    for (avr_cycle_count_t next = 2 * STEP_US * CYCLES_PER_US; command != 2;) {
        int state = avr_run(avr);
        if (state == cpu_Done || state == cpu_Crashed) {
            fprintf(stderr, "board: the firmware crashed at %" PRIu64 " us\n", now_us());
            return 1;
        }
        if (command == 1 || command == 3)
            boot(command == 1 ? RESET_PIN : BROWN_OUT), command = 0;
        if (avr->cycle >= next)
            next = avr->cycle + 500 * CYCLES_PER_US, keep_pace(atof(argv[3])), wait_for_reader(&serial_line);
    }
    fprintf(world, "end %.4f %" PRIu64 "\n", (double)awake / (double)avr->cycle, longest / CYCLES_PER_US);
    fflush(world);
    while (getc(stdin) != EOF) /* what is still on the line can be read until stdin ends */
        ;
    uart_pty_stop(&serial_line);
    return 0;
}
