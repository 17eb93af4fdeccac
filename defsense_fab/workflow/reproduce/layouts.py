"""The devices of an experiment: one folder per layout, each built like any other device.

The body, the mesh and the simulated poses are the same in all of them, and are computed once.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from ...core.device.build_folder import build_folder, own_files
from ...core.device.device import Device, Sensor
from ...core.device.device_file import DEVICE, load_device
from ...core.progress import Progress
from ...core.storage.files import replace_folder, storage_errors, write_text
from ...optimization.prediction.design_task import load_task
from ...optimization.search import baselines
from ...store.build import Build
from ..build.build import build
from ..build.options import BuildOptions
from .experiment import DRAWN, MANUAL, OPTIMISED, QUICK_SEARCHES, Experiment, LayoutChoice

SIMULATED = "simulated"
VISUAL_SEED = 0  # of the lines of visual layouts
#: Files of an experiment's folder that are not part of the device.
OTHER_FILES = ("experiment.toml", "reproduce.py", "README.md", "picture.png", "markers")


def simulate_device(experiment: Experiment, out: Path, progress: Progress) -> Device:
    """Simulate the poses of the experiment's device in a folder of `out`.

    Returns:
        The device in that folder.

    Raises:
        DefsenseError: The device cannot be meshed or simulated.
    """
    folder = out / SIMULATED
    document = _copy_device(experiment, folder)
    write_text(folder / DEVICE, tomlkit.dumps(document))
    device = load_device(folder)
    build(device, "simulate", progress)
    return device


def build_layout(
    experiment: Experiment, choice: LayoutChoice, simulated: Device, out: Path, progress: Progress
) -> Device:
    """Build the device with the cords of a layout in a folder of `out`.

    Args:
        experiment: The experiment; quick ones are built without parts.
        choice: The layout.
        simulated: Result of `simulate_device`.
        out: Folder of the experiment's results.
        progress: Called with the progress.

    Returns:
        The built device.

    Raises:
        DefsenseError: The layout cannot be built.
    """
    folder = out / choice.name
    document = _copy_device(experiment, folder)
    _set_cords(document, experiment, choice, simulated)
    write_text(folder / DEVICE, tomlkit.dumps(document))
    device = load_device(folder)
    if not build_folder(device).exists():  # the results that all layouts share
        _link_folder(build_folder(simulated), build_folder(device))
    options = BuildOptions(search=True)  # results do not depend on earlier runs
    build(device, "optimize" if experiment.quick else "report", progress, options=options)
    return device


def _copy_device(experiment: Experiment, into: Path) -> tomlkit.TOMLDocument:
    """Copy the files of a body and a response; return `device.toml` at the experiment's size."""
    with storage_errors(into):
        into.mkdir(parents=True, exist_ok=True)
        for path in own_files(experiment.folder, without=into):
            name = path.relative_to(experiment.folder)
            if name.parts[0] not in (DEVICE, *OTHER_FILES):
                target = into / name
                target.parent.mkdir(parents=True, exist_ok=True)
                if not target.exists() or target.read_bytes() != path.read_bytes():
                    shutil.copyfile(path, target)
    document = _read(experiment.folder / DEVICE)
    if experiment.edge_length is not None:
        mesh = document.setdefault("mesh", tomlkit.table())
        mesh.pop("accuracy", None)
        mesh["edge_length"] = experiment.edge_length
    if experiment.quick:
        document.setdefault("design", tomlkit.table())["searches"] = QUICK_SEARCHES
    return document


def _read(path: Path) -> tomlkit.TOMLDocument:
    return tomlkit.parse(path.read_text(encoding="utf-8"))


def _set_cords(
    document: tomlkit.TOMLDocument, experiment: Experiment, choice: LayoutChoice, simulated: Device
) -> None:
    """Replace the cords in the text of the device by those of the layout."""
    design = document.setdefault("design", tomlkit.table())
    design.update(choice.design)
    if choice.file is not None:
        other = _read(experiment.folder / choice.file)
        document.pop("sensors", None)
        document["sensors"] = other["sensors"]
    if choice.cords == OPTIMISED:
        if choice.count is not None:
            document.pop("sensors", None)
            design["sensors"] = choice.count
        return
    design.pop("sensors", None)
    if choice.cords == DRAWN:
        for sensor in document.get("sensors", []):
            sensor["free"] = []
        return
    assert choice.count is not None
    document.pop("sensors", None)
    document["sensors"] = _sensor_tables(_straight_cords(choice, simulated))


def _straight_cords(choice: LayoutChoice, simulated: Device) -> Sequence[Sensor]:
    task = load_task(simulated, Build(build_folder(simulated))).design
    assert choice.count is not None
    if choice.cords == MANUAL:
        return baselines.manual_layout(task, choice.count)
    return baselines.visual_layout(task, choice.count, np.random.default_rng(VISUAL_SEED))


def _sensor_tables(sensors: Sequence[Sensor]) -> Any:
    """Return fixed cords as tables of `device.toml`."""
    tables = tomlkit.aot()
    for s in sensors:
        t, plane = tomlkit.table(), tomlkit.inline_table()
        plane["origin"] = np.round(s.plane.origin, 4).tolist()
        plane["normal"] = np.round(s.plane.axes[:, 2], 6).tolist()
        plane["x_axis"] = np.round(s.plane.axes[:, 0], 6).tolist()
        t["name"], t["plane"] = s.name, plane
        t["control_points"] = np.round(s.curve.points, 3).tolist()
        t["free"] = []
        tables.append(t)
    return tables


def _link_folder(source: Path, target: Path) -> None:
    """Copy a build with hard links where possible, as finished files are never changed."""

    def link_file(a: str, b: str) -> str:
        try:
            os.link(a, b)
        except OSError:
            shutil.copy2(a, b)
        return b

    with replace_folder(target) as temporary:
        shutil.copytree(source, temporary, copy_function=link_file, dirs_exist_ok=True)
