/* The frames of the DefSense serial protocol, version 1: packing, CRC and COBS. Plain C99.
 *
 * A frame is COBS(payload, CRC) and one byte 0. The CRC is CRC-16/CCITT-FALSE of the payload, low
 * byte first, as are all numbers. */
#ifndef DEFSENSE_FRAMES_H
#define DEFSENSE_FRAMES_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define DEFSENSE_PROTOCOL 1
#define DEFSENSE_CHANNELS_MAX 16
#define DEFSENSE_TEXT_MAX 100
#define DEFSENSE_CRC_SIZE 2
/* The longest payload is a text; a frame adds the CRC, one COBS byte and the closing 0. */
#define DEFSENSE_PAYLOAD_MAX (1 + DEFSENSE_TEXT_MAX)
#define DEFSENSE_FRAME_MAX (DEFSENSE_PAYLOAD_MAX + DEFSENSE_CRC_SIZE + 2)

enum { DEFSENSE_LED_ON = 1, DEFSENSE_LATE = 2 };                /* flags of a sample */
enum { DEFSENSE_INTERNAL_ADC = 0, DEFSENSE_ADS1115 = 1 };      /* converters */

/* The sum of a channel that could not be read; 255 conversions of 32767 stay below it. */
#define DEFSENSE_NOT_READ 0xFFFFFFUL

struct defsense_sample {
    uint32_t counter;
    uint32_t micros;
    uint8_t flags;
    uint8_t averages;
    uint8_t channels;
    uint32_t sums[DEFSENSE_CHANNELS_MAX];
};

struct defsense_info {
    uint8_t major, minor;
    uint8_t converter;
    uint8_t channels;
    uint8_t averages;
    uint16_t rate;       /* Hz */
    uint16_t led_period; /* ms, 0 = not blinking */
    uint8_t most_channels;
    uint32_t full_scale; /* counts of one conversion at the dividers' supply voltage */
};

uint16_t defsense_crc(const uint8_t *data, uint8_t length);

/* Both return the payload's length. */
uint8_t defsense_pack_sample(const struct defsense_sample *sample, uint8_t *payload);
uint8_t defsense_pack_info(const struct defsense_info *info, uint8_t *payload);

/* Writes the frame of a payload of 1..DEFSENSE_PAYLOAD_MAX bytes and returns the frame's length. */
uint8_t defsense_frame(const uint8_t *payload, uint8_t length, uint8_t *frame);

#ifdef __cplusplus
}
#endif

#endif
