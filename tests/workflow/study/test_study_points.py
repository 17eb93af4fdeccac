"""`study.toml` to points, and points to devices."""

import shutil
import tomllib

import numpy as np
import pytest

from defsense_fab.core.errors import StudyError
from defsense_fab.workflow.changed_values import changed_device, changed_text
from defsense_fab.workflow.study.measures import describe_measure, measures_until
from defsense_fab.workflow.study.plan import group_runs, plan_runs
from defsense_fab.workflow.study.study_file import load_study
from tests.support.errors import raises
from tests.support.places import BAR


@pytest.fixture
def folder(tmp_path):
    for name in ("device.toml", "bar.py"):
        shutil.copy(BAR / name, tmp_path)
    return tmp_path


def study(folder, text):
    (folder / "study.toml").write_text(text)
    return load_study(folder)


def test_a_grid_has_every_combination_and_whole_numbers_stay_whole(folder):
    text = (
        "[parameters]\ndesign.planes = { range = [1, 3], step = 1 }\n"
        'cord.noise = { range = [0, 0.01], steps = 3 }\n"fabrication.process" = ["fdm-tpu"]\n'
    )
    points = study(folder, text).points()
    assert len(points) == 9
    assert [p["design.planes"] for p in points[::3]] == [1, 2, 3]
    assert [p["cord.noise"] for p in points[:3]] == [0.0, 0.005, 0.01]
    assert {p["fabrication.process"] for p in points} == {"fdm-tpu"}


def test_a_list_goes_through_all_parameters_together(folder):
    text = 'design = "list"\n[parameters]\nbody.parameters.width = [28, 32]\ncord.noise = [0.1, 1]'
    assert study(folder, text).points() == [
        {"body.parameters.width": 28, "cord.noise": 0.1},
        {"body.parameters.width": 32, "cord.noise": 1},
    ]


def test_a_latin_hypercube_has_a_point_in_every_interval_of_each_parameter(folder):
    text = (
        'design = "latin-hypercube"\ncount = 16\nseed = 3\n[parameters]\n'
        "body.parameters.width = { uniform = [20, 36] }\n"
        "cord.noise = { log_uniform = [0.0001, 1.0] }\ndesign.planes = [1, 2]\n"
    )
    points = study(folder, text).points()
    assert points == study(folder, text).points()
    assert points != study(folder, text.replace("seed = 3", "seed = 4")).points()
    widths = np.sort([p["body.parameters.width"] for p in points])
    assert (np.floor(widths - 20) == np.arange(16)).all()
    decades = np.sort(np.log10([p["cord.noise"] for p in points])) * 4 + 16
    assert (np.floor(decades + 1e-6) == np.arange(16)).all()
    assert [p["design.planes"] for p in points].count(1) == 8


