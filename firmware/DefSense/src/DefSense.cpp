#include "DefSense.h"

static const uint8_t versionMajor = 1, versionMinor = 0;

void DefSenseQueue::push(const uint8_t *bytes, uint8_t length) {
    while (length--)
        ring[head++] = *bytes++;
}

void DefSenseQueue::drain() {
    for (int space = Serial.availableForWrite(); space > 0 && tail != head; --space)
        Serial.write(ring[tail++]);
}

void DefSenseQueue::flush() {
    while (tail != head)
        Serial.write(ring[tail++]);
}

size_t DefSenseText::write(uint8_t character) {
    if (length == sizeof payload)
        return 0;
    payload[length++] = character;
    return 1;
}

DefSense::DefSense(const char *name, uint8_t converter, uint32_t fullScale, uint8_t averages,
                   DefSenseReader reader)
    : name(name), reader(reader) {
    settings.major = versionMajor;
    settings.minor = versionMinor;
    settings.converter = converter;
    settings.averages = averages;
    settings.rate = 50;
    settings.full_scale = fullScale;
}

void DefSense::begin(uint8_t mostChannels, uint8_t pin) {
    Serial.begin(115200);
    ledPin = pin;
    pinMode(ledPin, OUTPUT);
    setLed(false, 1000);
    setMostChannels(mostChannels);
}

void DefSense::setMostChannels(uint8_t mostChannels) {
    settings.most_channels = mostChannels;
    settings.channels = mostChannels < 3 ? mostChannels : 3;
    restart();
}

// The next sample begins at once, and the following ones at the present rate.
void DefSense::restart() {
    period = 1000000UL / settings.rate;
    remainder = 1000000UL % settings.rate;
    fraction = 0;
    due = micros();
}

void DefSense::nextSlot() {
    ++counter;
    due += period;
    fraction += remainder;
    if (fraction >= settings.rate) {
        fraction -= settings.rate;
        ++due;
    }
}

void DefSense::loop() {
    service();
    // A command waits until its answer is sure to fit.
    if (lineEnded && queue.room() >= DEFSENSE_FRAME_MAX) {
        execute();
        lineLength = 0;
        lineEnded = lineBad = false;
    }
    const uint32_t now = micros();
    if (settings.channels == 0 || int32_t(now - due) < 0)
        return;
    const bool late = now - due > period;
    while (now - due > period) // slots that were missed
        nextSlot();
    takeSample(late);
    nextSlot();
}

void DefSense::service() {
    const uint32_t sinceToggle = millis() - ledSince;
    if (settings.led_period && sinceToggle >= settings.led_period) {
        ledSince += settings.led_period;
        ledOn = !ledOn;
        digitalWrite(ledPin, ledOn);
    }
    queue.drain();
    while (!lineEnded && Serial.available()) {
        const char character = char(Serial.read());
        if (character == '\n' || character == '\r')
            lineEnded = lineLength || lineBad; // an empty line is the other half of \r\n
        else if (lineLength == sizeof line - 1 || character < ' ' || character > '~')
            lineBad = true;
        else
            line[lineLength++] = character;
    }
}

void DefSense::takeSample(bool late) {
    defsense_sample sample;
    memset(&sample, 0, sizeof sample);
    sample.counter = counter;
    sample.averages = settings.averages;
    sample.channels = settings.channels;
    sample.flags = (ledOn ? DEFSENSE_LED_ON : 0) | (late ? DEFSENSE_LATE : 0);
    const uint32_t began = micros();
    reader(sample.sums, sample.channels, sample.averages);
    sample.micros = began + (micros() - began) / 2;
    if (!framed) {
        sendPlain(sample);
        return;
    }
    uint8_t payload[DEFSENSE_PAYLOAD_MAX];
    const uint8_t length = defsense_pack_sample(&sample, payload);
    // A sample never takes the room of an answer, and is left out where there is no more.
    if (queue.room() >= length + DEFSENSE_CRC_SIZE + 2 + DEFSENSE_FRAME_MAX)
        push(payload, length);
}

// Lines for the Serial Plotter: mean counts with two decimals.
void DefSense::sendPlain(const defsense_sample &sample) {
    for (uint8_t channel = 0; channel < sample.channels; ++channel) {
        if (channel)
            Serial.print(',');
        Serial.print('A');
        Serial.print(channel);
        Serial.print(':');
        if (sample.sums[channel] == DEFSENSE_NOT_READ) {
            Serial.print(F("nan"));
            continue;
        }
        const uint32_t hundredths =
            (sample.sums[channel] * 100 + sample.averages / 2) / sample.averages;
        Serial.print(hundredths / 100);
        Serial.print('.');
        Serial.print(hundredths / 10 % 10);
        Serial.print(hundredths % 10);
    }
    Serial.println();
}

