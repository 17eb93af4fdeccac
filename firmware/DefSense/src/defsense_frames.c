#include "defsense_frames.h"

static uint8_t *put(uint8_t *out, uint32_t value, uint8_t bytes)
{
    while (bytes--) {
        *out++ = (uint8_t)value;
        value >>= 8;
    }
    return out;
}

uint16_t defsense_crc(const uint8_t *data, uint8_t length)
{
    uint16_t crc = 0xFFFF;
    while (length--) {
        crc ^= (uint16_t)(*data++ << 8);
        for (uint8_t bit = 0; bit < 8; ++bit)
            crc = (uint16_t)(crc & 0x8000 ? crc << 1 ^ 0x1021 : crc << 1);
    }
    return crc;
}

uint8_t defsense_pack_sample(const struct defsense_sample *sample, uint8_t *payload)
{
    uint8_t *out = put(payload, 'S', 1);
    out = put(out, sample->counter, 4);
    out = put(out, sample->micros, 4);
    out = put(out, sample->flags, 1);
    out = put(out, sample->averages, 1);
    out = put(out, sample->channels, 1);
    for (uint8_t channel = 0; channel < sample->channels; ++channel)
        out = put(out, sample->sums[channel], 3);
    return (uint8_t)(out - payload);
}

uint8_t defsense_pack_info(const struct defsense_info *info, uint8_t *payload)
{
    uint8_t *out = put(payload, 'I', 1);
    out = put(out, DEFSENSE_PROTOCOL, 1);
    out = put(out, info->major, 1);
    out = put(out, info->minor, 1);
    out = put(out, info->converter, 1);
    out = put(out, info->channels, 1);
    out = put(out, info->averages, 1);
    out = put(out, info->rate, 2);
    out = put(out, info->led_period, 2);
    out = put(out, info->most_channels, 1);
    out = put(out, info->full_scale, 4);
    return (uint8_t)(out - payload);
}

uint8_t defsense_frame(const uint8_t *payload, uint8_t length, uint8_t *frame)
{
    const uint16_t crc = defsense_crc(payload, length);
    uint8_t *out = frame + 1;
    uint8_t *code = frame; /* where the distance to the next zero goes */
    /* A frame is shorter than 254 bytes, so no COBS block reaches its full length. */
    for (uint8_t i = 0; i < length + DEFSENSE_CRC_SIZE; ++i) {
        const uint8_t byte = i < length ? payload[i] : (uint8_t)(crc >> 8 * (i - length));
        if (byte) {
            *out++ = byte;
        } else {
            *code = (uint8_t)(out - code);
            code = out++;
        }
    }
    *code = (uint8_t)(out - code);
    *out++ = 0;
    return (uint8_t)(out - frame);
}
