"""Cords described by a data sheet, instead of or in addition to a row of the catalogue."""

import numpy as np
import pytest

from defsense_fab.core.device.cord_tables import SHEET, CordTable
from defsense_fab.core.device.filaments import BASES, QUANTITIES, read_filaments
from defsense_fab.core.device.sensor_tables import SensorTable
from defsense_fab.core.errors import DeviceError
from defsense_fab.core.response import ResponseSpec
from defsense_fab.core.schema.document import parse_document
from defsense_fab.core.storage.package_data import read_rows
from tests.support.errors import raises

FIGURES = "diameter = 1.2\nohm_per_mm = 9.8\ngauge_factor = 1.4\nmax_strain = 0.8\n"


def read(text, folder):
    return parse_document(text, folder / "device.toml").read(CordTable).record(folder)


def test_a_cord_by_its_data_sheet(tmp_path):
    cord = read(FIGURES, tmp_path)
    assert (cord.name, cord.diameter, cord.ohm_per_mm, cord.max_strain) == ("custom", 1.2, 9.8, 0.8)
    assert cord.response == ResponseSpec.line(1.4)
    assert (cord.min_bend_radius, cord.min_stretch) == (3.0, 12.0)
    assert cord.ferrule_diameter == pytest.approx(1.8)
    assert read('name = "mine"\n' + FIGURES, tmp_path).name == "mine"


def test_assumptions_for_a_data_sheet_are_those_of_the_catalogue(tmp_path):
    for name, row in read_rows("cords.csv").items():
        sheet = "\n".join(f"{key} = {row[key]}" for key in SHEET)
        by_row, by_sheet = read(f'name = "{name}"', tmp_path), read(sheet, tmp_path)
        for key in ("min_bend_radius", "ferrule_diameter", "ferrule_length", "modulus", "noise"):
            assert getattr(by_sheet, key) == pytest.approx(getattr(by_row, key)), (name, key)
        assert (by_sheet.contact, by_sheet.min_stretch) == (by_row.contact, by_row.min_stretch)


def test_a_key_replaces_the_number_of_the_row(tmp_path):
    cord = read('name = "rubber-2mm"\nferrule_diameter = 2.4\nohm_per_mm = 20', tmp_path)
    assert (cord.ferrule_diameter, cord.ohm_per_mm, cord.diameter) == (2.4, 20, 2.0)


@pytest.mark.parametrize(
    ("text", "code", "key"),
    [
        (FIGURES.replace("max_strain = 0.8", ""), "key-missing", "max_strain"),
        (FIGURES + "ferrule_diameter = 1.2", "ferrule-too-thin", "ferrule_diameter"),
        ('name = "mine"', "unknown-cord", "name"),
        ("", "key-missing", "name"),
        (FIGURES + "ohm_per_cm = 98", "key-unknown", "ohm_per_cm"),
        (FIGURES + 'response = "r.json"\ncompression = "half"', "keys-exclusive", "compression"),
        (FIGURES + "length = [100, 100.5]", "out-of-range", "length"),
    ],
)
def test_errors_name_the_key(tmp_path, text, code, key):
    with raises(DeviceError, code, key=key):
        read(text, tmp_path)


PRINTED = 'process = "printed"\ntrace = "eel"\n'
OWN = 'process = "printed"\ntrace = "mine"\nresistivity = 50\ngauge_factor = -3\nmax_strain = 0.2\n'


def test_a_printed_trace_by_its_row(tmp_path):
    cord = read(PRINTED + "width = 1.6\nheight = 1.0\nresistivity = 80", tmp_path)
    assert cord.trace.area == pytest.approx(1.6)
    assert cord.ohm_per_mm == pytest.approx(50.0)
    assert cord.diameter == pytest.approx(np.hypot(1.6, 1.0))
    assert read(PRINTED, tmp_path).modulus == read_filaments()["eel"]["young_modulus"].value
    table = read_filaments()["eel"]["between_layers"].value
    assert read(PRINTED, tmp_path).trace.between_layers == table
    assert read(PRINTED + "between_layers = 7", tmp_path).trace.between_layers == 7.0
    assert read('name = "rubber-2mm"', tmp_path).trace is None


@pytest.mark.parametrize(
    ("text", "code", "key"),
    [
        ('process = "printed"', "key-missing", "trace"),
        ('process = "printed"\ntrace = "eal"', "unknown-filament", "trace"),
        (OWN, "key-missing", "modulus"),
        (PRINTED + "width = 0.3", "trace-too-thin", "width"),
        (PRINTED + "height = 0.1", "trace-too-thin", "height"),
        (PRINTED + "diameter = 2", "key-not-applicable", "diameter"),
        ('name = "rubber-2mm"\nwidth = 1.2', "key-not-applicable", "width"),
        ('name = "rubber-2mm"\nbetween_layers = 2', "key-not-applicable", "between_layers"),
        (PRINTED + "between_layers = 0", "out-of-range", "between_layers"),
        ('process = "sewn"', "value-choice", "process"),
    ],
)
def test_errors_of_traces_name_the_key(tmp_path, text, code, key):
    with raises(DeviceError, code, key=key):
        read(text, tmp_path)


def test_every_number_of_a_filament_has_a_basis_and_a_source():
    for name, row in read_filaments().items():
        assert set(row) == set(QUANTITIES), name
        assert all(q.basis in BASES and q.source for q in row.values()), name


def test_a_drawn_trace_has_points_in_space(tmp_path):
    text = 'name = "a"\ncontrol_points = [[0, 0, 0], [10, 0, 0], [20, 5, 5], [30, 5, 5]]\n'
    read_sensor = lambda t: parse_document(t, tmp_path / "device.toml").read(SensorTable)  # noqa: E731
    sensor = read_sensor(text + 'free = ["path", "ends"]').record()
    assert sensor.curve.points.shape == (4, 3)
    for wrong, code in (
        (text.replace("[10, 0, 0]", "[10, 0]"), "wrong-shape"),
        (text + 'free = ["plane"]', "key-not-applicable"),
    ):
        with raises(DeviceError, code):
            read_sensor(wrong)