// What follows the word and one space, "" if nothing does, null if the line begins otherwise.
static const char *argument(const char *line, const char *word) {
    const size_t length = strlen(word);
    if (strncmp(line, word, length) != 0)
        return NULL;
    if (line[length] == 0)
        return line + length;
    return line[length] == ' ' ? line + length + 1 : NULL;
}

// Digits only and within the limits, otherwise -1.
static int32_t number(const char *digits, uint16_t low, uint16_t high) {
    uint32_t value = 0;
    const size_t length = strlen(digits);
    if (length == 0 || length > 5)
        return -1;
    for (; *digits; ++digits) {
        if (*digits < '0' || *digits > '9')
            return -1;
        value = value * 10 + uint8_t(*digits - '0');
    }
    return value >= low && value <= high ? int32_t(value) : -1;
}

void DefSense::execute() {
    line[lineLength] = 0;
    if (lineBad) {
        text(F("a command has at most 40 printable characters"));
        return;
    }
    if (strcmp(line, "help") == 0) {
        text(F("frames, plain, rate N, channels N, average N, led N, led on, led off, version, help"));
        return;
    }
    if (strcmp(line, "frames") == 0) {
        const uint8_t end = 0; // of the plain line that a reader may be in
        queue.push(&end, 1);
        framed = true;
    } else if (strcmp(line, "plain") == 0) {
        if (framed) {
            queue.flush();
            Serial.println();
        }
        framed = false;
    } else if (strcmp(line, "led on") == 0) {
        setLed(true, 0);
    } else if (strcmp(line, "led off") == 0) {
        setLed(false, 0);
    } else if (strcmp(line, "version") != 0 && !executeNumber()) {
        return;
    }
    sendInfo();
}

// Carries out a command with a number; otherwise says what is wrong and returns false.
bool DefSense::executeNumber() {
    enum { RATE, CHANNELS, AVERAGE, LED, COUNT };
    const struct {
        const char *word;
        uint16_t low, high;
    } commands[COUNT] = {
        {"rate", 1, 500},
        {"channels", 1, settings.most_channels},
        {"average", 1, 255},
        {"led", 0, 65535},
    };
    for (uint8_t i = 0; i < COUNT; ++i) {
        const char *digits = argument(line, commands[i].word);
        if (!digits)
            continue;
        const int32_t value = number(digits, commands[i].low, commands[i].high);
        if (value < 0) {
            Print &out = beginText();
            out.print(commands[i].word);
            out.print(F(" takes "));
            out.print(commands[i].low);
            out.print(F(" to "));
            out.print(commands[i].high);
            if (i == LED)
                out.print(F(", on or off"));
            endText();
            return false;
        }
        switch (i) {
        case RATE:
            settings.rate = uint16_t(value);
            restart();
            break;
        case CHANNELS:
            settings.channels = uint8_t(value);
            break;
        case AVERAGE:
            settings.averages = uint8_t(value);
            break;
        case LED:
            setLed(value && ledOn, uint16_t(value));
            break;
        }
        return true;
    }
    text(F("unknown command, try help"));
    return false;
}

void DefSense::setLed(bool on, uint16_t blinkPeriod) {
    ledOn = on;
    ledSince = millis();
    settings.led_period = blinkPeriod;
    digitalWrite(ledPin, ledOn);
}

void DefSense::sendInfo() {
    if (framed) {
        uint8_t payload[DEFSENSE_PAYLOAD_MAX];
        push(payload, defsense_pack_info(&settings, payload));
        return;
    }
    Print &out = beginText();
    out.print(F("defsense "));
    out.print(settings.major);
    out.print('.');
    out.print(settings.minor);
    out.print(' ');
    out.print(name);
    out.print(F(", protocol "));
    out.print(DEFSENSE_PROTOCOL);
    out.print(F(", "));
    out.print(settings.channels);
    out.print(F(" of "));
    out.print(settings.most_channels);
    out.print(F(" channels, average "));
    out.print(settings.averages);
    out.print(F(", "));
    out.print(settings.rate);
    out.print(F(" Hz, led "));
    out.print(settings.led_period);
    out.print(F(" ms, full scale "));
    out.print(settings.full_scale);
    endText();
}

void DefSense::text(const __FlashStringHelper *words) {
    beginText().print(words);
    endText();
}

Print &DefSense::beginText() {
    if (!framed) {
        Serial.print(F("# "));
        return Serial;
    }
    message.length = 0;
    message.write('T');
    return message;
}

void DefSense::endText() {
    if (framed)
        push(message.payload, message.length);
    else
        Serial.println();
}

void DefSense::push(const uint8_t *payload, uint8_t length) {
    uint8_t frame[DEFSENSE_FRAME_MAX];
    const uint8_t frameLength = defsense_frame(payload, length, frame);
    if (queue.room() >= frameLength)
        queue.push(frame, frameLength);
}
