"""Read-out board for MicroPython on ESP32 and Raspberry Pi Pico W.

MicroPython starts this file. It alone knows the hardware; all other modules also run elsewhere.
"""

import gc
import os
import select
import socket
import sys
import time

import config
from ads1115 import Ads1115
from board import Board, Clock
from drivers import Console, WlanRadio
from internal_adc import calibrated, ratiometric
from links import SerialLink
from session import NetworkLink
from sockets import Sockets
from wifi import JsonFile, Wifi

SETTINGS_FILE = "defsense.json"
_BUS_FREQUENCY_HZ = 400000
_BUS_TIMEOUT_US = 2000  # a bus that hangs must not stop the board
_BOARD_ID_SIZE = 6
_MIN_IDLE_US = 3000
_RESTART_DELAY_S = 5


def make_converter(clock):
    """Return the converter that config.py names."""
    from machine import ADC, I2C, Pin

    platform = sys.platform
    if config.CONVERTER == "ads1115":
        number, sda, scl = config.I2C[platform]
        bus = I2C(
            number,
            scl=Pin(scl),
            sda=Pin(sda),
            freq=_BUS_FREQUENCY_HZ,
            timeout=_BUS_TIMEOUT_US,
        )
        return Ads1115(bus, clock, config.SUPPLY_MV)
    pins = [Pin(number) for number in config.INPUTS[platform]]
    if platform == "rp2":
        return ratiometric([ADC(pin) for pin in pins])
    return calibrated([ADC(pin, atten=ADC.ATTN_11DB) for pin in pins], config.SUPPLY_MV)


def make_wifi(clock):
    """Return the link over Wi-Fi and the `Wifi`; None and None on boards without a radio."""
    try:
        import network

        wlan = network.WLAN(network.STA_IF)
    except (ImportError, AttributeError):
        return None, None
    from machine import unique_id

    if config.COUNTRY:
        network.country(config.COUNTRY)
    board_id = unique_id()[-_BOARD_ID_SIZE:]
    link = NetworkLink(clock, board_id, os.urandom)
    wifi = Wifi(
        WlanRadio(wlan),
        JsonFile(SETTINGS_FILE),
        clock,
        link,
        board_id,
        lambda: Sockets(socket, select, link, clock),
    )
    return link, wifi


def run():
    """Read the converters until Ctrl-C."""
    from machine import Pin

    clock = Clock(time)
    link, wifi = make_wifi(clock)
    serial = SerialLink(Console(sys.stdin.buffer, sys.stdout.buffer, select, clock))
    links = [serial] if link is None else [serial, link]
    led = Pin(config.LED[sys.platform], Pin.OUT)
    gc.collect()
    limit = gc.mem_free() // 2

    def collect_garbage():
        if gc.mem_free() < limit:
            gc.collect()

    board = Board(make_converter(clock), clock, links, led.value, wifi, collect_garbage)
    while True:
        if board.loop() > _MIN_IDLE_US:
            time.sleep_ms(1)


def run_again_after_errors():
    """Run, and restart the board after an error; Ctrl-C ends the program."""
    import machine

    try:
        run()
    except Exception as error:
        sys.print_exception(error)
        time.sleep(_RESTART_DELAY_S)  # for Ctrl-C, to repair the program
        machine.reset()


if __name__ == "__main__":
    run_again_after_errors()
