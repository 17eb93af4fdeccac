"""A bar that is printed in one piece with its traces, from device.toml to its guide."""

import json
import re
import shutil

import numpy as np
import pytest
import trimesh

from defsense_fab.cli.exit_codes import DONE, REFUSED
from defsense_fab.cli.main import main
from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import DeviceError
from defsense_fab.geometry.printing.slicer_settings import slice_with_prusa
from defsense_fab.sensing.built_cord import CordReading
from defsense_fab.store.build import Build
from defsense_fab.twin.devices.twin_traits import TwinTraits
from defsense_fab.workflow.build.pose_forces import pose_forces
from defsense_fab.workflow.fabrication.printed import place_on_bed
from tests.support.body_scripts import write_bar
from tests.support.errors import raises
from tests.support.gcode_edits import remove_extrusion
from tests.support.places import BAR

pytestmark = pytest.mark.slow
CORD = """[cord]
process = "printed"
trace = "eel"

[fabrication]
process = "fdm-tpu"

[design]
sensors = 2
decoder = "affine"
searches = 1
"""


NARROW = """[wires]
exit = ["slot"]
pad = "thread"

[regions.slot]
box = [[-1, -3, -16], [4, 3, 16]]

[fabrication]"""
CORD_WITH_PAD = """name = "rubber-2mm"

[wires]
pad = "screw"
"""
DRAWN = """[[sensors]]
name = "{}"
control_points = [[2, 0, 0], [50, 0, 5], [100, 5, 0], [148, 0, 0]]
"""


