"""Studies by `study.toml` through the command line: made, resumed, on a cluster, refused."""

import json
import socket

import meshio
import numpy as np
import pyarrow.parquet as pq
import pytest
import trimesh

from defsense_fab.cli.main import main
from defsense_fab.core.errors import StudyError
from defsense_fab.workflow.study.runs import batch, cluster
from defsense_fab.workflow.study.runs.run_log import RunLog, RunRecord, read_records

DEVICE = """schema = 1
name = "box"
[body]
mesh = "box.stl"
[material]
name = "tango-black-plus"
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
#: A scale of -1 is no device, and 3.0 is there twice.
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


def refused(capsys, folder, *words):
    assert main(["study", str(folder), *words]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert [n for n, line in enumerate(lines) if line.startswith("error: ")] == [len(lines) - 1]
    return lines[-1]


def is_whole(found):
    assert (found["points"], found["runs"]) == (5, 4)
    volumes = {r["parameters"]["body.scale"]: r["measures"]["volume"] for r in found["done"]}
    assert list(volumes) == [1, 2, 3]
    assert list(volumes.values()) == pytest.approx(10240 * np.array([1, 8, 27]))
    (failed,) = found["failed"]
    assert failed["message"].startswith("device.toml:3: body.scale: must be greater than 0")


def test_a_study_goes_on_where_it_stood(folder, capsys):
    found = study(capsys, folder, "--workers", "1")
    is_whole(found)
    assert found["made"] == 4
    table = pq.read_table(found["file"])
    assert table["body.scale"].to_pylist() == [1, 2, -1, 3]
    # Nothing is made again, not what a wider study of the same device has in common with it.
    assert study(capsys, folder)["made"] == 0
    log = folder / "study" / "runs.log"
    lines = log.read_text("utf-8").splitlines(keepends=True)
    assert len(lines) == 5
    log.write_text("".join(lines[:-1]) + lines[-1][:40])  # cut, as when it is killed
    (folder / "study.toml").write_text(STUDY.replace("3.0, 3.0", "2.0, 3.0, 1.0"))
    again = study(capsys, folder, "--workers", "1")
    assert (again["made"], len(again["done"])) == (1, 3)
    assert len(read_records(log)) == 4
    # A run of before is told with the values of the study that is made now.
    with (folder / "study.toml").open("a") as file:
        file.write("mesh.edge_length = [20.0]\n")
    wider = study(capsys, folder)
    assert wider["made"] == 1  # the one that is no device, with other values
    assert [r["parameters"]["mesh.edge_length"] for r in wider["done"]] == [20] * 3
    # Results of another device, and a log of another program, stay as they are.
    (folder / "device.toml").write_text(DEVICE.replace('"box"', '"cube"', 1))
    error = refused(capsys, folder)
    assert "results.parquet: holds results of the device 'box'; move it away" in error
    log.write_text("what?\n")
    (folder / "study" / "results.parquet").unlink()
    assert "runs.log: is not the log of this version's studies" in refused(capsys, folder)
    assert log.read_text("utf-8") == "what?\n"


def test_a_run_whose_process_dies_is_broken_and_tried_again(folder, capsys, monkeypatch):
    monkeypatch.setattr(batch, "_MODULE", "no_such_module")
    error = refused(capsys, folder, "--workers", "2")
    assert "none of its 4 runs succeeded; the first: the run's process ended early" in error
    assert "study.html lists all" in error
    found = read_records(folder / "study" / "runs.log").values()
    assert sorted(r.outcome for r in found) == ["broken", "broken", "broken", "refused"]
    with RunLog(folder), pytest.raises(StudyError, match="another study of this device"):
        RunLog(folder)
    monkeypatch.undo()
    is_whole(study(capsys, folder))


@pytest.mark.parametrize(
    ("words", "change", "told"),
    [
        (["--sensors", "1..2"], {}, "study.toml says what is studied; give design.sensors there"),
        (["--workers", "0"], {}, "--workers 0: give a number from 1"),
        (["--set", "width=3"], {}, "none of its 5 points gives a device; the first: device.toml"),
        ([], {"[1.0, 2.0, -1.0, 3.0, 3.0]": "[-1.0]"}, "study.toml: none of its 1 points gives"),
        ([], {"body.scale": "body.scales"}, "study.toml:3: parameters.body.scales: is no key of"),
        (
            ["--set", "x=2"],
            {"body.scale": "body.parameters.x"},
            "x: is fixed for all runs by --set",
        ),
        (["--scheduler", "bogus"], {}, "--scheduler bogus: no scheduler answers"),
        (["--scheduler", "nonsense://x"], {}, "--scheduler nonsense://x: no scheduler answers"),
    ],
)
def test_what_cannot_be_is_one_line(folder, capsys, words, change, told):
    for old, new in change.items():
        (folder / "study.toml").write_text(STUDY.replace(old, new))
    assert told in refused(capsys, folder, *words)


def test_options_of_runs_ask_for_a_study_file(folder, capsys):
    (folder / "study.toml").unlink()
    assert "study.toml, which is not there" in refused(capsys, folder, "--workers", "2")


def test_a_scheduler_that_is_not_there_is_told_within_seconds(folder, capsys, monkeypatch):
    monkeypatch.setattr(cluster, "ANSWERS", 1.0)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
        error = refused(capsys, folder, "--scheduler", address)
    assert f"--scheduler {address}: no scheduler answers there" in error
    assert "`dask scheduler`" in error


def test_a_cluster_makes_the_same_and_refuses_other_versions(
    folder, capsys, monkeypatch, tmp_path_factory
):
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=":0"
    ) as local:
        words = ["--scheduler", local.scheduler_address]
        there = cluster.installed()
        monkeypatch.setattr(cluster, "installed", lambda: there | {"numpy": "1.0"})
        error = refused(capsys, folder, *words)
        assert f"has numpy {there['numpy']} in place of 1.0; install the same versions" in error
        monkeypatch.undo()
        is_whole(study(capsys, folder, *words))
        (record, *_) = read_records(folder / "study" / "runs.log").values()
        assert isinstance(record, RunRecord)
        there = solved_fields(folder, tmp_path_factory.mktemp("there"), *words)
        here = solved_fields(folder, tmp_path_factory.mktemp("here"))
        assert len(here) == 3  # the whole, a half, and what is proposed to be kept out
        for name, u in here.items():
            np.testing.assert_array_equal(there[name], u)
        local.scale(0)


def solved_fields(source, folder, *words):
    """Displacements of a pose and its half by their names, solved anew."""
    for name in ("box.stl", "device.toml"):
        (folder / name).write_bytes((source / name).read_bytes())
    with (folder / "device.toml").open("a") as file:
        file.write("[states]\nramp = [0.5, 1.0]\n")
    assert main(["simulate", str(folder), "--json", *words]) == 0
    fields = (folder / "build" / "fields").glob("*.vtu")
    return {f.name: meshio.read(f).point_data["displacement"] for f in fields}
