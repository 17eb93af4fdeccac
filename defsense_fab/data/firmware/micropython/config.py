"""What you may have to change to suit your board and your wiring."""

#: "ads1115", or "internal" for the microcontroller's own converters.
CONVERTER = "ads1115"

#: Supply voltage of the dividers, mV. Dividers on internal converters of a Pico need none.
SUPPLY_MV = 3300

#: I2C bus of the ADS1115: its number, and the GPIO numbers of SDA and SCL.
I2C = {"esp32": (0, 21, 22), "rp2": (0, 4, 5)}

#: GPIO numbers of the internal converters' inputs, in the order of the channels.
INPUTS = {"esp32": (36, 39, 34, 35, 32, 33), "rp2": (26, 27, 28)}

#: GPIO of the LED that blinks.
LED = {"esp32": 2, "rp2": "LED"}

#: Country whose radio channels are used, such as "DE"; "" for those allowed everywhere.
COUNTRY = ""
