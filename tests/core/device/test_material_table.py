"""Materials that no soft body has are questioned."""

import pytest

from defsense_fab.core.device.device import MaterialSpec
from defsense_fab.core.device.material_table import unusual_properties
from defsense_fab.core.storage.package_data import read_rows


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
