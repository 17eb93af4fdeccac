/* A simulated board: an ATmega328P at 16 MHz on simavr that runs the real firmware.
 *
 *   board [FIRMWARE.elf] --log LOG [--seconds N] [--fast] [--seed N] [--channels-mv FILE]
 *         [--ads N] [--stop-chip SECONDS] [--bootloader ADDRESS:BINARY] [--flash FILE]
 *
 * The first line on stdout is the path of the serial port, a pty. --seconds and --stop-chip count
 * simulated time. In real time (the default) what does not fit into the pty is lost, as in a USB
 * serial chip whose host does not read; with --fast the board waits for the host instead.
 *
 * --ads N puts N ADS1115 on the I2C bus, from 0x48 on; --stop-chip makes the first one stop
 * acknowledging. The inputs swing slowly, each with its own period, between 1 and 4 V on the
 * internal ADC and between 0.66 and 2.64 V on the ADS1115s, unless --channels-mv gives lines of
 * "seconds mV0 mV1 ..." to interpolate between.
 *
 * --bootloader programs a boot loader, which starts at each reset. --flash FILE keeps the flash
 * memory in a file: it is read at the start if it exists, and written at the end, which is a loss
 * of power at any moment. SIGUSR1 presses the reset button, as DTR does on a board; a program that
 * crashes waits for it. Without FIRMWARE.elf, the memory is empty or that of the file.
 *
 * The serial line works at one speed: if the host has set another one than the board, each byte
 * arrives as another byte, at the board with a framing error.
 *
 * LOG gets a line "cycle channel count" for each conversion when it begins: the internal ADC has
 * channels 0 to 7, the ADS1115s 100 to 115. The LED's changes are logged as channel 200. */
#include <fcntl.h>
#include <getopt.h>
#include <math.h>
#include <poll.h>
#include <pty.h>
#include <signal.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#include <simavr/avr_ioport.h>
#include <simavr/avr_uart.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_elf.h>

#include "board.h"

enum {
    TICK = FREQUENCY / 1000,    /* how often the pty and the clock are looked at */
    LED_LOGGED_AS = 200,
    UCSR0A_ADDRESS = 0xC0,
    UBRR0L_ADDRESS = 0xC4,
    UBRR0H_ADDRESS = 0xC5,
    U2X0_MASK = 2,
};

avr_t *avr;
static FILE *logfile;
static bool fast;
static volatile sig_atomic_t stopped, reset_pressed;
static bool was_reset; /* since the main loop last looked */

double seconds(void)
{
    return (double)avr->cycle / FREQUENCY;
}

void fail(const char *what)
{
    fprintf(stderr, "board: %s\n", what);
    exit(1);
}

void log_line(int channel, int count)
{
    fprintf(logfile, "%llu %d %d\n", (unsigned long long)avr->cycle, channel, count);
}

/* ---- the serial line ---- */

static int pty, slave; /* the slave stays open: the pty reports a hang-up while no one has it open */
static avr_uart_t *uart;
static uint8_t to_host[256], from_host[256];
static size_t to_host_count, from_host_count, from_host_next;
static unsigned long lost;

static void open_pty(void)
{
    char path[256];
    struct termios raw;
    if (openpty(&pty, &slave, path, NULL, NULL))
        fail("cannot open a pty");
    tcgetattr(slave, &raw);
    cfmakeraw(&raw);
    tcsetattr(slave, TCSANOW, &raw);
    fcntl(pty, F_SETFL, O_NONBLOCK);
    puts(path);
    fflush(stdout);
}

/* Cycles of a byte, 8N1, at the speed that the program on the board has set. */
static avr_cycle_count_t byte_cycles(void)
{
    const int divisor = avr->data[UBRR0L_ADDRESS] + 256 * (avr->data[UBRR0H_ADDRESS] & 15) + 1;
    return (avr_cycle_count_t)(10 * divisor * (avr->data[UCSR0A_ADDRESS] & U2X0_MASK ? 8 : 16));
}

/* A UART tolerates some 4 % between the speeds of both ends. */
static bool speeds_agree(void)
{
    static const struct {
        speed_t code;
        double baud;
    } speeds[] = {{B9600, 9600}, {B19200, 19200}, {B38400, 38400}, {B57600, 57600},
                  {B115200, 115200}};
    struct termios line;
    if (tcgetattr(slave, &line))
        return false;
    for (size_t i = 0; i < sizeof speeds / sizeof *speeds; ++i)
        if (speeds[i].code == cfgetospeed(&line))
            return fabs(10.0 * FREQUENCY / (double)byte_cycles() / speeds[i].baud - 1) < 0.04;
    return false;
}

