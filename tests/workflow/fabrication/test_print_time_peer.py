"""The estimated time to print plates, next to that of PrusaSlicer with the advised settings."""

import shutil

import pytest
import tomlkit

from defsense_fab.core.device.device_file import load_device
from defsense_fab.store.build import Build
from defsense_fab.workflow.build.build import build
from defsense_fab.workflow.fabrication.effort import find_effort
from tests.geometry.slicer import estimate_hours
from tests.support.places import DEVICES
from tests.support.shared_folders import fill_once

pytestmark = [pytest.mark.slow, pytest.mark.peer]

#: Devices whose plates did not set the rate or the time of a layer.
NAMES = ("joystick", "bar", "twist-bar", "cube", "character")
TOLERANCE = 0.25


@pytest.fixture(scope="module", params=NAMES)
def device(request, tmp_path_factory):
    """Return a device whose parts were made after one search on a coarse mesh."""
    name = request.param

    def fill(folder):
        skip = shutil.ignore_patterns("build", ".*")
        shutil.copytree(DEVICES / name, folder, ignore=skip, dirs_exist_ok=True)
        path = folder / "device.toml"
        document = tomlkit.parse(path.read_text("utf-8"))
        document["mesh"]["edge_length"] = 1.5 * float(document["mesh"]["edge_length"])
        document.setdefault("design", tomlkit.table())["searches"] = 1
        path.write_text(tomlkit.dumps(document), "utf-8")
        build(load_device(folder), "fabricate")

    return load_device(fill_once(tmp_path_factory, f"plates-of-{name}", fill))


def test_the_time_is_that_of_the_slicer(device, tmp_path):
    results = Build(device.source / "build")
    for plate in find_effort(device, results.manifest).plates:
        sliced = estimate_hours(results.folder / "parts" / plate.file, tmp_path)
        print(f"{device.name}, {plate.file}: {plate.hours:.2f} h, PrusaSlicer {sliced:.2f} h")
        assert plate.hours == pytest.approx(sliced, rel=TOLERANCE)
