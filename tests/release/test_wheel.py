"""Build an sdist and a wheel of the tracked files: the contents, and use outside the repository."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tarfile
import zipfile

import pytest

from tests.support.places import ROOT

pytestmark = pytest.mark.slow

_FRONT_END_SOURCES = "defsense_fab/studio/web/"  # built to defsense_fab/data/web
_BUILD = "import sys; from setuptools import build_meta as b; b.build_{kind}(sys.argv[1])"


def _tracked():
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True)
    return [n for n in listed.stdout.decode().split("\0") if n and (ROOT / n).is_file()]


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory):
    """Return the contents of a wheel built from an sdist of the tracked files, as for PyPI."""
    top = tmp_path_factory.mktemp("release")
    excluded = ("tests/", "benchmarks/", "fixtures/c3d/")
    for name in _tracked():
        if not name.startswith(excluded):
            (top / "checkout" / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / name, top / "checkout" / name)
    _run(_BUILD.format(kind="sdist"), top / "checkout", top)
    (sdist,) = top.glob("*.tar.gz")
    with tarfile.open(sdist) as file:
        # Python 3.11 before 3.11.4 has no filters.
        filtered = {"filter": "data"} if hasattr(tarfile, "data_filter") else {}
        file.extractall(top / "sdist", **filtered)
    (source,) = (top / "sdist").iterdir()
    _run(_BUILD.format(kind="wheel"), source, top)
    (wheel,) = top.glob("*.whl")
    with zipfile.ZipFile(wheel) as file:
        file.extractall(top / "site")
    return top / "site"


def _run(program, folder, *words):
    environment = {**os.environ, "PYTHONPATH": str(folder)}
    done = subprocess.run(
        [sys.executable, "-c", program, *map(str, words)],
        cwd=folder, env=environment, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_wheel_contains_the_files_of_the_package_only(unpacked):
    files = {p.relative_to(unpacked).as_posix() for p in unpacked.rglob("*") if p.is_file()}
    licenses = {n.split("/licenses/")[1] for n in files if ".dist-info/licenses/" in n}
    assert {"LICENSE", "defsense_fab/data/web/LICENSES.txt"} <= licenses
    files = {n for n in files if ".dist-info/" not in n}
    package = {n for n in _tracked() if n.startswith("defsense_fab/")}
    package = {n for n in package if not n.startswith(_FRONT_END_SOURCES)}
    carried = {n for n in files if n.startswith(tuple(f"defsense_fab/data/{k}/" for k in
               ("devices", "examples", "arduino")))}  # fmt: skip
    (kernels,) = files - carried - package  # compiled for this system, for all Pythons
    assert kernels.startswith("defsense_fab/core/machine/kernels.")
    assert package <= files
    for name, folder in (("devices", "fixtures/devices"), ("examples", "examples"),
                         ("arduino", "firmware")):  # fmt: skip
        copies = [n for n in carried if n.startswith(f"defsense_fab/data/{name}/")]
        assert copies
        for copy in copies:
            source = ROOT / folder / copy.removeprefix(f"defsense_fab/data/{name}/")
            assert (unpacked / copy).read_bytes() == source.read_bytes()


_PROGRAM = """
from pathlib import Path
import defsense_fab
assert defsense_fab.__file__.startswith({here!r}), defsense_fab.__file__
from defsense_fab.capture.boards.images import IMAGES
from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.storage.package_data import package_data, read_rows
from defsense_fab.report.html import environment
from defsense_fab.workflow.reproduce.experiment_file import example_names, find_experiments
from defsense_fab.workflow.starts.starting_devices import STARTING_DEVICES, create_starting_device
for start in STARTING_DEVICES:
    create_starting_device(start, Path(start.name), "grip")
    assert load_device(Path(start.name)).poses and start.picture
for experiment in find_experiments(example_names()):
    device = experiment.folder / "device.toml"
    assert not device.exists() or load_device(experiment.folder).body.path.is_file()
templates = environment().list_templates()
assert {{"report.html", "guide/instructions.jinja", "viewer/view.html"}} <= set(templates)
assert (package_data("arduino") / "DefSense" / "src" / "DefSense.cpp").is_file()
assert all(image.read() for image in IMAGES.values())
"""


def test_package_data_are_found_outside_the_repository(unpacked, tmp_path):
    environment = {**os.environ, "PYTHONPATH": str(unpacked)}
    program = _PROGRAM.format(here=str(unpacked))
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, env=environment,
                          capture_output=True, text=True)  # fmt: skip
    assert done.returncode == 0, done.stderr
