"""Unusual materials are questioned; pairs with a process that does not exist are refused."""

from itertools import product

import pytest

from defsense_fab.core.device.device import MaterialSpec
from defsense_fab.core.device.device_file import parse_device
from defsense_fab.core.device.material_table import unusual_properties
from defsense_fab.core.device.materials import (
    default_material,
    is_makeable,
    list_materials,
    list_processes,
)
from defsense_fab.core.errors import DeviceError
from defsense_fab.core.storage.package_data import read_rows
from tests.support.errors import raises
from tests.support.places import BAR, DEVICES, ROOT


def material(young, poisson, density):
    return MaterialSpec("x", young, poisson, "neo-hookean", density, {})


def test_no_material_of_the_catalogue_is_unusual():
    for name, row in read_rows("materials.csv").items():
        values = (float(row[k]) for k in ("young_modulus", "poisson_ratio", "density"))
        assert not unusual_properties(material(*values)), name


@pytest.mark.parametrize(
    ("young", "poisson", "density", "number"),
    [
        (600_000, 0.48, 1.1, "0.6 MPa"),
        (210_000, 0.48, 1.1, "210000 MPa"),
        (1e-4, 0.48, 1.1, "0.0001 MPa"),
        (1.0, 0.1, 1.1, " 0.1 "),
        (1.0, 0.48, 1120, "1.12 g/cm3"),
    ],
)
def test_unusual_values_are_questioned(young, poisson, density, number):
    (question,) = unusual_properties(material(young, poisson, density))
    assert number in question


def test_each_material_has_a_process_and_each_process_a_default_material():
    materials, processes = read_rows("materials.csv"), read_rows("printers.csv")
    for material in materials:
        assert list_processes(material), material
        assert set(list_processes(material)) <= set(processes), material
    for process in processes:
        assert default_material(process) in list_materials(process), process


def test_exactly_silicones_are_cast():
    silicones = set(read_rows("silicones.csv"))
    for name, row in read_rows("printers.csv").items():
        if row["kind"] == "cast":
            assert set(list_materials(name)) == silicones
        else:
            assert silicones.isdisjoint(list_materials(name))


def bar_of(material, process):
    text = (BAR / "device.toml").read_text("utf-8")
    text = text.replace('name = "ninjaflex-85a"', material)
    return parse_device(text.replace('"fdm-tpu"', f'"{process}"'), BAR)


def test_only_pairs_that_exist_are_read():
    for material, process in product(read_rows("materials.csv"), read_rows("printers.csv")):
        name = f'name = "{material}"'
        if is_makeable(material, process):
            assert bar_of(name, process).material.name == material
            continue
        with raises(DeviceError, "material-not-for-process", key="material.name") as caught:
            bar_of(name, process)
        assert caught.value.data["processes"] == list_processes(material)
        assert caught.value.data["materials"] == list_materials(process)


@pytest.mark.parametrize("name", ["", 'name = "own"\n'])
def test_a_custom_material_is_accepted_by_all_processes(name):
    for process in read_rows("printers.csv"):
        device = bar_of(f"{name}young_modulus = 2.0\npoisson_ratio = 0.48", process)
        assert device.material.young_modulus == 2


def test_values_of_a_listed_material_do_not_change_its_processes():
    with raises(DeviceError, "material-not-for-process"):
        bar_of('name = "tango-black-plus"\nyoung_modulus = 0.7', "fdm-tpu")


@pytest.mark.parametrize(
    "path",
    sorted([*DEVICES.glob("*/device.toml"), *ROOT.glob("examples/*/device.toml")]),
    ids=lambda path: f"{path.parents[1].name}-{path.parent.name}",
)
def test_devices_of_the_repository_can_be_made(path):
    device = parse_device(path.read_text("utf-8"), path.parent)
    assert is_makeable(device.material.name, device.fabrication.process)
    assert device.material.name in read_rows("materials.csv")