static uint8_t garble(uint8_t byte)
{
    return (uint8_t)(byte * 37 + 11);
}

static void on_byte(struct avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq, (void)param;
    uart->cycles_per_byte = byte_cycles(); /* simavr counts a parity bit too */
    if (to_host_count < sizeof to_host)
        to_host[to_host_count++] = speeds_agree() ? (uint8_t)value : garble((uint8_t)value);
}

static void write_host(void)
{
    while (to_host_count && !stopped) {
        const ssize_t written = write(pty, to_host, to_host_count);
        if (written > 0) {
            to_host_count -= (size_t)written;
            memmove(to_host, to_host + written, to_host_count);
        } else if (fast) {
            poll(&(struct pollfd){.fd = pty, .events = POLLOUT}, 1, 100);
        } else {
            lost += to_host_count;
            to_host_count = 0;
        }
    }
}

/* One byte in the time that it takes on the line. */
static avr_cycle_count_t feed(avr_t *a, avr_cycle_count_t when, void *param)
{
    (void)a, (void)param;
    const uint8_t byte = from_host[from_host_next++];
    const uint32_t received = speeds_agree() ? byte : garble(byte) | UART_INPUT_FE;
    avr_raise_irq(uart->io.irq + UART_IRQ_INPUT, received);
    return from_host_next < from_host_count ? when + byte_cycles() : 0;
}

static void read_host(void)
{
    if (from_host_next < from_host_count)
        return;
    const ssize_t count = read(pty, from_host, sizeof from_host);
    from_host_count = count > 0 ? (size_t)count : 0;
    from_host_next = 0;
    if (from_host_count)
        avr_cycle_timer_register(avr, byte_cycles(), feed, NULL);
}

static void discard_from_host(void)
{
    do
        from_host_next = from_host_count = 0;
    while (read(pty, from_host, sizeof from_host) > 0);
}

/* ---- the board ---- */

static double wall(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + now.tv_nsec * 1e-9;
}

static avr_cycle_count_t tick(avr_t *a, avr_cycle_count_t when, void *began)
{
    (void)a;
    write_host();
    read_host();
    const double ahead = seconds() - (wall() - *(double *)began);
    if (!fast && ahead > 0.0005)
        usleep((useconds_t)(ahead * 1e6));
    return when + TICK;
}

static void on_led(struct avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq, (void)param;
    static uint32_t last;
    if (value != last)
        log_line(LED_LOGGED_AS, (int)value);
    last = value;
}

static void on_signal(int number)
{
    if (number == SIGUSR1)
        reset_pressed = 1;
    else
        stopped = 1;
}

/* ---- reset and flash memory ---- */

static void (*reset_chip)(avr_t *);

static void on_reset(avr_t *a)
{
    if (reset_chip)
        reset_chip(a);
    was_reset = true;
}

static void press_reset(void)
{
    reset_pressed = 0;
    avr_reset(avr);
    avr_regbit_set(avr, avr->reset_flags.extrf);
}

/* "ADDRESS:FILE", with the address in hexadecimal. */
static void load_bootloader(const char *text)
{
    char *path;
    const size_t start = strtoul(text, &path, 16);
    FILE *file = *path == ':' ? fopen(path + 1, "rb") : NULL;
    if (!file || start > avr->flashend)
        fail("cannot read the boot loader");
    const size_t size = fread(avr->flash + start, 1, avr->flashend + 1 - start, file);
    if (!size || fgetc(file) != EOF)
        fail("the boot loader does not fit");
    fclose(file);
    avr->reset_pc = (avr_flashaddr_t)start;
    avr->codeend = avr->flashend + 1; /* jumps to what is programmed later are valid, too */
}

static void load_flash(const char *path)
{
    FILE *file = fopen(path, "rb");
    if (!file)
        return;
    if (fread(avr->flash, 1, avr->flashend + 1, file) != avr->flashend + 1)
        fail("the file of --flash has another size");
    fclose(file);
}