@pytest.mark.parametrize(
    ("text", "code", "key", "line"),
    [
        ("[parameters]\ncord.noise = 3", "value-type", "parameters.cord.noise", 2),
        ("[parameters]\ncord.noise = []", "too-few-items", "parameters.cord.noise", 2),
        ("[parameters]\ncord.noise = [2020-01-01]", "value-type", "parameters.cord.noise", 2),
        (
            "[parameters]\na.b = { range = [1, 2], step = 1e-320 }",
            "too-many-values",
            "parameters.a.b.range",
            2,
        ),
        (
            "[parameters]\na.b = { range = [1, 2], steps = 10001 }",
            "too-many-values",
            "parameters.a.b.range",
            2,
        ),
        (
            "[parameters]\ncord.noise = { uniform = [1, 2] }",
            "values-missing",
            "parameters.cord.noise",
            2,
        ),
        (
            "[parameters]\ncord.noise = { log_uniform = [0, 2] }",
            "out-of-range",
            "parameters.cord.noise.log_uniform",
            2,
        ),
        (
            "[parameters]\ncord.noise = { range = [2, 1], step = 1 }",
            "not-increasing",
            "parameters.cord.noise.range",
            2,
        ),
        (
            "[parameters]\ncord.noise = { range = [1, 2] }",
            "keys-exclusive",
            "parameters.cord.noise.range",
            2,
        ),
        (
            "[parameters]\ncord.noise = { range = [1, 2], uniform = [1, 2] }",
            "keys-exclusive",
            "parameters.cord.noise.uniform",
            2,
        ),
        (
            'design = "list"\n[parameters]\na.b = [1]\na.c = [1, 2]',
            "lengths-differ",
            "parameters",
            2,
        ),
        (
            '[parameters]\na.b = [1]\n"a.b" = [2]',
            "key-repeated",
            "parameters.a.b",
            3,
        ),
        ('design = "random"\n[parameters]\na.b = [1]', "value-choice", "design", 1),
        ('design = "latin-hypercube"\n[parameters]\na.b = [1]', "key-missing", "count", None),
        ("count = 3\n[parameters]\na.b = [1]", "key-not-applicable", "count", 1),
        ('until = "report"\n[parameters]\na.b = [1]', "value-choice", "until", 1),
        ('minimise = "decoder"\n[parameters]\na.b = [1]', "unknown-measure", "minimise", 1),
        ("[parameters]", "too-few-items", "parameters", 1),
        ("schema = 1", "too-few-items", "parameters", None),
        ("[[variants]]\ncord.name = 'a'", "key-missing", "variants.1", 1),
        ("[[variants]]\nname = 3", "name-invalid", "variants.1.name", 2),
        (
            '[[variants]]\nname = "a"\n[[variants]]\nname = "a"',
            "name-repeated",
            "variants.2.name",
            4,
        ),
        ('[[variants]]\nname = "a"\nx = [2020-01-01]', "value-type", "variants.1.x", 3),
        (
            '[parameters]\nvariant = [1]\n[[variants]]\nname = "a"',
            "key-repeated",
            "parameters.variant",
            2,
        ),
        ("colour = 3\n[parameters]\na.b = [1]", "key-unknown", "colour", 1),
    ],
)
def test_errors_in_study_toml_name_the_line_and_the_key(folder, text, code, key, line):
    with raises(StudyError, code, key=key, line=line):
        study(folder, text)


@pytest.mark.parametrize("key", ["cord.noize", "poses.bend_up.handles.1.rotate.degree", "cord"])
def test_a_parameter_that_does_not_exist_is_refused(folder, key):
    whole = study(folder, f'[parameters]\n"{key}" = [1, 2]\n')
    with raises(StudyError, "no-valid-point", count=2):
        plan_runs(folder, whole, {})


def test_a_parameter_that_is_fixed_is_refused(folder):
    whole = study(folder, "[parameters]\nbody.parameters.width = [20, 30]\n")
    with raises(StudyError, "parameter-fixed", parameter="body.parameters.width", line=2):
        plan_runs(folder, whole, {"body.parameters.width": 25})


VARIANTS = """[parameters]
design.seed = [1, 2]
[[variants]]
name = "cords"
[[variants]]
name = "traces"
sensors = []
"design.sensors" = 2
cord = { process = "printed", trace = "eel", width = 1.0 }
material = { name = "ninjaflex-85a" }
"""


def test_variants_replace_tables_and_combine_with_parameters(folder):
    plan = plan_runs(folder, study(folder, VARIANTS), {})
    names = [(r.values["variant"], r.values["design.seed"]) for r in plan.runs]
    assert names == [("cords", 1), ("cords", 2), ("traces", 1), ("traces", 2)]
    assert len({r.name for r in plan.runs}) == 4
    cords, traces = (changed_device(plan.text, folder, plan.runs[i].changes) for i in (1, 3))
    assert (cords.cord.trace, len(cords.sensors), cords.seed) == (None, 3, 2)
    assert (traces.cord.trace.width, traces.sensors, traces.propose, traces.seed) == (1.0, (), 2, 2)
    written = changed_text(plan.text, plan.runs[3].changes)
    assert changed_device(written, folder, {}).cord == traces.cord


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ('trace = "eel"', 'trace = "eal"', 9),
        ("width = 1.0", "width = -1.0", 9),
        ("sensors = []", "sensor = []", 7),
        ('"design.sensors" = 2', '"design.sensors" = 0', 5),  # its table begins there
    ],
)
def test_a_variant_that_gives_no_device_is_refused_with_its_line(folder, old, new, line):
    whole = study(folder, VARIANTS.replace(old, new))
    with raises(StudyError, "variant-invalid", variant="traces", line=line):
        plan_runs(folder, whole, {})


