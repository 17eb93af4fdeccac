"""Texts for simulated cameras."""

from typing import get_args

import pytest

from defsense_fab.core.errors import DeviceError
from defsense_fab.twin.filming.camera_kinds import CAMERA_KINDS
from defsense_fab.twin.options import CameraKindName, TwinCameras, is_twin
from tests.support.errors import raises


@pytest.mark.parametrize(
    ("text", "cameras"),
    [
        ("twin", TwinCameras()),
        ("twin:", TwinCameras()),
        ("twin:phone", TwinCameras(kind="phone")),
        ("twin:cameras=3,seed=5", TwinCameras(5, 3)),
        ("twin:seed=0,industrial,cameras=1", TwinCameras(0, 1, "industrial")),
    ],
)
def test_words_come_in_any_order(text, cameras):
    assert TwinCameras.parse(text) == cameras
    assert is_twin(text)


@pytest.mark.parametrize("word", ["speed=2", "film", "seed", "seed=-1", "cameras=two"])
def test_unknown_words_are_rejected(word):
    with raises(DeviceError, "twin-cameras-invalid", value=word):
        TwinCameras.parse(f"twin:{word}")


@pytest.mark.parametrize("count", [0, 7])
def test_number_of_cameras_is_limited(count):
    with raises(DeviceError, "out-of-range", value=count) as caught:
        TwinCameras.parse(f"twin:cameras={count}", "sources")
    assert caught.value.where.startswith("sources")


def test_every_kind_of_camera_has_properties():
    assert tuple(CAMERA_KINDS) == get_args(CameraKindName)


def test_other_addresses_are_no_twins():
    assert not any(map(is_twin, ["0", "/dev/video0", "twin.mkv", "none", ""]))