def write_device(folder, **changes):
    write_bar(folder)
    text = (BAR / "device.toml").read_text(encoding="utf-8")
    text = text[: text.index("[cord]")] + CORD
    for old, new in {
        "edge_length = 8.0": "edge_length = 15.0",
        "markers = 40": "markers = 8",
        "ramp = [0.25, 0.5, 0.75, 1.0]": "ramp = [0.5, 1.0]",
        **changes,
    }.items():
        assert old in text
        text = text.replace(old, new)
    (folder / "device.toml").write_text(text, encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A bar with a hole to spare that is smaller than the edges of its mesh."""
    changes = {
        "[regions]": "[regions]\nhole = { cylinder = { start = [5, 8, -15], end = [5, 8, 15],"
        " radius = 1.0 } }",
        "[fabrication]": '[fabrication]\nkeep_whole = ["hole"]',
    }
    folder = write_device(tmp_path_factory.mktemp("printed"), **changes)
    assert main(["build", str(folder)]) == DONE
    return folder


def test_body_and_traces_are_one_object(folder):
    manifest = Build(folder / "build").manifest
    assert [p.name for p in manifest.parts] == ["1-whole"]
    assert [t.name for t in manifest.traces] == ["A", "B"]
    parts = folder / "build" / "parts"
    volumes = [trimesh.load_mesh(parts / f"{n}.stl").volume for n in ("1-whole", "A")]
    assert volumes[0] == pytest.approx(manifest.parts[0].volume, rel=1e-5)
    assert volumes[1] == pytest.approx(manifest.traces[0].volume, rel=1e-5)
    total = manifest.parts[0].volume + sum(t.volume for t in manifest.traces)
    assert total == pytest.approx(150 * 30 * 30, rel=1e-3)
    for file in ("prusaslicer.3mf", "bambu-orca.3mf", "materials.3mf", "two-extruders.ini"):
        assert (parts / file).stat().st_size > 0


def test_pads_are_on_the_skin_of_the_end_that_all_poses_hold(folder):
    middle, half = np.array([75.0, 0.0, 0.0]), np.array([75.0, 15.0, 15.0])
    for trace in Build(folder / "build").manifest.traces:
        outside = np.abs(trace.pads - middle) - half
        assert outside.max(axis=1) == pytest.approx(np.zeros(2), abs=0.05)
        assert trace.pads[:, 0].max() < 10.0


def test_traces_sense_up_to_their_pads(folder):
    build, device = Build(folder / "build"), load_device(folder)
    reading = CordReading.from_device(device)
    for record, trace in zip(build.layout.by_channel(), build.manifest.traces, strict=True):
        assert record.stretch[[0, -1]] == pytest.approx(trace.pads, abs=1e-3)
        assert record.series == 0
        assert trace.resistance == pytest.approx(reading.resistance(record.built))
        assert record.noise == pytest.approx(reading.noise(record.built))


def test_the_band_has_the_spread_of_the_filament(folder):
    """So do simulated devices."""
    band, device = Build(folder / "build").layout.band, load_device(folder)
    spread, traits = device.cord.trace.spread, TwinTraits.for_device(device)
    assert (band.gauge, band.resistance) == (spread, spread)
    assert (traits.building.gauge, traits.rubber.ohm_spread) == (spread, spread)


def test_traces_and_pads_keep_a_wall_to_a_kept_region(folder):
    parts = folder / "build" / "parts"
    for name in ("A", "B"):
        x, y, _ = trimesh.load_mesh(parts / f"{name}.stl").sample(20000, seed=0).T
        assert np.hypot(x - 5, y - 8).min() > 1.0 + 1.2 - 0.05


def test_the_stiffness_of_the_traces_is_in_the_prediction(folder):
    """The traces are stiffer than the body, so the stored fields differ."""
    build = Build(folder / "build")
    change = np.abs(build.fields.displacements - build.plain_fields.displacements).max()
    assert 1e-3 < change < 5.0


def test_traces_make_poses_take_more_force(folder):
    build = Build(folder / "build")
    assert [p.pose for p in build.forces.poses] == ["bend_up", "bend_down", "twist"]
    assert 1.0 < build.forces.traces < 2.0
    device = load_device(folder)
    plain = pose_forces(device, build.quadratic_mesh, build.plain_fields)
    for before, after in zip(plain.poses, build.forces.poses, strict=True):
        assert before.power < after.power


def test_the_guide_has_no_joints_and_cords(folder):
    guide = json.loads((folder / "build" / "guide.json").read_text(encoding="utf-8"))
    actions = [a for step in guide["steps"] for a in step["actions"]]
    assert [a["do"] for a in actions] == [
        "print",
        "connect pads",
        "connect pads",
        "wire to the board",
        "check wiring",
    ]
    assert [a.get("cord") for a in actions[1:3]] == ["A", "B"]
    assert actions[1]["ohm"][0]["about"] > 1000
    page = (folder / "build" / "guide.html").read_text(encoding="utf-8")
    assert page.count("data:image/svg+xml") == 2  # a pad, and the wiring


def test_texts_on_printed_traces_do_not_call_them_cords(folder):
    """Tables and keys of device.toml keep their names: [cord]."""
    for page in ("report.html", "guide.html"):
        text = (folder / "build" / page).read_text(encoding="utf-8")
        text = re.sub(r"(?s)<(style|script).*?</\1>", "", text)
        assert not re.search(r"\bcords?\b(?!\])", re.sub(r"<[^>]*>", " ", text))


def test_a_second_build_has_nothing_to_do(folder):
    before = (folder / "build" / "layout.json").stat().st_mtime_ns
    assert main(["build", str(folder)]) == DONE
    assert (folder / "build" / "layout.json").stat().st_mtime_ns == before


def test_sliced_beads_conduct_as_designed(folder, tmp_path, capsys):
    """The damaged print lacks a piece of a trace."""
    if shutil.which("prusa-slicer") is None:
        pytest.skip("PrusaSlicer is not installed")
    parts, gcode = folder / "build" / "parts", tmp_path / "bar.gcode"
    slice_with_prusa(parts / "prusaslicer.3mf", parts / "two-extruders.ini", gcode)
    assert main(["traces", str(folder), str(gcode), "--json"]) == DONE
    checked = json.loads(capsys.readouterr().out)
    assert checked["findings"] == []
    for trace in checked["traces"]:
        assert trace["resistance"] == pytest.approx(trace["expected"], rel=0.35)
    assert main(["traces", str(folder), str(gcode), "--tool", "0"]) == REFUSED  # swapped
    build, fabrication = Build(folder / "build"), load_device(folder).fabrication
    body, line = build.parts["1-whole"], build.manifest.traces[0].line
    middle = line[len(line) // 2][None]
    (point,) = place_on_bed(middle, np.array(fabrication.up), body, fabrication.bed)
    low, high = tuple(point - 1.2), tuple(point + 1.2)
    text = remove_extrusion(gcode.read_text(encoding="utf-8"), 1, low, high)
    gcode.write_text(text, encoding="utf-8")
    assert main(["traces", str(folder), str(gcode), "--json"]) == REFUSED
    (gap,) = json.loads(capsys.readouterr().out)["findings"]
    assert (gap["kind"], gap["traces"]) == ("gap", ["A"])
    assert gap["at"] == pytest.approx(point.tolist(), abs=2.0)


def test_a_file_that_is_no_gcode_is_refused(folder):
    assert main(["traces", str(folder), str(folder / "device.toml")]) == REFUSED


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        (
            {'"ninjaflex-85a"': '"soft"\nyoung_modulus = 0.12\npoisson_ratio = 0.49'},
            "trace-too-stiff",
        ),
        (
            {
                '"ninjaflex-85a"': '"own"\nyoung_modulus = 12\npoisson_ratio = 0.48',
                '"fdm-tpu"': '"polyjet"',
            },
            "printer-without-second-extruder",
        ),
        ({'"fdm-tpu"': '"fdm-tpu"\nline = 0.8'}, "trace-too-thin"),
        ({'"fdm-tpu"': '"fdm-tpu"\nlayer = 0.5'}, "trace-too-thin"),
        ({"searches = 1": "searches = 1\nplanes = 1"}, "key-not-applicable"),
        ({"[fabrication]": '[wires]\npad = "bolt"\n\n[fabrication]'}, "value-choice"),
        ({"[fabrication]": NARROW}, "exit-too-small"),
        ({'process = "printed"\ntrace = "eel"': CORD_WITH_PAD}, "key-not-applicable"),
        ({"[design]": DRAWN.format("../up") + "\n[design]"}, "name-invalid"),
        ({"[design]": DRAWN.format("body") + "\n[design]"}, "name-invalid"),
        ({"[fabrication]": '[wires]\nexit = ["bse"]\n\n[fabrication]'}, "unknown-region"),
    ],
)
def test_traces_that_cannot_work_are_refused(tmp_path, changes, code):
    with raises(DeviceError, code):
        load_device(write_device(tmp_path, **changes))
