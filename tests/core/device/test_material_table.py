"""Materials that no soft body has are asked about."""

import pytest

from defsense_fab.core.device.device import MaterialSpec
from defsense_fab.core.device.material_table import strange
from defsense_fab.core.storage.package_data import read_rows


def material(young, poisson, density):
    return MaterialSpec("x", young, poisson, "neo-hookean", density, {})


def test_no_material_of_the_catalogue_is_strange():
    for name, row in read_rows("materials.csv").items():
        values = (float(row[k]) for k in ("young_modulus", "poisson_ratio", "density"))
        assert not strange(material(*values)), name


@pytest.mark.parametrize(
    ("young", "poisson", "density", "said"),
    [
        (600_000, 0.48, 1.1, "600000 Pa are 0.6 MPa"),
        (210_000, 0.48, 1.1, "stiffer than any rubber"),
        (1e-4, 0.48, 1.1, "softer than any gel"),
        (1.0, 0.1, 1.1, "Poisson ratio of 0.1 is that of a foam"),
        (1.0, 0.48, 1120, "1120 kg/m3 are 1.12 g/cm3"),
    ],
)
def test_what_is_strange_is_asked_about(young, poisson, density, said):
    (question,) = strange(material(young, poisson, density))
    assert said in question
