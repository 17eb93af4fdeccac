"""Plans of wirings: each cord is one voltage divider on one pin, and modules share a bus."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import pytest

from defsense_fab.core.device.boards import ADS1115_STRAPS, find_board
from defsense_fab.core.errors import DeviceError
from defsense_fab.report.guide.tables import wiring_tables
from defsense_fab.report.wiring.connections import PartKind, color_code, plan_wiring
from tests.report.wiring.plans import CASES, RESISTORS, manifest_of, nets, plan
from tests.support.errors import raises

COLORS = ("black", "brown", "red", "orange", "yellow", "green", "blue", "violet", "gray", "white")
FACTORS = {"gold": 0.1, "silver": 0.01} | {c: 10**n for n, c in enumerate(COLORS)}


@pytest.mark.parametrize(("board", "converter", "cords"), CASES)
def test_every_cord_is_a_voltage_divider_on_its_own_pin(board, converter, cords):
    wiring = plan(cords, board, converter)
    by_terminal = {terminal: net for net in nets(wiring) for terminal in net}
    pins = []
    for number in range(1, cords + 1):
        ground, supply = (
            by_terminal["cord", number, "start"],
            by_terminal["resistor", number, "supply"],
        )
        assert ("board", 1, wiring.board.ground) in ground
        assert ("board", 1, wiring.supply_pin) in supply
        junction = set(by_terminal["cord", number, "end"])
        junction -= {("cord", number, "end"), ("resistor", number, "junction")}
        assert len(junction) == 1
        pins += junction
    assert len(set(pins)) == cords
    if converter == "ads1115":
        assert pins == [("ADS1115", 1 + n // 4, f"A{n % 4}") for n in range(cords)]
    else:
        assert pins == [("board", 1, pin) for pin in wiring.board.pins[:cords]]


@pytest.mark.parametrize("board", ["nano", "esp32", "pico"])
def test_modules_share_the_bus_and_have_different_addresses(board):
    wiring = plan(16, board, "ads1115")
    by_terminal = {terminal: net for net in nets(wiring) for terminal in net}
    pins = {"VDD": wiring.board.converter_supply, "GND": wiring.board.ground,
            "SDA": wiring.board.sda, "SCL": wiring.board.scl}  # fmt: skip
    addresses = []
    for module in range(1, 5):
        for pin, board_pin in pins.items():
            assert ("board", 1, board_pin) in by_terminal["ADS1115", module, pin]
        strap = by_terminal["ADS1115", module, "ADDR"]
        addresses += [a for pin, a in ADS1115_STRAPS if ("ADS1115", module, pin) in strap]
    assert addresses == [0x48, 0x49, 0x4A, 0x4B]


def test_no_connection_is_listed_twice():
    counts = Counter(frozenset(c[:2]) for c in plan(16, "esp32", "ads1115").connections)
    assert set(counts.values()) == {1}


@pytest.mark.parametrize(
    ("cords", "board", "converter"),
    [(9, "nano", "arduino"), (7, "uno", "arduino"), (7, "esp32", "esp32"), (4, "pico", "pico"),
     (17, "nano", "ads1115"), (17, "pico", "ads1115")],
)  # fmt: skip
def test_too_many_cords_are_refused(cords, board, converter):
    with raises(DeviceError, "too-many-cords") as caught:
        plan(cords, board, converter)
    assert caught.value.data == {"cords": cords, "channels": cords - 1}


def test_other_boards_use_their_own_converter_if_they_lack_that_of_the_device():
    device, manifest = manifest_of(2)
    assert device.converter == "arduino"
    assert plan_wiring(device, manifest).board.name == "nano"
    assert plan_wiring(device, manifest, "pico").converter == "pico"
    with raises(DeviceError, "converter-not-on-board"):
        plan_wiring(device, manifest, "pico", "esp32")


def test_device_without_cords_has_no_wiring():
    with raises(DeviceError, "no-cords"):
        plan(0)


@pytest.mark.parametrize("ohm", [1.0, 2.2, 47, 470, 1000, 2200, 15000, 910e3, 9.1e6])
def test_color_code_states_the_resistance(ohm):
    *digits, factor, tolerance = color_code(ohm)
    number = int("".join(str(COLORS.index(d)) for d in digits))
    assert number * FACTORS[factor] == pytest.approx(ohm)
    assert tolerance == "brown"  # 1 %, IEC 60062


def test_tables_have_every_cord_once_with_its_resistor_and_pin():
    wires, others = wiring_tables(plan(5, "esp32", "ads1115"))
    assert len(wires.rows) == 5
    for row, resistor in zip(wires.rows, (*RESISTORS, RESISTORS[0]), strict=True):
        assert row[3].startswith(f"{resistor:g} ohm")
    assert [row[4] for row in wires.rows] == [
        *(f"ADS1115 1, A{n}" for n in range(4)), "ADS1115 2, A0",
    ]  # fmt: skip
    assert len(others.rows) == 2 + 2 * 5  # rails, and five pins of each module


def test_only_large_resistances_need_a_capacitor():
    device, manifest = manifest_of(2)
    plain = plan_wiring(device, manifest, "nano", "arduino")
    large = replace(manifest.cords[0], range=(30e3, 60e3), reference_resistor=43e3)
    other = plan_wiring(device, replace(manifest, cords=(large, manifest.cords[1])))
    assert len(other.notes) == len(plain.notes) + 1
    assert "left" in other.notes[-1]
    assert "right" not in other.notes[-1]


def test_kinds_of_parts_are_all_connected():
    kinds = {t.kind for c in plan(3, "esp32", "ads1115").connections for t in c[:2]}
    assert kinds == set(PartKind)
    assert find_board("esp32").channel_count("ads1115") == 16
