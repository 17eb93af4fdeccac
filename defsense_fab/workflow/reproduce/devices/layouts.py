"""An experiment's devices: one folder a layout, each built as any other device is.

Body, mesh and poses are the same in all of them, and are made once.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from ....core.device.build_folder import build_folder, own_files
from ....core.device.device import Device, Sensor
from ....core.device.device_file import DEVICE, load_device
from ....core.progress import Progress
from ....core.storage.files import replace_folder, storage_errors, write_text
from ....optimize.prediction.design_task import load_task
from ....optimize.search import baselines
from ....store.build import Build
from ...build.build import build
from ..experiments.experiment import DRAWN, MANUAL, OPTIMISED, Experiment, LayoutChoice

SIMULATED = "simulated"
_SEED = 0  # of the visual layout's lines
#: Of an experiment's folder, what is no part of the device.
_BESIDE = ("experiment.toml", "reproduce.py", "README.md", "picture.png", "markers")


def simulate_device(experiment: Experiment, out: Path, progress: Progress) -> Device:
    """The experiment's device with its poses solved, in a folder of `out`. Raises a DefsenseError
    where that fails."""
    folder = out / SIMULATED
    _copy_device(experiment.folder, folder)
    document = _read(experiment)
    _resize(document, experiment)
    _write(folder, document)
    device = load_device(folder)
    build(device, "simulate", progress)
    return device


def build_layout(
    experiment: Experiment, choice: LayoutChoice, simulated: Device, out: Path, progress: Progress
) -> Device:
    """The device with the cords of this layout, built in a folder of `out`: with its parts, or at a
    small size without. Raises a DefsenseError where that fails."""
    folder = out / choice.name
    _copy_device(experiment.folder, folder)
    document = _read(experiment)
    _resize(document, experiment)
    _lay(document, experiment, choice, simulated)
    _write(folder, document)
    device = load_device(folder)
    if not build_folder(device).exists():  # what all layouts have in common
        _link(build_folder(simulated), build_folder(device))
    build(device, "optimize" if experiment.quick else "report", progress)
    return device


def _copy_device(source: Path, into: Path) -> None:
    """Files that a body or a response is made from; those that are as they were are left alone."""
    with storage_errors(into):
        into.mkdir(parents=True, exist_ok=True)
        for path in own_files(source, without=into):
            name = path.relative_to(source)
            if name.parts[0] not in (DEVICE, *_BESIDE):
                (into / name).parent.mkdir(parents=True, exist_ok=True)
                _copy_file(path, into / name)


def _copy_file(source: Path, target: Path) -> None:
    if not target.exists() or target.read_bytes() != source.read_bytes():
        shutil.copyfile(source, target)


def _read(experiment: Experiment) -> tomlkit.TOMLDocument:
    return tomlkit.parse((experiment.folder / DEVICE).read_text(encoding="utf-8"))


def _write(folder: Path, document: tomlkit.TOMLDocument) -> None:
    write_text(folder / DEVICE, tomlkit.dumps(document))


def _table(document: tomlkit.TOMLDocument, name: str) -> Any:
    if name not in document:
        document[name] = tomlkit.table()
    return document[name]


def _resize(document: tomlkit.TOMLDocument, experiment: Experiment) -> None:
    if experiment.edge_length is not None:
        mesh = _table(document, "mesh")
        mesh.pop("accuracy", None)
        mesh["edge_length"] = experiment.edge_length
    if experiment.searches is not None:
        _table(document, "design")["searches"] = experiment.searches


def _lay(
    document: tomlkit.TOMLDocument, experiment: Experiment, choice: LayoutChoice, simulated: Device
) -> None:
    """Put the layout's cords into the device's text."""
    design = _table(document, "design")
    design.update(choice.design)
    if choice.file is not None:
        other = tomlkit.parse((experiment.folder / choice.file).read_text(encoding="utf-8"))
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
    document["sensors"] = _tables(_straight(choice, simulated))


def _straight(choice: LayoutChoice, simulated: Device) -> Sequence[Sensor]:
    task = load_task(simulated, Build(build_folder(simulated))).design
    assert choice.count is not None
    if choice.cords == MANUAL:
        return baselines.manual_layout(task, choice.count)
    return baselines.visual_layout(task, choice.count, np.random.default_rng(_SEED))


def _tables(sensors: Sequence[Sensor]) -> Any:
    """As in `device.toml`, to be kept as they are."""
    out = tomlkit.aot()
    for s in sensors:
        t, plane = tomlkit.table(), tomlkit.inline_table()
        plane["origin"] = np.round(s.plane.origin, 4).tolist()
        plane["normal"] = np.round(s.plane.axes[:, 2], 6).tolist()
        plane["x_axis"] = np.round(s.plane.axes[:, 0], 6).tolist()
        t["name"], t["plane"] = s.name, plane
        t["control_points"] = np.round(s.curve.points, 3).tolist()
        t["free"] = []
        out.append(t)
    return out


def _link(source: Path, target: Path) -> None:
    """A build's files in another place, as hard links where there can be: finished files are never
    written again."""

    def one(a: str, b: str) -> str:
        try:
            os.link(a, b)
        except OSError:
            shutil.copy2(a, b)
        return b

    with replace_folder(target) as temporary:
        shutil.copytree(source, temporary, copy_function=one, dirs_exist_ok=True)
