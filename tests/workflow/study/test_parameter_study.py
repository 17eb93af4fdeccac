"""Parameter studies through the command line: new, resumed, on a cluster, and rejected."""

import csv
import json
import socket
import threading
import time

import meshio
import numpy as np
import pytest
import trimesh

from defsense_fab.cli.main import main
from defsense_fab.core.errors import CaptureError, StudyError
from defsense_fab.workflow.build import cluster
from defsense_fab.workflow.changed_values import changed_device
from defsense_fab.workflow.study import run_group
from defsense_fab.workflow.study.options import StudyOptions
from defsense_fab.workflow.study.parameter_study import study_parameters
from defsense_fab.workflow.study.run_log import RunLog
from tests.support.errors import raises

DEVICE = """schema = 1
name = "box"
[body]
mesh = "box.stl"
[material]
name = "ninjaflex-85a"
[mesh]
edge_length = 20.0
[regions]
base = { box = [[-20, -9, -9], [-10, 9, 9]] }
[[poses]]
name = "hang"
fixed = ["base"]
gravity = [0, 0, -1]
[cord]
name = "rubber-2mm"
[design]
sensors = 1
"""
#: A scale of -1 is invalid, and 3.0 is repeated.
STUDY = 'until = "body"\n[parameters]\nbody.scale = [1.0, 2.0, -1.0, 3.0, 3.0]\n'


@pytest.fixture
def folder(tmp_path):
    trimesh.creation.box((40, 16, 16)).export(tmp_path / "box.stl")
    (tmp_path / "device.toml").write_text(DEVICE)
    (tmp_path / "study.toml").write_text(STUDY)
    return tmp_path


def study(capsys, folder, *words):
    assert main(["study", str(folder), "--json", *words]) == 0
    return json.loads(capsys.readouterr().out)


