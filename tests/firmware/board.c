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

#include <simavr/avr_adc.h>
#include <simavr/avr_ioport.h>
#include <simavr/avr_twi.h>
#include <simavr/avr_uart.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_elf.h>

enum {
    FREQUENCY = 16000000,
    TICK = FREQUENCY / 1000,    /* how often the pty and the clock are looked at */
    CHANNELS = 16,
    ADS_LOGGED_FROM = 100,
    LED_LOGGED_AS = 200,
    TWBR_ADDRESS = 0xB8,
    UCSR0A_ADDRESS = 0xC0,
    UBRR0L_ADDRESS = 0xC4,
    UBRR0H_ADDRESS = 0xC5,
    U2X0_MASK = 2,
};

static avr_t *avr;
static FILE *logfile;
static bool fast;
static volatile sig_atomic_t stopped, reset_pressed;
static bool was_reset; /* since the main loop last looked */

static double seconds(void)
{
    return (double)avr->cycle / FREQUENCY;
}

static void fail(const char *what)
{
    fprintf(stderr, "board: %s\n", what);
    exit(1);
}

static void log_line(int channel, int count)
{
    fprintf(logfile, "%llu %d %d\n", (unsigned long long)avr->cycle, channel, count);
}

/* ---- voltages ---- */

static unsigned seed;
static struct point {
    double time, mv[CHANNELS];
} *points;
static size_t point_count;

static void read_points(const char *path)
{
    FILE *file = fopen(path, "r");
    char line[1024];
    if (!file)
        fail("cannot read the file of --channels-mv");
    while (fgets(line, sizeof line, file)) {
        struct point point = {0};
        char *next = line, *end;
        point.time = strtod(line, &end);
        if (end == line) /* a comment or an empty line */
            continue;
        for (int channel = 0; channel < CHANNELS && end != next; ++channel)
            point.mv[channel] = strtod(next = end, &end);
        points = realloc(points, (point_count + 1) * sizeof *points);
        points[point_count++] = point;
    }
    fclose(file);
    if (!point_count)
        fail("no line with numbers in the file of --channels-mv");
}

static double millivolts(int channel, double supply_mv)
{
    const double now = seconds();
    if (!point_count) {
        const double period = 2 + 0.37 * channel;
        const double phase = fmod(0.618 * (seed + 1) * (channel + 1), 1);
        return supply_mv * (0.5 + 0.3 * sin(2 * M_PI * (now / period + phase)));
    }
    size_t i = 0;
    while (i + 1 < point_count && points[i + 1].time <= now)
        ++i;
    const struct point *a = &points[i];
    if (i + 1 == point_count || now <= a->time)
        return a->mv[channel];
    const double part = (now - a->time) / (a[1].time - a->time);
    return a->mv[channel] + part * (a[1].mv[channel] - a->mv[channel]);
}

/* ---- the internal ADC ---- */

static void on_conversion(struct avr_irq_t *irq, uint32_t value, void *adc)
{
    (void)irq;
    const union {
        uint32_t value;
        avr_adc_mux_t mux;
    } input = {.value = value};
    if (input.mux.kind != ADC_MUX_SINGLE)
        return;
    const int channel = input.mux.src;
    int count = (int)floor(millivolts(channel, 5000) * 1024 / 5000);
    count = count < 0 ? 0 : count > 1023 ? 1023 : count;
    /* simavr takes whole millivolts and calls the supply 1023: these give just this count. */
    avr_raise_irq((avr_irq_t *)adc + channel, (uint32_t)ceil(count * 5000 / 1023.0));
    log_line(channel, count);
}

/* ---- ADS1115 ---- */

enum { CONVERSION, CONFIG, REGISTERS };

static struct ads {
    uint16_t registers[REGISTERS];
    uint8_t pointer;
    int byte; /* of the transfer */
    bool busy;
    int16_t next;
    avr_cycle_count_t ready;
} ads[4];
static int ads_count;
static double ads_stop = INFINITY;
static struct ads *selected;

