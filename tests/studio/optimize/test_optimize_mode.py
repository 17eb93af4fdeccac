"""The Optimize mode, used through its buttons without a browser."""

from __future__ import annotations

import shutil
import threading
from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.cli.main import main
from defsense_fab.core.curve import Hermite
from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import StorageError
from defsense_fab.report.surface_errors import surface_errors
from defsense_fab.store.build import Build
from defsense_fab.studio.workbench.build_job import CandidateLayout
from tests.runtime.live_frames import wait_for
from tests.support.errors import raises

TIMEOUT_S = 600.0


def optimize_mode(page):
    mode = page.modes["Optimize"]
    page.enter("Optimize")
    assert mode.comparison.worker.wait(TIMEOUT_S)
    return mode


def bent(sensor, distance):
    points = sensor.curve.points.copy()
    points[2:-2, 1] += distance
    return replace(sensor, curve=Hermite(points, sensor.curve.tangents))


def test_the_best_layout_of_a_search_is_taken_and_undone(studio_page):
    mode, bench = optimize_mode(studio_page), studio_page.bench
    text, sensors = bench.project.text, bench.project.device.sensors
    mode.take_best()
    assert bench.status.code == "no-cords-found"
    for callback in bench.on_build_started:
        callback()
    assert mode.shows_build_controls
    folder = bench.project.folder / "build"
    better = tuple(bent(s, 3.0) for s in sensors)
    mode.search.add(CandidateLayout(folder, sensors, 2.0, True, 1.0))
    assert mode.search.worker.wait(TIMEOUT_S)
    mode.search.add(CandidateLayout(folder, better, 1.0, False, 2.0))
    assert mode.search.worker.wait(TIMEOUT_S)
    assert mode.search.record.best.sensors is sensors  # the other may break limits
    assert mode.search.current_cords == {s.name for s in sensors}
    errors = [bench.judge.judge(s, quick=True).error for s in (sensors, better)]
    mode.search.add(CandidateLayout(folder, better, 1.0, True, 3.0))
    assert mode.search.worker.wait(TIMEOUT_S)
    assert mode.search.record.judged.error == min(errors)
    assert len(mode.search.record.curve[0]) == 3
    mode.take_best()
    taken = load_device(bench.project.folder).sensors
    best = mode.search.record.best.sensors
    for a, b in zip(taken, best, strict=True):
        np.testing.assert_allclose(a.curve.points, b.curve.points, atol=1e-3)
    bench.project.undo()
    assert bench.project.text == text
    studio_page.enter("Cords")
    assert not mode.search.current_cords
    assert not mode.search.best_cords


def test_actions_that_are_not_possible_yet_show_a_message(studio_page):
    mode, bench = optimize_mode(studio_page), studio_page.bench
    mode.pause()
    assert bench.status.code == "no-build-running"
    mode.comparison.take()
    assert bench.status.code == "no-layout-chosen"
    mode.comparison.compare()
    assert bench.status.code == "no-layouts"
    (bench.project.folder / "build" / "layout.json").unlink()
    bench.load()
    mode.take()
    assert bench.status.code == "not-optimized"
    assert mode.error_map.status.code == "not-optimized"


@pytest.mark.slow
def test_layouts_are_compared_and_one_is_taken(made_page):
    mode, bench = optimize_mode(made_page), made_page.bench
    (built,) = mode.comparison.layouts
    assert built.is_built
    assert built.parts == 2
    assert mode.comparison.estimated_time_s > 0
    mode.comparison.compare()
    assert mode.comparison.job.wait(TIMEOUT_S)
    assert mode.comparison.status.error is None
    by_name = {layout.name: layout for layout in mode.comparison.layouts}
    assert set(by_name) == {built.name, "as drawn", "by eye"}
    drawn = by_name["as drawn"]  # the cords are locked, so the build has the same ones
    assert drawn.error == pytest.approx(built.error)
    assert drawn.parts == built.parts
    assert drawn.band == pytest.approx(built.band)
    mode.comparison.choose("by eye")
    assert mode.comparison.drawn_cords == {s.name for s in by_name["by eye"].sensors}
    text = bench.project.text
    mode.comparison.take()
    assert [s.name for s in bench.project.device.sensors] == ["cord-1", "cord-2"]
    bench.project.undo()
    assert bench.project.text == text


@pytest.mark.slow
def test_layouts_are_not_compared_after_the_poses_have_changed(made_page):
    mode, bench = optimize_mode(made_page), made_page.bench
    changed = bench.project.text.replace("degrees = 45", "degrees = 40")
    (bench.project.folder / "device.toml").write_text(changed, encoding="utf-8")
    made_page.poll()
    with raises(StorageError, "build-outdated", stage="simulate"):
        mode.comparison.compare()


@pytest.mark.slow
def test_the_error_map_has_the_numbers_of_the_report(made_page):
    mode, folder = optimize_mode(made_page), made_page.bench.project.folder / "build"
    errors = surface_errors(Build(folder))
    mode.error_map.choose("twist@1")
    assert mode.error_map.worker.wait(TIMEOUT_S)
    index = errors.names.index("twist@1")
    assert mode.error_map.status.code == "shown"
    assert mode.error_map.shown_error == pytest.approx(errors.mean(index))
    assert f">{errors.highest:.3g}</text>" in mode.error_map.bar
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert f"{errors.mean(index):.2f}" in page
    assert not made_page.bench.body.visible
    bar = mode.error_map.bar
    mode.error_map.choose("bend_up@1")
    assert mode.error_map.worker.wait(TIMEOUT_S)
    assert mode.error_map.bar == bar  # one scale for all states
    made_page.enter("Cords")
    assert mode.error_map.worker.wait(TIMEOUT_S)
    assert made_page.bench.body.visible
    assert not mode.error_map.is_shown


@pytest.mark.slow
def test_a_paused_search_gives_the_results_of_the_command(made_page, tmp_path):
    mode, bench = optimize_mode(made_page), made_page.bench
    path = bench.project.folder / "device.toml"
    text = bench.project.text
    at = text.rindex("\ncontrol_points")
    path.write_text(text[:at] + '\nfree = ["path"]' + text[at:], encoding="utf-8")
    made_page.poll()
    shutil.copytree(bench.project.folder, tmp_path / "other")
    loaded = threading.Event()
    bench.on_build_loaded.append(loaded.set)

    def pause_at_first_layout(_):
        bench.on_layout_found.remove(pause_at_first_layout)
        mode.pause()

    bench.on_layout_found.append(pause_at_first_layout)
    assert bench.build("optimize")
    assert wait_for(lambda: bench.builds.state == "paused")
    assert mode.is_paused
    mode.pause()
    assert not mode.is_paused
    assert loaded.wait(TIMEOUT_S)
    assert bench.build_error is None
    assert mode.search.worker.wait(TIMEOUT_S)
    assert mode.search.record.best is not None
    assert len(mode.search.record.curve[0]) > 2
    assert main(["optimize", str(tmp_path / "other"), "--search"]) == 0
    for name in ("layout.json", "layouts.json", "prediction.json"):
        studio_file = bench.project.folder / "build" / name
        assert studio_file.read_bytes() == (tmp_path / "other" / "build" / name).read_bytes()
