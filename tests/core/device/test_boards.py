"""Boards: the table agrees with converters and options, and `[readout]` with the table."""

from __future__ import annotations

import re

import pytest

from defsense_fab.core.device.boards import CONVERTERS, FILE, find_board
from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import DeviceError
from defsense_fab.core.schema.options import options_of
from defsense_fab.core.storage.package_data import read_rows
from defsense_fab.sensing.serial_frames import converter_code
from defsense_fab.workflow.board.options import WiringOptions
from tests.support.errors import raises
from tests.support.places import BAR

BOARDS = [find_board(name) for name in read_rows(FILE)]


def test_converters_and_options_name_the_same_boards():
    options = options_of(WiringOptions)
    assert set(options["board"].choices) == {b.name for b in BOARDS}
    assert set(options["converter"].choices) == set(CONVERTERS)
    assert {b.converter for b in BOARDS} == set(CONVERTERS) - {"ads1115"}


@pytest.mark.parametrize("board", BOARDS, ids=lambda b: b.name)
def test_pins_of_a_board_are_different(board):
    used = [*board.pins, board.ground, board.supply]
    assert len(set(used)) == len(used)
    assert len({board.sda, board.scl, board.ground, board.supply_3v3}) == 4
    assert board.source


def gpio(pin):
    return int(re.search(r"GP(?:IO)?(\d+)", pin)[1])


def test_pins_are_those_of_the_microcontrollers():
    """ADC1 alone works with Wi-Fi on ESP32; GP29 of Pico measures its supply."""
    esp32, pico = find_board("esp32"), find_board("pico")
    assert [gpio(p) for p in esp32.pins] == [36, 39, 34, 35, 32, 33]
    assert (gpio(esp32.sda), gpio(esp32.scl)) == (21, 22)
    assert [gpio(p) for p in pico.pins] == [26, 27, 28]
    assert (gpio(pico.sda), gpio(pico.scl)) == (4, 5)


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        ("", ("nano", "arduino")),
        ('board = "uno"', ("uno", "arduino")),
        ('board = "pico"', ("pico", "pico")),
        ('board = "esp32"', ("esp32", "esp32")),
        ('converter = "ads1115"', ("nano", "ads1115")),
        ('board = "esp32"\nconverter = "ads1115"', ("esp32", "ads1115")),
    ],
)
def test_converter_is_that_of_the_board_unless_given(lines, expected, bar_with):
    device = load_device(bar_with(lines))
    assert (device.board, device.converter) == expected


@pytest.mark.parametrize(
    "lines", ['board = "pico"\nconverter = "arduino"', 'converter = "esp32"',
              'board = "esp32"\nconverter = "pico"'],
)  # fmt: skip
def test_converter_of_another_board_is_refused(lines, bar_with):
    with raises(DeviceError, "converter-not-on-board"):
        load_device(bar_with(lines))


def test_unknown_board_is_refused(bar_with):
    with raises(DeviceError, "value-choice"):
        load_device(bar_with('board = "teensy"'))


def test_all_but_ads1115_are_internal_converters_in_frames():
    assert {name: converter_code(name) for name in CONVERTERS} == {
        "arduino": 0, "pico": 0, "esp32": 0, "ads1115": 1,
    }  # fmt: skip


@pytest.fixture
def bar_with(tmp_path):
    """Return a function that makes a copy of the bar with other lines in `[readout]`."""
    text = (BAR / "device.toml").read_text(encoding="utf-8")
    assert "[readout]" not in text

    def make(lines):
        for file in BAR.iterdir():
            if file.is_file():
                (tmp_path / file.name).write_bytes(file.read_bytes())
        (tmp_path / "device.toml").write_text(f"{text}\n[readout]\n{lines}\n", encoding="utf-8")
        return tmp_path

    return make
