// Rubber cords in voltage dividers on one to four ADS1115 converters (16 bits, I2C).
//
// A reference resistor runs from 3.3 V to each input, and a cord from that input to ground. The gain
// is 1 (+-4.096 V): inputs must not rise above 3.3 V.
//
// Chips are looked for at the addresses 0x48 to 0x4B, and their inputs A0 to A3 are channels 0 to
// 15 in the order of the addresses. A chip that stops answering later has its channels reported as
// not read.
//
// A conversion takes 1.2 ms (860 a second) and the bus its time too: with one conversion a sample,
// 3 channels reach about 175 Hz, 4 channels 135 Hz, and the 16 inputs of four chips, which convert at
// the same time, 80 Hz. n conversions a sample divide these rates by n.
#include <DefSense.h>
#include <Wire.h>

const uint8_t ledPin = LED_BUILTIN;
const uint32_t fullScale = 26400; // counts at the dividers' supply: 3.3 V / 4.096 V * 32768
const uint8_t averages = 1;

const uint8_t firstAddress = 0x48;
const uint8_t inputs = 4;
const uint8_t conversionRegister = 0, configRegister = 1;
// Start one conversion: single ended, +-4.096 V, single shot, 860 a second, no comparator.
const uint16_t startConversion = 0xC3E3;
const uint16_t ready = 0x8000;
const uint16_t shortestMicros = 1000, longestMicros = 3000; // of a conversion

uint8_t chips[4]; // addresses of those that answered
uint8_t found = 0;

void readChannels(uint32_t *sums, uint8_t channels, uint8_t averages);

DefSense sense("ads1115", DEFSENSE_ADS1115, fullScale, averages, readChannels);

bool start(uint8_t address, uint8_t input) {
    const uint16_t config = startConversion | uint16_t(input) << 12;
    Wire.beginTransmission(address);
    Wire.write(configRegister);
    Wire.write(uint8_t(config >> 8));
    Wire.write(uint8_t(config));
    return Wire.endTransmission() == 0;
}

bool readWord(uint8_t address, uint16_t &word) {
    if (Wire.requestFrom(address, uint8_t(2)) != 2)
        return false;
    word = uint16_t(Wire.read()) << 8;
    word |= uint8_t(Wire.read());
    return true;
}

// Waits for the conversion that began at `began` and adds its result.
bool collect(uint8_t address, uint32_t began, uint32_t &sum) {
    while (micros() - began < shortestMicros)
        sense.service();
    uint16_t word;
    for (;;) { // start() left the chip at its config register
        const bool overdue = micros() - began > longestMicros;
        if (!readWord(address, word))
            return false;
        if (word & ready)
            break;
        if (overdue)
            return false;
        sense.service();
    }
    Wire.beginTransmission(address);
    Wire.write(conversionRegister);
    if (Wire.endTransmission() != 0 || !readWord(address, word))
        return false;
    const int16_t code = int16_t(word);
    sum += code > 0 ? code : 0; // noise at 0 V may be below it
    return true;
}

// Starts the same input on all chips and then collects, so that they convert at the same time.
void readChannels(uint32_t *sums, uint8_t channels, uint8_t averages) {
    bool silent[sizeof chips] = {};
    for (uint8_t input = 0; input < inputs; ++input) {
        for (uint8_t i = 0; i < averages; ++i) {
            uint32_t began[sizeof chips];
            for (uint8_t chip = 0; chip * inputs + input < channels; ++chip) {
                began[chip] = micros();
                if (!silent[chip])
                    silent[chip] = !start(chips[chip], input);
            }
            for (uint8_t chip = 0; chip * inputs + input < channels; ++chip) {
                uint32_t &sum = sums[chip * inputs + input];
                if (!silent[chip])
                    silent[chip] = !collect(chips[chip], began[chip], sum);
                if (silent[chip])
                    sum = DEFSENSE_NOT_READ;
            }
        }
    }
}

void findChips() {
    found = 0;
    for (uint8_t i = 0; i < sizeof chips; ++i) {
        Wire.beginTransmission(uint8_t(firstAddress + i));
        if (Wire.endTransmission() == 0)
            chips[found++] = firstAddress + i;
    }
}

void setup() {
    Wire.begin();
    Wire.setClock(400000);
#ifdef WIRE_HAS_TIMEOUT
    Wire.setWireTimeout(2000, true); // a bus that hangs must not stop the sketch
#endif
    findChips();
    sense.begin(found * inputs, ledPin);
}

void loop() {
    static uint32_t lastLook = 0;
    if (found == 0 && millis() - lastLook >= 1000) {
        lastLook = millis();
        findChips();
        if (found)
            sense.setMostChannels(found * inputs);
        else
            sense.text(F("no ADS1115 answers at 0x48 to 0x4B, check the wiring"));
    }
    sense.loop();
}
