"""Cords are optimised and layouts compared, by the page's own buttons."""

from __future__ import annotations

import shutil
import threading
from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.cli.main import main
from defsense_fab.core.curve import Hermite
from defsense_fab.core.device.device_file import load_device
from defsense_fab.report.surface_errors import surface_errors
from defsense_fab.store.build import Build
from defsense_fab.studio.workbench.build_job import CandidateLayout

LONG = 280.0


def optimise_mode(page):
    mode = page.modes["Optimise"]
    page.enter("Optimise")
    assert mode.compared.worker.wait(LONG)
    return mode


def bent(sensor, by):
    points = sensor.curve.points.copy()
    points[2:-2, 1] += by
    return replace(sensor, curve=Hermite(points, sensor.curve.tangents))


def test_a_search_is_seen_and_its_best_is_taken_and_undone(studio_page):
    mode, bench = optimise_mode(studio_page), studio_page.bench
    text, sensors = bench.project.text, bench.project.device.sensors
    mode.take_best()
    assert "No search has come" in bench._message.content
    for told in bench.on_build_started:
        told()
    assert mode._pause.visible
    folder = bench.project.folder / "build"
    better = tuple(bent(s, 3.0) for s in sensors)
    mode.search.see(CandidateLayout(folder, sensors, 2.0, True, 1.0))
    assert mode.search.worker.wait(LONG)
    first = mode.search.record.judged.error
    assert f"### {first:.2f} mm" in mode.search._told.content
    mode.search.see(CandidateLayout(folder, better, 1.0, False, 2.0))
    assert mode.search.worker.wait(LONG)
    assert mode.search.record.best.sensors is sensors  # on the way, limits may be broken
    assert set(mode.search._present._tubes) == {s.name for s in sensors}
    errors = [bench.judge.judge(s, quick=True).error for s in (sensors, better)]
    mode.search.see(CandidateLayout(folder, better, 1.0, True, 3.0))
    assert mode.search.worker.wait(LONG)
    assert mode.search.record.judged.error == min(errors)
    assert len(mode.search._curve.data[0]) == 3
    assert "| bend_up |" in mode.search._poses.content
    mode.take_best()
    assert bench.project.undo_name == "take the optimised cords"
    taken = load_device(bench.project.folder).sensors
    best = mode.search.record.best.sensors
    for a, b in zip(taken, best, strict=True):
        np.testing.assert_allclose(a.curve.points, b.curve.points, atol=1e-3)
    bench.project.undo()
    assert bench.project.text == text
    studio_page.enter("Cords")
    assert not mode.search._present._tubes
    assert not mode.search._best._tubes


def test_what_cannot_be_done_yet_is_told(studio_page):
    mode, bench = optimise_mode(studio_page), studio_page.bench
    mode.pause()
    assert bench._message.content == "Nothing is running that could be paused."
    mode.compared.take()
    assert bench._message.content == "Choose a layout first."
    mode.compared.weigh()
    assert "optimize the cords first" in bench._message.content
    (bench.project.folder / "build" / "layout.json").unlink()
    bench.load()
    mode.take()
    assert bench._message.content == "Optimise the cords first."
    assert mode.errors._told.content.startswith("Nothing is optimised yet")


@pytest.mark.slow
def test_layouts_are_compared_and_one_is_taken(made_page):
    mode, bench = optimise_mode(made_page), made_page.bench
    (known,) = mode.compared.layouts
    assert known.taken
    assert known.parts == 2
    assert "(about " in mode.compared._weigh.label
    mode.compared.weigh()
    assert mode.compared.work.wait(LONG)
    assert mode.compared._state.content == ""
    by_name = {one.name: one for one in mode.compared.layouts}
    assert set(by_name) == {known.name, "as drawn", "by eye"}
    drawn = by_name["as drawn"]  # locked, so that they are those of the build
    assert drawn.error == pytest.approx(known.error)
    assert drawn.parts == known.parts
    assert drawn.band == pytest.approx(known.band)
    mode.compared.choose("by eye")
    assert mode.compared._tubes.names == {s.name for s in by_name["by eye"].sensors}
    text = bench.project.text
    mode.compared.take()
    assert [s.name for s in bench.project.device.sensors] == ["cord-1", "cord-2"]
    bench.project.undo()
    assert bench.project.text == text
    other = text.replace("degrees = 45", "degrees = 40")
    (bench.project.folder / "device.toml").write_text(other, encoding="utf-8")
    made_page.look()
    bench.run_action(mode.compared.weigh)
    assert "the poses have changed since they were simulated" in bench._message.content


@pytest.mark.slow
def test_the_error_map_has_the_numbers_of_the_report(made_page):
    mode, folder = optimise_mode(made_page), made_page.bench.project.folder / "build"
    found = surface_errors(Build(folder))
    mode.errors.choose("twist@1")
    assert mode.errors.worker.wait(LONG)
    at = found.names.index("twist@1")
    assert f"**{found.mean(at):.2f} mm** over the surface" in mode.errors._told.content
    assert f"<span>{found.highest:.3g}</span>" in mode.errors._bar.content
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert f"{found.mean(at):.2f}" in page
    assert not made_page.bench.body.visible
    bar = mode.errors._bar.content
    mode.errors.choose("bend_up@1")
    assert mode.errors.worker.wait(LONG)
    assert mode.errors._bar.content == bar  # one scale for all
    made_page.enter("Cords")
    assert mode.errors.worker.wait(LONG)
    assert made_page.bench.body.visible
    assert mode.errors._mesh is None


@pytest.mark.slow
def test_a_search_that_is_watched_and_paused_gives_what_the_command_gives(made_page, tmp_path):
    mode, bench = optimise_mode(made_page), made_page.bench
    path = bench.project.folder / "device.toml"
    text = bench.project.text
    at = text.rindex("\ncontrol_points")
    path.write_text(text[:at] + '\nfree = ["path"]' + text[at:], encoding="utf-8")
    made_page.look()
    shutil.copytree(bench.project.folder, tmp_path / "other")
    over = threading.Event()
    bench.on_build_loaded.append(over.set)

    def first(_):
        bench.on_layout_found.remove(first)
        mode.pause()

    bench.on_layout_found.append(first)
    assert bench.build("optimize")
    assert wait_for(lambda: bench.builds.state == "paused")
    assert mode._pause.label == "Go on"
    mode.pause()
    assert over.wait(LONG)
    assert bench.build_error is None
    assert mode.search.worker.wait(LONG)
    assert mode.search.record.best is not None
    assert len(mode.search.record.curve[0]) > 2
    assert main(["optimize", str(tmp_path / "other")]) == 0
    for name in ("layout.json", "layouts.json", "prediction.json"):
        ours, theirs = (f / "build" / name for f in (bench.project.folder, tmp_path / "other"))
        assert ours.read_bytes() == theirs.read_bytes()
