"""Sections and maps of the next cord, as the studio makes them: how fast a coarse cut follows a
hand, how long the fine one and the maps take, and how many cords are tried.

`python -m benchmarks.studio_inside DEVICE...`, on built devices. All on this process's threads,
without a page; what the browser takes to draw is not part of it.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from defsense_fab.core.curve import Plane, sample_path
from defsense_fab.core.device.device import Device
from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.device.build_folder import build_folder
from defsense_fab.optimize.prediction.body_section import BodySection
from defsense_fab.optimize.prediction.layout_judge import LayoutJudge
from defsense_fab.optimize.prediction.next_cord import next_cord, shortest
from defsense_fab.studio.inside.looks import LOOKS
from defsense_fab.studio.inside.section_picture import Pictures, Wanted
from defsense_fab.studio.inside.section_planes import first_plane, first_state

_CUTS = 40  # planes that a hand goes through


def main(folders: list[str]) -> None:
    cuts, maps = [], []
    for folder in folders:
        device = load_device(Path(folder))
        judge = LayoutJudge(device, build_folder(device))
        cuts += _cuts(device, judge)
        maps += _maps(device, judge)
    print("| device | tets | looked at | coarse cuts a second | fine cut, s |")
    print("|---|---:|---|---:|---:|")
    print("\n".join(cuts))
    print("\n| device | cords | tried | grid | points | cords with room | s | error, mm | best |")
    print("|---|---:|---|---|---:|---:|---:|---:|---:|")
    print("\n".join(maps))


def _cuts(device: Device, judge: LayoutJudge) -> list[str]:
    task, rows = judge.task, []
    body = _body(judge)
    plane, pictures = first_plane(judge.surface.vertices), Pictures(body)
    paths = tuple(sample_path(sensor) for sensor in device.sensors)
    state, tets = first_state(task.weights), len(task.everything.locator.mesh.cells)
    for look in LOOKS[:-1]:
        wanted = Wanted(plane, state, look, 0.0, None, paths, None, False)
        pictures.fine(wanted)  # what is made once
        began = time.perf_counter()
        for by in np.linspace(-0.04, 0.04, _CUTS) * body.size:
            pictures.coarse(replace(wanted, plane=_at(plane, by), moving=True))
        rate = _CUTS / (time.perf_counter() - began)
        began = time.perf_counter()
        _fine(pictures, body, wanted)
        took = time.perf_counter() - began
        rows.append(f"| {device.name} | {tets} | {look.label} | {rate:.0f} | {took:.2f} |")
    return rows


def _maps(device: Device, judge: LayoutJudge) -> list[str]:
    task, rows = judge.task, []
    body, plane = _body(judge), first_plane(judge.surface.vertices)
    began = time.perf_counter()
    task.everything.grid  # noqa: B018 - what is made once
    took = time.perf_counter() - began
    rows.append(f"| {device.name} | | depth grid, once | | | | {took:.2f} | | |")
    for length in (shortest(task), None):
        began = time.perf_counter()
        for found in next_cord(judge, body, plane, device.sensors, length):
            if found.share == 1.0:
                took = time.perf_counter() - began
                rows.append(
                    f"| {device.name} | {len(device.sensors)} |"
                    f" {'skin to skin' if length is None else f'{length:.0f} mm'} |"
                    f" {'fine' if found.fine else 'coarse'} | {len(found.points)} |"
                    f" {found.tried} | {took:.2f} | {found.error:.2f} |"
                    f" {found.error - found.best_drop:.2f} |"
                )
    return rows


def _body(judge: LayoutJudge) -> BodySection:
    problem = judge.task.everything
    return BodySection(problem.locator, problem.fields, judge.task.names)


def _fine(pictures: Pictures, body: BodySection, wanted: Wanted) -> None:
    """All that a fine section takes, except for sending it."""
    pictures.fine(wanted)
    half, _ = body.half(wanted.plane)
    for points in (half, *wanted.cords):
        body.carried(points, wanted.state)


def _at(plane: Plane, by: float) -> Plane:
    return Plane(plane.origin + by * plane.normal, plane.axes)


if __name__ == "__main__":
    main(sys.argv[1:])
