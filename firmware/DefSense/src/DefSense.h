// What the DefSense sketches share: settings, commands, timing, plain and framed output.
#ifndef DEFSENSE_H
#define DEFSENSE_H

#include <Arduino.h>

#include "defsense_frames.h"

// Adds `averages` conversions of each of the first `channels` channels to sums, which are 0 at
// first, or puts DEFSENSE_NOT_READ there. It calls DefSense::service() between conversions.
typedef void (*DefSenseReader)(uint32_t *sums, uint8_t channels, uint8_t averages);

// Bytes on their way out. It holds a few whole frames, more than the core's own buffer, so that
// sampling never waits for the serial line.
class DefSenseQueue {
  public:
    uint8_t room() const { return uint8_t(tail - head - 1); }
    void push(const uint8_t *bytes, uint8_t length);
    void drain(); // as much as the core takes without waiting
    void flush(); // all of it, waiting

  private:
    uint8_t ring[256]; // indices wrap by themselves
    uint8_t head = 0;
    uint8_t tail = 0;
};

// Collects the payload of a text frame; what is too long is cut.
class DefSenseText : public Print {
  public:
    uint8_t payload[DEFSENSE_PAYLOAD_MAX];
    uint8_t length = 0;
    size_t write(uint8_t character) override;
};

class DefSense {
  public:
    DefSense(const char *name, uint8_t converter, uint32_t fullScale, uint8_t averages,
             DefSenseReader reader);
    void begin(uint8_t mostChannels, uint8_t ledPin);
    void setMostChannels(uint8_t mostChannels);
    void loop();    // takes a sample when one is due
    void service(); // LED, output and incoming characters; carries out no command
    void text(const __FlashStringHelper *message);

  private:
    void restart();
    void nextSlot();
    void takeSample(bool late);
    void sendPlain(const defsense_sample &sample);
    void execute();
    bool executeNumber();
    void setLed(bool on, uint16_t period);
    void sendInfo();
    Print &beginText();
    void endText();
    void push(const uint8_t *payload, uint8_t length);

    const char *name;
    DefSenseReader reader;
    defsense_info settings;
    bool framed = false;

    uint32_t counter = 0;
    uint32_t due = 0;       // micros() at which the sample is to begin
    uint32_t period = 0;    // whole microseconds between samples, and what is left over,
    uint16_t remainder = 0; // in 1/rate microseconds
    uint16_t fraction = 0;

    uint8_t ledPin = 0;
    bool ledOn = false;
    uint32_t ledSince = 0;

    char line[41];
    uint8_t lineLength = 0;
    bool lineEnded = false;
    bool lineBad = false;

    DefSenseQueue queue;
    DefSenseText message;
};

#endif
