/* What the simulated board measures: voltages, the internal ADC, and ADS1115s on the I2C bus. */
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>

#include <simavr/avr_adc.h>
#include <simavr/avr_twi.h>

#include "board.h"

enum {
    CHANNELS = 16,
    ADS_LOGGED_FROM = 100,
    TWBR_ADDRESS = 0xB8,
};

/* ---- voltages ---- */

unsigned seed;
static struct point {
    double time, mv[CHANNELS];
} *points;
static size_t point_count;

void read_points(const char *path)
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
int ads_count;
double ads_stop = INFINITY;
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

void connect_inputs(void)
{
    avr_irq_t *adc = avr_io_getirq(avr, AVR_IOCTL_ADC_GETIRQ, 0);
    avr_irq_t *twi = avr_io_getirq(avr, AVR_IOCTL_TWI_GETIRQ(0), 0);
    avr_irq_register_notify(adc + ADC_IRQ_OUT_TRIGGER, on_conversion, adc);
    avr_irq_register_notify(twi + TWI_IRQ_OUTPUT, on_twi, twi);
    for (int i = 0; i < 4; ++i)
        ads[i].registers[CONFIG] = 0x8583;
}