def reject(capsys, folder, *words):
    assert main(["study", str(folder), *words]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert [n for n, line in enumerate(lines) if line.startswith("error: ")] == [len(lines) - 1]
    return lines[-1]


def read_records(folder):
    with RunLog(folder) as log:
        return log.records


def check_complete(result):
    assert result["points"] == 5
    volumes = {r["parameters"]["body.scale"]: r["measures"]["volume"] for r in result["done"]}
    assert list(volumes) == [1, 2, 3]
    assert list(volumes.values()) == pytest.approx(10240 * np.array([1, 8, 27]))
    (failed,) = result["failed"]
    assert failed["message"].startswith("device.toml:3: body.scale: ")


@pytest.mark.slow
def test_interrupted_study_resumes(folder, capsys):
    result = study(capsys, folder, "--workers", "1")
    check_complete(result)
    assert result["made"] == 4
    with open(result["file"]) as file:
        assert [float(r["body.scale"]) for r in csv.DictReader(file)] == [1, 2, -1, 3]
    # Runs are not repeated, nor those that a larger study of the device has in common with it.
    assert study(capsys, folder)["made"] == 0
    log = folder / "study" / "runs.log"
    lines = log.read_text("utf-8").splitlines(keepends=True)
    assert len(lines) == 5
    log.write_text("".join(lines[:-1]) + lines[-1][:40])  # cut, as by a killed process
    (folder / "study.toml").write_text(STUDY.replace("3.0, 3.0", "2.0, 3.0, 1.0"))
    resumed = study(capsys, folder, "--workers", "1")
    assert (resumed["made"], len(resumed["done"])) == (1, 3)
    assert len(read_records(folder)) == 4
    # An earlier run is reported with the values of the current study.
    with (folder / "study.toml").open("a") as file:
        file.write("mesh.edge_length = [20.0]\n")
    wider = study(capsys, folder)
    assert wider["made"] == 1  # the invalid one has other values
    assert [r["parameters"]["mesh.edge_length"] for r in wider["done"]] == [20] * 3
    # The log of another program is not changed.
    log.write_text("what?\n")
    with raises(CaptureError, "wrong-file-format"):
        study_parameters(folder, {})
    assert "runs.log" in reject(capsys, folder)
    assert log.read_text("utf-8") == "what?\n"


@pytest.mark.slow
def test_variants_are_compared_and_the_best_is_a_device(folder, capsys):
    (folder / "study.toml").write_text(
        'until = "body"\nminimise = "volume"\n[[variants]]\nname = "as it is"\n'
        '[[variants]]\nname = "small"\nbody = { mesh = "box.stl", scale = 0.5 }\n'
    )
    result = study(capsys, folder)
    volumes = {r["parameters"]["variant"]: r["measures"]["volume"] for r in result["done"]}
    assert volumes == pytest.approx({"small": 1280, "as it is": 10240})
    best = changed_device((folder / "study" / "best.toml").read_text("utf-8"), folder, {})
    assert best.body.scale == 0.5
    assert main(["study", str(folder)]) == 0
    assert "small" in capsys.readouterr().out
    with (folder / "study" / "results.csv").open(encoding="utf-8") as file:
        assert {row["variant"] for row in csv.DictReader(file)} == set(volumes)


@pytest.mark.slow
def test_run_whose_process_dies_is_broken_and_repeated(folder, capsys, monkeypatch):
    monkeypatch.setattr(run_group, "RUN_MODULE", "no_such_module")
    with raises(StudyError, "all-runs-failed", runs=4):
        study_parameters(folder, {}, options=StudyOptions(workers=2))
    assert "results.csv" in reject(capsys, folder, "--workers", "2")
    result = read_records(folder).values()
    assert sorted(r.outcome for r in result) == ["broken", "broken", "broken", "refused"]
    with RunLog(folder), raises(CaptureError, "file-in-use"):
        RunLog(folder)
    monkeypatch.undo()
    check_complete(study(capsys, folder))


@pytest.mark.slow
def test_run_that_takes_too_long_is_broken(folder):
    text = "time_limit = 0.01\n" + STUDY.replace("[1.0, 2.0, -1.0, 3.0, 3.0]", "[1.0, 2.0]")
    (folder / "study.toml").write_text(text)
    with raises(StudyError, "all-runs-failed", runs=2):
        study_parameters(folder, {})
    records = read_records(folder).values()
    assert [r.outcome for r in records] == ["broken", "broken"]
    assert all("time_limit" in r.message for r in records), [r.message for r in records]


@pytest.mark.parametrize(
    ("words", "change", "value"),
    [
        (["--sensors", "1..2"], {}, "design.sensors"),
        (["--workers", "0"], {}, "--workers"),
        (["--set", "width=3"], {}, "5 points"),
        ([], {"[1.0, 2.0, -1.0, 3.0, 3.0]": "[-1.0]"}, "1 points"),
        ([], {"body.scale": "body.scales"}, "body.scales"),
        (
            ["--set", "x=2"],
            {"body.scale": "body.parameters.x"},
            "body.parameters.x",
        ),
        (["--scheduler", "bogus"], {}, "bogus"),
        (["--scheduler", "nonsense://x"], {}, "nonsense://x"),
    ],
)
def test_invalid_studies_are_rejected_in_one_line(folder, capsys, words, change, value):
    for old, new in change.items():
        (folder / "study.toml").write_text(STUDY.replace(old, new))
    assert value in reject(capsys, folder, *words)


def test_options_of_runs_need_a_study_file(folder, capsys):
    (folder / "study.toml").unlink()
    assert "study.toml" in reject(capsys, folder, "--workers", "2")


def test_missing_scheduler_is_reported_within_seconds(folder, capsys, monkeypatch):
    monkeypatch.setattr(cluster, "SCHEDULER_TIMEOUT_S", 1.0)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
        with raises(StudyError, "scheduler-unreachable", address=address):
            study_parameters(folder, {}, options=StudyOptions(scheduler=address))


@pytest.mark.slow
def test_cluster_gives_the_same_results_and_rejects_other_versions(
    folder, capsys, monkeypatch, tmp_path_factory
):
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=":0"
    ) as local:
        words = ["--scheduler", local.scheduler_address]
        versions = cluster.installed_versions()
        answers = iter([versions | {"numpy": "1.0"}])
        monkeypatch.setattr(cluster, "installed_versions", lambda: next(answers, versions))
        with raises(StudyError, "worker-versions-differ", name="numpy"):
            study_parameters(folder, {}, options=StudyOptions(scheduler=local.scheduler_address))
        monkeypatch.undo()
        check_complete(study(capsys, folder, *words))
        assert len(read_records(folder)) == 4
        builds = []
        for name, options in (("remote", words), ("local", [])):
            into = tmp_path_factory.mktemp(name)
            monkeypatch.setenv("DEFSENSE_CACHE", str(into / "cache"))
            builds.append(optimize(folder, into, *options))
        (remote, remote_layout), (local_fields, layout) = builds
        assert len(local_fields) == 3  # the pose, its half, and a state that is held out
        for name, u in local_fields.items():
            np.testing.assert_array_equal(remote[name], u)
        assert remote_layout == layout
        check_cancelled_tasks_end(local.scheduler_address)
        local.scale(0)


def optimize(source, folder, *words):
    """Solve a pose and its half, and search twice for a cord.

    Returns:
        The displacements by file name, and the layout's file.
    """
    for name in ("box.stl", "device.toml"):
        (folder / name).write_bytes((source / name).read_bytes())
    with (folder / "device.toml").open("a") as file:
        file.write("searches = 2\n[states]\nramp = [0.5, 1.0]\n")
    assert main(["optimize", str(folder), "--json", *words]) == 0
    fields = (folder / "build" / "fields").glob("*.vtu")
    layout = (folder / "build" / "layout.json").read_bytes()
    return {f.name: meshio.read(f).point_data["displacement"] for f in fields}, layout


def check_cancelled_tasks_end(address):
    started, ended = threading.Event(), threading.Event()
    _EVENTS[:] = [started, ended]
    with cluster.connect(address) as client:
        tasks = cluster.map_on_cluster(client, _wait_for_cancellation, [0, 1], None)
        next(tasks)
        assert started.wait(30)
        tasks.close()
        assert ended.wait(30)


_EVENTS = []


def _wait_for_cancellation(number, _):
    """Return at once, or wait until the client cancels this task, in this process."""
    if number:
        started, ended = _EVENTS
        is_cancelled = cluster.cancellation_check()
        started.set()
        while not is_cancelled():
            time.sleep(0.01)
        ended.set()
