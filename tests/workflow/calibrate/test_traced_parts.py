"""Specimen and coupon with printed traces, from their files to the fitted resistivity."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from defsense_fab.calibration.session import read_specimen
from defsense_fab.cli.exit_codes import DONE, REFUSED
from defsense_fab.cli.main import main, run_command
from defsense_fab.core.device.cord_tables import CordTable
from defsense_fab.core.errors import CalibrationError, DefsenseError, FabricationError
from defsense_fab.core.schema.document import parse_document
from defsense_fab.geometry.printing.conductor_network import Resistivity
from defsense_fab.geometry.printing.slicer_settings import slice_with_prusa
from defsense_fab.workflow.calibrate.options import TraceOptions
from defsense_fab.workflow.calibrate.traced_parts import choose_traces, write_trace_coupon
from defsense_fab.workflow.fabrication.gcode_check import compare_print
from defsense_fab.workflow.fabrication.print_design import read_design
from tests.support.errors import raises
from tests.support.places import BAR, DEVICES

pytestmark = pytest.mark.slow
SLICER_FILES = ("prusaslicer.3mf", "bambu-orca.3mf", "materials.3mf", "two-extruders.ini")


@pytest.fixture(scope="module")
def coupon(tmp_path_factory):
    folder = tmp_path_factory.mktemp("coupon")
    assert run_command(["calibrate", "trace-coupon", str(folder), "--trace", "eel"]) == DONE
    return folder


@pytest.fixture(scope="module")
def specimen(tmp_path_factory):
    folder = tmp_path_factory.mktemp("specimen")
    words = ["calibrate", "specimen", str(folder), "--trace", "eel", "--radii", "75,150,250"]
    assert run_command(words) == DONE
    return folder


@pytest.fixture
def run(capsys):
    def run(*words):
        assert run_command(["calibrate", *map(str, words)]) == DONE
        text = capsys.readouterr().out
        return json.loads(text) if "--json" in words else text

    return run


def slice_parts(folder, out):
    if shutil.which("prusa-slicer") is None:
        pytest.skip("PrusaSlicer is not installed")
    slice_with_prusa(folder / "prusaslicer.3mf", folder / "two-extruders.ini", out)
    return out


def load(folder, name):
    mesh = trimesh.load_mesh(folder / f"{name}.stl")
    assert mesh.is_watertight
    return mesh


def test_the_specimen_and_its_traces_fill_a_bar(specimen):
    names = ("specimen", "inner", "neutral", "outer")
    meshes = {name: load(specimen, name) for name in names}
    assert sum(m.volume for m in meshes.values()) == pytest.approx(150 * 20 * 15, rel=1e-4)
    for name, z in zip(names[1:], (2.0, 7.5, 13.0), strict=True):
        assert meshes[name].bounds[:, 0] == pytest.approx([-75, 75], abs=1e-3)
        middle = meshes[name].vertices[np.abs(meshes[name].vertices[:, 0]) < 73]
        assert meshes[name].bounds[:, 2].mean() == pytest.approx(z, abs=0.02)
        assert len(middle) == 0  # straight between the pads
    for file in SLICER_FILES:
        assert (specimen / file).stat().st_size > 0
    assert (specimen / "jig-75.step").is_file()


def test_a_printed_specimen_is_measured_like_one_with_cords(specimen, run, tmp_path):
    data = json.loads((specimen / "specimen.json").read_text(encoding="utf-8"))
    assert data["cord"] == "eel"
    assert read_specimen(specimen).geometry.offset == data["channels"]["inner"] == 2.0
    words = ["record", "--port", "twin:speed=100", "--specimen", specimen, "--auto"]
    session = run(*words, "--rounds", "1", "--faces", "a", "--out", tmp_path / "session", "--json")
    assert session["finished"]


def test_traces_of_the_coupon_have_the_predicted_length_and_section(coupon):
    data = json.loads((coupon / "coupon.json").read_text(encoding="utf-8"))
    traces = {t["name"]: t for t in data["traces"]}
    ohm = {name: t["resistance"] for name, t in traces.items()}
    # 30 mm more of 1.2 x 0.8 mm, of 120 ohm mm; pads cancel.
    assert ohm["long"] - ohm["middle"] == pytest.approx(120 * 30 / (1.2 * 0.8))
    assert traces["upright"]["along"] == pytest.approx(0.0, abs=1e-9)
    assert traces["long"]["between"] == pytest.approx(0.0, abs=1e-9)
    assert {t["width"] for t in data["traces"]} == {1.2, 2.4}
    assert [t["name"] for t in data["traces"] if not t["fitted"]] == ["slope"]
    for name in traces:
        load(coupon, name)


def test_sliced_parts_have_no_findings(coupon, specimen, tmp_path, capsys):
    for folder in (coupon, specimen):
        gcode = slice_parts(folder, tmp_path / f"{folder.name}.gcode")
        capsys.readouterr()
        assert main(["traces", str(folder), str(gcode), "--json"]) == DONE
        checked = json.loads(capsys.readouterr().out)
        assert checked["findings"] == []
        for trace in checked["traces"]:
            # Slopes have more resistance than the model; the fit leaves them out.
            tolerance = 0.25 if trace["name"] == "slope" else 0.1
            assert trace["resistance"] == pytest.approx(trace["expected"], rel=tolerance)
    assert main(["traces", str(coupon), str(tmp_path / f"{specimen.name}.gcode")]) == REFUSED


@pytest.mark.parametrize(("resistivity", "between", "contact"), [(120, 3, 50), (200, 6, 200)])
def test_the_fit_recovers_the_numbers_of_a_sliced_coupon(
    coupon, run, tmp_path, resistivity, between, contact
):
    """Resistances are those of the beads of the slice, which know nothing of the fit's model.

    Beads fill 0.93 of a trace's 0.96 mm2, which is part of the fitted resistivity.
    """
    gcode = slice_parts(coupon, tmp_path / "coupon.gcode")
    true = Resistivity(resistivity, 2 * resistivity, between * resistivity)
    printed = compare_print(replace(read_design(coupon), resistivity=true), gcode, 1).report
    rng = np.random.default_rng(1)
    rows = [
        f"{t.name};{(t.resistance + 2 * contact) * (1 + 0.03 * rng.standard_normal()):.1f}"
        for t in printed.traces
    ]
    table = tmp_path / "readings.csv"
    table.write_text("\n".join(["trace;resistance", *rows]), encoding="utf-8")
    data = run("resistivity", coupon, "--readings", table, "--json")
    for key, truth, bias in (
        ("resistivity", resistivity, 0.04 * resistivity),
        ("between_layers", between, 0.03 * between),
        ("contact", contact, 0.002 * resistivity * between * 60),
    ):
        assert abs(data[key]["value"] - truth) < bias + 2.5 * data[key]["error"], key
    assert data["suspect"] is None
    cord = parse_document("\n".join(data["cord"][1:]), tmp_path / "device.toml").read(CordTable)
    assert cord.record(tmp_path).trace.between_layers == pytest.approx(
        data["between_layers"]["value"], rel=0.01
    )


def test_readings_by_number_repeat(coupon, run, tmp_path):
    data = json.loads((coupon / "coupon.json").read_text(encoding="utf-8"))
    ohm = [t["resistance"] for t in data["traces"]]
    words = ["resistivity", coupon, "--json", "--ohm", ",".join(f"{r:.3f}" for r in ohm)]
    assert run(*words)["resistivity"]["value"] == pytest.approx(120, rel=1e-3)
    table = tmp_path / "readings.csv"
    rows = [f"{n},{r:.3f}" for n, r in enumerate(ohm, 1)]
    table.write_text("\n".join(["trace,resistance", *rows, *rows]), encoding="utf-8")
    twice = run("resistivity", coupon, "--readings", table, "--json")
    assert len(twice["readings"]) == 2 * len(ohm)
    assert twice["between_layers"]["value"] == pytest.approx(3, rel=1e-3)
    assert "resistivity = 120" in run("resistivity", coupon, "--readings", table)


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("trace,resistance\nlong,7000\nlang,7000\n", "unknown-trace"),
        ("trace,ohm\nlong,7000\n", "column-missing"),
        ("trace,resistance\nlong,OL\nwide,2500\n", "open-circuit"),
        ("trace,resistance\nlong,7000\nwide,2500\n", "too-few-traces"),
        ("trace,resistance\n", "no-rows"),
    ],
)
def test_invalid_readings_are_refused(coupon, tmp_path, text, code):
    table = tmp_path / "readings.csv"
    table.write_text(text, encoding="utf-8")
    with raises(CalibrationError, code):
        run_command(["calibrate", "resistivity", str(coupon), "--readings", str(table)])


@pytest.mark.parametrize(
    ("words", "code"),
    [([], "argument-missing"), (["--ohm", "1,2"], "resistance-count-differs")],
)
def test_missing_readings_are_refused(coupon, words, code):
    with raises(CalibrationError, code) as caught:
        run_command(["calibrate", "resistivity", str(coupon), *words])
    assert caught.value.where == "--ohm"


def test_another_file_is_no_coupon(tmp_path):
    (tmp_path / "coupon.json").write_text('{"clearances": [0.1]}', encoding="utf-8")
    with raises(CalibrationError, "coupon-file-invalid"):
        run_command(["calibrate", "resistivity", str(tmp_path), "--ohm", "1"])


@pytest.mark.parametrize(
    ("words", "code", "where"),
    [
        (["--trace", "eal"], "unknown-filament", "--trace"),
        (["--trace", "eel", "--trace-width", "0.5"], "trace-too-thin", "--trace-width"),
        (["--trace", "eel", "--trace-height", "nan"], "out-of-range", "--trace-height"),
        (["--trace", "eel", "--process", "polyjet"], "printer-without-second-extruder",
         "--process"),
        (["--trace", "eel", "--process", "cast-silicone"], "printer-without-second-extruder",
         "--process"),
        (["--trace", "eel", "--process", "fdm"], "unknown-process", ""),
        (["--trace-width", "1"], "argument-missing", "--trace-width"),
        (["--device", str(BAR)], "no-printed-traces", str(BAR)),
        (["--device", str(BAR), "--trace", "eel"], "options-exclusive", "--trace"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("part", ["specimen", "trace-coupon"])
def test_traces_that_cannot_be_printed_are_refused(tmp_path, part, words, code, where):
    with raises(DefsenseError, code) as caught:
        run_command(["calibrate", part, str(tmp_path / "out"), *words])
    assert caught.value.where == where
    assert not (tmp_path / "out").exists()


def test_specimens_without_room_are_refused(tmp_path):
    words = ["calibrate", "specimen", str(tmp_path / "out"), "--trace", "eel"]
    with raises(FabricationError, "options-exclusive"):
        run_command([*words, "--cord", "3"])
    with raises(FabricationError, "thickness-too-small"):
        run_command([*words, "--thickness", "14", "--offset", "2"])
    with raises(FabricationError, "specimen-too-small"):
        run_command([*words, "--trace-width", "18"])


def test_parts_do_not_replace_those_of_another_part(coupon):
    before = (coupon / "coupon.json").read_bytes()
    with raises(FabricationError, "folder-in-use"):
        run_command(["calibrate", "specimen", str(coupon), "--trace", "eel"])
    assert (coupon / "coupon.json").read_bytes() == before


def test_a_device_states_filament_section_and_printer(tmp_path):
    for name in ("device.toml", "bar.py"):
        shutil.copy(DEVICES / "bar" / name, tmp_path)
    path = tmp_path / "device.toml"
    text = path.read_text(encoding="utf-8")
    cord = '[cord]\nprocess = "printed"\ntrace = "eel"\nwidth = 1.6\nbetween_layers = 5\n'
    start, end = text.index("[cord]"), text.index("[", text.index("[cord]") + 1)
    text = text[:start] + cord + "\n" + text[end:]
    text = text.replace("[fabrication]\n", "[fabrication]\nlayer = 0.1\n")
    path.write_text(text[: text.index("[[sensors]]")] if "[[sensors]]" in text else text)
    printing = choose_traces(TraceOptions(device=tmp_path))
    data = write_trace_coupon(tmp_path / "coupon", printing).data
    assert (data["trace_width"], data["between_layers"], data["layer"]) == (1.6, 5.0, 0.1)


def test_an_invalid_design_is_refused(coupon, tmp_path):
    (tmp_path / "traces.json").write_text('{"schema": 1}', encoding="utf-8")
    with raises(FabricationError, "design-file-invalid"):
        run_command(["traces", str(tmp_path), str(tmp_path / "x.gcode")])
