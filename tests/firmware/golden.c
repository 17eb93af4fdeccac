/* Checks defsense_frames.c against the golden frames: golden GOLDEN.txt
 *
 * Each payload is taken apart, packed again and framed, and must give the same bytes. */
#include <stdio.h>
#include <string.h>

#include "defsense_frames.h"

static uint32_t get(const uint8_t **in, int bytes)
{
    uint32_t value = 0;
    for (int i = 0; i < bytes; ++i)
        value |= (uint32_t)*(*in)++ << 8 * i;
    return value;
}

static uint8_t repack(const uint8_t *payload, uint8_t length, uint8_t *out)
{
    const uint8_t *in = payload + 1;
    if (payload[0] == 'S') {
        struct defsense_sample sample;
        sample.counter = get(&in, 4);
        sample.micros = get(&in, 4);
        sample.flags = (uint8_t)get(&in, 1);
        sample.averages = (uint8_t)get(&in, 1);
        sample.channels = (uint8_t)get(&in, 1);
        for (int i = 0; i < sample.channels && i < DEFSENSE_CHANNELS_MAX; ++i)
            sample.sums[i] = get(&in, 3);
        return defsense_pack_sample(&sample, out);
    }
    if (payload[0] == 'I') {
        struct defsense_info info;
        get(&in, 1); /* the protocol's version */
        info.major = (uint8_t)get(&in, 1);
        info.minor = (uint8_t)get(&in, 1);
        info.converter = (uint8_t)get(&in, 1);
        info.channels = (uint8_t)get(&in, 1);
        info.averages = (uint8_t)get(&in, 1);
        info.rate = (uint16_t)get(&in, 2);
        info.led_period = (uint16_t)get(&in, 2);
        info.most_channels = (uint8_t)get(&in, 1);
        info.full_scale = get(&in, 4);
        return defsense_pack_info(&info, out);
    }
    memcpy(out, payload, length);
    return length;
}

static uint8_t from_hex(const char *hex, uint8_t *bytes)
{
    uint8_t count = 0;
    unsigned byte;
    while (sscanf(hex + 2 * count, "%2x", &byte) == 1)
        bytes[count++] = (uint8_t)byte;
    return count;
}

int main(int argc, char **argv)
{
    char line[1024], name[64], payload_hex[256], frame_hex[256];
    int frames = 0, wrong = 0;
    FILE *file = argc == 2 ? fopen(argv[1], "r") : NULL;
    if (!file) {
        fprintf(stderr, "golden: cannot read the golden frames\n");
        return 2;
    }
    if (defsense_crc((const uint8_t *)"123456789", 9) != 0x29B1) {
        fprintf(stderr, "golden: the CRC of 123456789 differs\n");
        ++wrong;
    }
    while (fgets(line, sizeof line, file)) {
        if (line[0] == '#' || sscanf(line, "%63s %255s %255s", name, payload_hex, frame_hex) != 3)
            continue;
        uint8_t payload[128], golden[128], packed[128], frame[128];
        const uint8_t length = from_hex(payload_hex, payload);
        const uint8_t frame_length = from_hex(frame_hex, golden);
        ++frames;
        if (repack(payload, length, packed) != length || memcmp(packed, payload, length)) {
            fprintf(stderr, "golden: the payload of %s differs\n", name);
            ++wrong;
        } else if (defsense_frame(packed, length, frame) != frame_length
                   || memcmp(frame, golden, frame_length)) {
            fprintf(stderr, "golden: the frame of %s differs\n", name);
            ++wrong;
        }
    }
    fclose(file);
    printf("%d golden frames, %d wrong\n", frames, wrong);
    return wrong || !frames;
}
