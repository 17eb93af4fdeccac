"""Cords by their data sheets, in place of a row of the catalogue or over one."""

import tomllib

import pytest

from defsense_fab.core.device.cord_table import SHEET, read_cord
from defsense_fab.core.errors import DeviceError
from defsense_fab.core.response import ResponseSpec
from defsense_fab.core.storage.package_data import read_rows
from defsense_fab.core.storage.toml_table import Table

FIGURES = "diameter = 1.2\nohm_per_mm = 9.8\ngauge_factor = 1.4\nmax_strain = 0.8\n"


def read(text, folder):
    return read_cord(Table(tomllib.loads(text), folder / "device.toml", text), 0.0, folder)


def test_a_cord_by_its_data_sheet(tmp_path):
    cord = read(FIGURES, tmp_path)
    assert (cord.name, cord.diameter, cord.ohm_per_mm, cord.max_strain) == ("custom", 1.2, 9.8, 0.8)
    assert cord.response == ResponseSpec.line(1.4)
    assert (cord.min_bend_radius, cord.min_stretch) == (3.0, 12.0)
    assert cord.ferrule_diameter == pytest.approx(1.8)
    assert read('name = "mine"\n' + FIGURES, tmp_path).name == "mine"


def test_what_is_assumed_of_a_cord_is_what_the_catalogue_assumes(tmp_path):
    for name, row in read_rows("cords.csv").items():
        sheet = "\n".join(f"{key} = {row[key]}" for key in SHEET)
        by_row, by_sheet = read(f'name = "{name}"', tmp_path), read(sheet, tmp_path)
        for key in ("min_bend_radius", "ferrule_diameter", "ferrule_length", "modulus", "noise"):
            assert getattr(by_sheet, key) == pytest.approx(getattr(by_row, key)), (name, key)
        assert (by_sheet.contact, by_sheet.min_stretch) == (by_row.contact, by_row.min_stretch)


def test_a_figure_replaces_that_of_the_row(tmp_path):
    cord = read('name = "rubber-2mm"\nferrule_diameter = 2.4\nohm_per_mm = 20', tmp_path)
    assert (cord.ferrule_diameter, cord.ohm_per_mm, cord.diameter) == (2.4, 20, 2.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (FIGURES.replace("max_strain = 0.8", ""), "max_strain: is missing; add it"),
        (FIGURES + "ferrule_diameter = 1.2", r"ferrule_diameter: must be more than the cord's 1.2"),
        ('name = "mine"', "unknown cord 'mine'"),
        (FIGURES + "ohm_per_cm = 98", "ohm_per_cm: unknown key; did you mean 'ohm_per_mm'"),
    ],
)
def test_what_cannot_be_is_told(tmp_path, text, message):
    with pytest.raises(DeviceError, match=message):
        read(text, tmp_path)