static void ads_start(struct ads *chip)
{
    static const double ranges[8] = {6144, 4096, 2048, 1024, 512, 256, 256, 256};
    static const int rates[8] = {8, 16, 32, 64, 128, 250, 475, 860};
    const uint16_t config = chip->registers[CONFIG];
    const int mux = config >> 12 & 7;
    const int channel = (int)(chip - ads) * 4 + (mux & 3);
    if (mux < 4)
        fail("the firmware asks an ADS1115 for a difference");
    const double code = rint(millivolts(channel, 3300) / ranges[config >> 9 & 7] * 32768);
    chip->next = (int16_t)(code > 32767 ? 32767 : code < -32768 ? -32768 : code);
    chip->ready = avr->cycle + FREQUENCY / rates[config >> 5 & 7];
    chip->busy = true;
    log_line(ADS_LOGGED_FROM + channel, chip->next);
}

static void ads_finish(struct ads *chip)
{
    if (chip->busy && avr->cycle >= chip->ready) {
        chip->busy = false;
        chip->registers[CONVERSION] = (uint16_t)chip->next;
        chip->registers[CONFIG] |= 0x8000;
    }
}

static void ads_write(struct ads *chip, uint8_t data)
{
    switch (chip->byte++) {
    case 0:
        chip->pointer = data & 1;
        break;
    case 1:
        chip->registers[CONFIG] = (uint16_t)(data << 8);
        break;
    case 2:
        chip->registers[CONFIG] |= data;
        if (chip->registers[CONFIG] & 0x8000) {
            chip->registers[CONFIG] &= 0x7FFF; /* reads 0 while it converts */
            ads_start(chip);
        }
        break;
    }
}

static uint8_t ads_read(struct ads *chip)
{
    const uint16_t word = chip->registers[chip->pointer];
    return (uint8_t)(chip->byte++ % 2 ? word : word >> 8);
}

static void twi_reply(avr_irq_t *twi, uint8_t message, uint8_t address, uint8_t data)
{
    avr_raise_irq(twi + TWI_IRQ_INPUT, avr_twi_irq_msg(message, address, data));
}

static void on_twi(struct avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq;
    avr_irq_t *twi = param;
    const avr_twi_msg_irq_t message = {.u.v = value};
    const uint8_t kind = message.u.twi.msg, address = message.u.twi.addr;
    int counted = 9 * FREQUENCY / 1000000; /* simavr counts a microsecond a bit */
    if (kind & TWI_COND_STOP) {
        selected = NULL;
        return;
    }
    if (kind & TWI_COND_START) {
        const int chip = (address >> 1) - 0x48;
        const bool there = chip >= 0 && chip < ads_count && !(chip == 0 && seconds() >= ads_stop);
        selected = there ? &ads[chip] : NULL;
        if (selected) {
            ads_finish(selected);
            selected->byte = 0;
            twi_reply(twi, TWI_COND_ACK, address, 1);
        }
        if (!(address & 1))
            counted = 0; /* nor any time for the address of a write */
    } else if (selected && kind & TWI_COND_WRITE) {
        ads_write(selected, message.u.twi.data);
        twi_reply(twi, TWI_COND_ACK, address, 1);
    } else if (selected && kind & TWI_COND_READ) {
        twi_reply(twi, TWI_COND_READ, address, ads_read(selected));
    }
    avr->cycle += 9 * (16 + 2 * avr->data[TWBR_ADDRESS]) - counted;
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
    avr_irq_t *adc = avr_io_getirq(avr, AVR_IOCTL_ADC_GETIRQ, 0);
    avr_irq_t *twi = avr_io_getirq(avr, AVR_IOCTL_TWI_GETIRQ(0), 0);
    avr_irq_t *led = avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('B'), 5);
    avr_irq_register_notify(adc + ADC_IRQ_OUT_TRIGGER, on_conversion, adc);
    avr_irq_register_notify(twi + TWI_IRQ_OUTPUT, on_twi, twi);
    avr_irq_register_notify(led, on_led, NULL);
    avr_irq_register_notify(uart->io.irq + UART_IRQ_OUTPUT, on_byte, NULL);
    for (int i = 0; i < 4; ++i)
        ads[i].registers[CONFIG] = 0x8583;
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