def test_parameters_reach_into_poses_and_absent_tables_and_leave_comments(folder):
    text = (folder / "device.toml").read_text("utf-8")
    values = {"poses.twist.handles.1.rotate.degrees": 20, "design.planes": 1, "cord.noise": 0.1}
    device = changed_device(text, folder, values)
    assert np.rad2deg(np.linalg.norm(device.poses[2].handles[0].rotation)) == pytest.approx(20)
    assert device.planes == 1
    assert device.cord.noise == 0.1
    written = changed_text(f"{text}# kept\n", values)
    assert "# kept" in written
    assert changed_device(written, folder, {}).planes == 1
    assert tomllib.loads(written)["poses"][2]["handles"][0]["rotate"]["degrees"] == 20
    with raises(StudyError, "unknown-name", name="bend"):
        changed_device(text, folder, {"poses.bend.fixed": []})


def test_a_run_is_identified_by_everything_it_depends_on(folder):
    text = (
        'until = "optimize"\n[parameters]\ncord.noise = [0.002, 0.004, -1]\n'
        "mesh.edge_length = [6.0, 8.0]\nfabrication.copies = [1, 2]\n"
    )
    plan = plan_runs(folder, study(folder, text), {})
    # Copies only matter when the parts are made; a noise of -1 is not allowed.
    runs = [r for r in plan.runs if not r.problem]
    assert (plan.points, len(runs)) == (12, 4)
    assert [r.problem.startswith("device.toml:") for r in plan.runs if r.problem] == [True] * 4
    assert len({r.simulation for r in runs}) == 2
    assert [len(b) for b in group_runs(runs, 1)] == [2, 2]
    assert {r.simulation for r in group_runs(runs, 1)[0]} == {group_runs(runs, 1)[0][0].simulation}
    # A new file in the device's folder changes the runs; results of builds do not.
    (folder / "build").mkdir()
    (folder / "build" / "x").write_text("")
    assert plan_runs(folder, study(folder, text), {}).runs == plan.runs
    (folder / "table.csv").write_text("1")
    assert not {r.name for r in plan.runs} & {
        r.name for r in plan_runs(folder, study(folder, text), {}).runs
    }


def test_runs_that_differ_in_the_search_seed_share_a_simulation(folder):
    text = "[parameters]\ndesign.seed = { range = [1, 3], step = 1 }\ndesign.searches = [2]\n"
    runs = plan_runs(folder, study(folder, text), {}).runs
    assert len(runs) == 3
    assert len({r.simulation for r in runs}) == 1
    # A device file that gives a default value equals one that leaves it out.
    text = "[parameters]\ndesign.seed = [1]\n"
    (explicit,) = plan_runs(folder, study(folder, text), {}).runs
    (implicit,) = plan_runs(folder, study(folder, text.replace("design.seed", "schema")), {}).runs
    assert explicit.name == implicit.name


def test_batches_are_divided_where_workers_would_be_idle(folder):
    runs = plan_runs(
        folder,
        study(folder, "[parameters]\ncord.noise = { range = [0.001, 0.04], steps = 40 }"),
        {},
    ).runs
    assert [len(b) for b in group_runs(runs, 1)] == [40]
    assert [len(b) for b in group_runs(runs, 2)] == [10] * 4
    assert [len(b) for b in group_runs(runs, 1, limit=16)] == [14, 14, 12]
    assert sum(group_runs(runs, 1000), ()) == runs
    assert min(len(b) for b in group_runs(runs, 1000)) == 4


def test_measures_of_a_run_are_those_of_its_stages():
    assert measures_until("mesh") == ["volume", "tets", "min_dihedral"]
    assert all(describe_measure(name) for name in measures_until("fabricate"))


@pytest.mark.slow
def test_progress_is_reported_while_many_points_are_read(folder):
    reports = []
    text = "[parameters]\ncord.noise = { range = [0.001, 0.04], steps = 1200 }"
    plan_runs(folder, study(folder, text), {}, lambda *report: reports.append(report))
    assert [message for _, _, message in reports] == ["500 points read", "1000 points read"]