static void save_flash(const char *path)
{
    FILE *file = fopen(path, "wb");
    if (!file || fwrite(avr->flash, 1, avr->flashend + 1, file) != avr->flashend + 1)
        fail("cannot write the file of --flash");
    fclose(file);
}

/* stdout belongs to the pty's path. */
static void quiet(avr_t *a, const int level, const char *format, va_list arguments)
{
    (void)a;
    if (level <= LOG_WARNING)
        vfprintf(stderr, format, arguments);
}

static void make_avr(const char *firmware)
{
    elf_firmware_t elf = {0};
    if (firmware && elf_read_firmware(firmware, &elf))
        fail("cannot read the firmware");
    avr = avr_make_mcu_by_name("atmega328p");
    if (!avr || avr_init(avr))
        fail("simavr has no atmega328p");
    reset_chip = avr->reset;
    avr->reset = on_reset;
    if (firmware)
        avr_load_firmware(avr, &elf);
    avr->frequency = FREQUENCY;
    avr->vcc = avr->avcc = avr->aref = 5000;
    avr->log = LOG_WARNING;
    avr->run_cycle_limit = TICK; /* runs from one timer to the next, not single instructions */
    for (avr_io_t *io = avr->io_port; io; io = io->next)
        if (!strcmp(io->kind, "uart"))
            uart = (avr_uart_t *)io;

    uint32_t no_flags = 0; /* no copy to stdout, no sleeping */
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &no_flags);
    avr_irq_t *led = avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('B'), 5);
    avr_irq_register_notify(led, on_led, NULL);
    avr_irq_register_notify(uart->io.irq + UART_IRQ_OUTPUT, on_byte, NULL);
    connect_inputs();
}

int main(int argc, char **argv)
{
    static const struct option options[] = {
        {"log", required_argument, NULL, 'l'},   {"seconds", required_argument, NULL, 's'},
        {"fast", no_argument, NULL, 'f'},        {"channels-mv", required_argument, NULL, 'c'},
        {"seed", required_argument, NULL, 'd'},  {"ads", required_argument, NULL, 'a'},
        {"stop-chip", required_argument, NULL, 'x'},
        {"bootloader", required_argument, NULL, 'b'}, {"flash", required_argument, NULL, 'm'},
        {NULL, 0, NULL, 0},
    };
    const char *log_path = "/dev/null", *bootloader = NULL, *flash = NULL;
    double limit = INFINITY;
    for (int option; (option = getopt_long(argc, argv, "", options, NULL)) != -1;) {
        switch (option) {
        case 'l': log_path = optarg; break;
        case 's': limit = atof(optarg); break;
        case 'f': fast = true; break;
        case 'c': read_points(optarg); break;
        case 'd': seed = (unsigned)atoi(optarg); break;
        case 'a': ads_count = atoi(optarg); break;
        case 'x': ads_stop = atof(optarg); break;
        case 'b': bootloader = optarg; break;
        case 'm': flash = optarg; break;
        default: return 2;
        }
    }
    if (optind < argc - 1 || (optind == argc && !bootloader) || ads_count < 0 || ads_count > 4)
        fail("usage: board [FIRMWARE.elf] --log LOG [options], see the source");
    logfile = fopen(log_path, "w");
    if (!logfile)
        fail("cannot write the log");
    avr_global_logger_set(quiet);
    make_avr(argv[optind]); /* NULL after the last argument */
    if (flash)
        load_flash(flash);
    if (bootloader)
        load_bootloader(bootloader);
    press_reset();
    signal(SIGTERM, on_signal);
    signal(SIGINT, on_signal);
    signal(SIGUSR1, on_signal);
    open_pty();

    double began = wall();
    int state = cpu_Running;
    while (!stopped && seconds() < limit && (bootloader || state < cpu_Done)) {
        if (reset_pressed)
            press_reset();
        if (was_reset) { /* which ends all timers, and loses the bytes on their way */
            was_reset = false;
            discard_from_host();
            avr_cycle_timer_register(avr, TICK, tick, &began);
        }
        state = avr_run(avr);
        if (state >= cpu_Done)
            usleep(1000);
    }
    write_host();
    fprintf(stderr, "board: %.1f s simulated in %.1f s, %lu bytes lost\n", seconds(),
            wall() - began, lost);
    fclose(logfile);
    if (flash)
        save_flash(flash);
    return state == cpu_Crashed;
}
