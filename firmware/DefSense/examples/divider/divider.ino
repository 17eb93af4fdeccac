// Rubber cords in voltage dividers on the board's own analogue inputs.
//
// A reference resistor runs from the supply to each analogue pin, and a cord from that pin to
// ground. The dividers must be fed from the converter's reference, which is the board's own supply
// pin: 5 V on an Uno or Nano. A source of more than some 10 kilohm (cord and resistor in parallel)
// needs a capacitor of 100 nF from the pin to ground.
//
// Commands on the serial line at 115200 baud: "help" lists them. One conversion takes 0.12 ms, so
// 3 channels with 16 conversions each reach about 160 Hz, 8 channels about 60 Hz.
#include <DefSense.h>

// Edit to suit your board: pins in the order of the channels, the LED, and the counts of
// analogRead() at the supply voltage (4096 on boards that read 12 bits).
const uint8_t pins[] = {
    A0, A1, A2, A3, A4, A5,
#if NUM_ANALOG_INPUTS >= 8
    A6, A7,
#endif
};
const uint8_t ledPin = LED_BUILTIN;
const uint32_t fullScale = 1024;
const uint8_t averages = 16;

void readChannels(uint32_t *sums, uint8_t channels, uint8_t averages);

DefSense sense("divider", DEFSENSE_INTERNAL_ADC, fullScale, averages, readChannels);

void readChannels(uint32_t *sums, uint8_t channels, uint8_t averages) {
    for (uint8_t channel = 0; channel < channels; ++channel) {
        for (uint8_t i = 0; i < averages; ++i) {
            sums[channel] += analogRead(pins[channel]);
            sense.service();
        }
    }
}

void setup() {
    sense.begin(sizeof pins, ledPin);
}

void loop() {
    sense.loop();
}
