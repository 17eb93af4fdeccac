"""Test the files for printing and assembly, without simulating anything."""

import json
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import DeviceError, FabricationError
from defsense_fab.core.storage import typed_json
from defsense_fab.geometry.bodies.body import load_body
from defsense_fab.geometry.channels.cord_assembly import Stretch
from defsense_fab.geometry.channels.cord_channels import make_channels
from defsense_fab.optimization.limits.verification import verify
from defsense_fab.optimization.prediction import as_built
from defsense_fab.optimization.prediction.as_built import fabricate, part_rules
from defsense_fab.optimization.prediction.design_task import layout_limits
from defsense_fab.report.guide.guide import assembly_guide, plain_steps, write_guide
from defsense_fab.report.guide.steps import guide_steps
from defsense_fab.sensing.built_cord import BuiltCord
from defsense_fab.sensing.voltage_divider import E24, choose_reference
from defsense_fab.store.layout import (
    CordPath,
    CordRecord,
    LayoutRecord,
    LimitsRecord,
    Prediction,
)
from defsense_fab.store.manifest import load_manifest, load_part
from defsense_fab.workflow.build.cut_list import bill, cut_list, held_by
from defsense_fab.workflow.build.stage_fabricate import write_parts
from tests.geometry import slicer
from tests.store.layouts import BAND
from tests.support.errors import raises
from tests.support.follow_guide.__main__ import follow, follow_steps
from tests.support.follow_guide.assembler import Assembler
from tests.support.places import DEVICES
from tests.support.written_surfaces import count_faults, read_triangles

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def cube():
    device = load_device(DEVICES / "cube")
    return device, load_body(device.body)


@pytest.fixture(scope="module")
def made(cube):
    """Return the parts of the cube with its drawn cords."""
    device, body = cube
    return fabricate(device, body.surface, device.sensors, lambda *_: None, body.solid)


@pytest.fixture(scope="module")
def folder(cube, made, layout, tmp_path_factory):
    """Return the folder of the parts, with arbitrary signals."""
    device, _ = cube
    out = tmp_path_factory.mktemp("cube")
    signals = np.array([[0, 0, 0], [0.44, -0.19, 0.1]])
    cords = cut_list(device, made, SimpleNamespace(cords=built(made), signals=signals))
    write_parts(device, made, out, layout, cords, layout.prediction)
    return out


def built(made):
    """Return held cords between their ferrules; the second one is not stretched at assembly."""
    out = []
    for channel, prestretch in zip(made.channels, (0.05, 0.0, 0.1), strict=True):
        between = channel.length - sum(e.pocket for e in channel.ends)
        length = np.linalg.norm(np.diff(channel.sensing, axis=0), axis=1).sum()
        out.append(BuiltCord(channel.sensing, max(between - length, 0.0), prestretch))
    return out


@pytest.fixture(scope="module")
def layout(cube, made):
    """Return a layout of the drawn cords, with arbitrary predictions."""
    device, _ = cube
    cords = tuple(
        CordRecord(
            **vars(CordPath.of(s)), channel=k, points=c.inside, length=c.length, min_radius=9.0,
            min_wall=2.0, inlets=(1.0, 1.0), cord_diameter=2.0, peak_strain=0.1, least_strain=0.0,
            stretch=b.path, series=b.series, prestretch=b.prestretch, noise=0.003,
        )
        for k, (s, c, b) in enumerate(zip(device.sensors, made.channels, built(made), strict=True))
    )  # fmt: skip
    prediction = Prediction(
        "affine", (0.003,) * 3, 1.2, 1.1, 3, "held out", 1.0, 0.9, 2.0, 1.5, 0.1, {"rest": 0.0}, {}
    )
    return LayoutRecord(
        device.name, "hash", LimitsRecord(1.2, 5.0, 3.4), None, cords, 4.0, (), (), prediction, {},
        {},
        BAND, prediction, (), False, (), 1,
    )  # fmt: skip


@pytest.fixture(scope="module")
def manifest(folder):
    return json.loads((folder / "parts" / "manifest.json").read_text("utf-8"))


@pytest.mark.peer
def test_crossing_planes_make_parts_that_can_be_sliced(folder, manifest, tmp_path):
    slicer.accept(folder / "parts")
    slicer.accept(folder / "parts" / "print")
    for plate in manifest["plates"]:
        slicer.slice_(folder / "parts" / plate["file"], tmp_path)
    slicer.slice_(folder / "parts" / manifest["parts"][0]["print"], tmp_path)


def test_every_written_surface_is_closed_by_the_places_of_its_corners(folder, manifest):
    files = [p for ending in ("stl", "3mf") for p in (folder / "parts").rglob(f"*.{ending}")]
    assert len(files) >= 2 * len(manifest["parts"]) + len(manifest["plates"]) + 1
    for file in files:
        for name, triangles in read_triangles(file).items():
            assert (file.name, name, *count_faults(triangles)) == (file.name, name, 0, 0)


def test_manifest_is_consistent_with_the_files(folder, manifest):
    assert len(manifest["parts"]) >= 5  # of crossing planes
    total = sum(p["volume"] for p in manifest["parts"]) + manifest["removed_volume"]
    assert total == pytest.approx(manifest["body_volume"], rel=1e-5)  # faces are set back by GAP
    for p in manifest["parts"]:
        surface = load_part(folder / "parts" / p["stl"])
        assert surface.volume == pytest.approx(p["volume"], rel=1e-4)
        assert surface.bounds == pytest.approx(np.array(p["bbox"]), abs=1e-4)
        assert load_part(folder / "parts" / p["print"]).volume == pytest.approx(
            p["volume"], rel=1e-4
        )
        assert p["step_volume"] == pytest.approx(p["volume"], rel=2e-3)
        assert len(p["sockets"]) >= 2
    counted = {p["name"]: p["count"] for p in manifest["pins"]}
    used = [p["name"] for step in manifest["assembly"] for p in step["pins"]]
    assert counted == {n: used.count(n) for n in counted}
    on_plates = [n for plate in manifest["plates"] for n in plate["parts"]]
    assert len(on_plates) == len(set(on_plates)) == len(manifest["parts"]) + len(used)
    assert len(manifest["marker_seats"]) == 8
    assert all(np.isfinite(c["value"]) for c in manifest["checks"])


def test_assembly_joins_existing_groups_to_the_whole_device(manifest):
    """Each step joins two groups that exist by then; the last completes the device."""
    groups = [{p["name"]} for p in manifest["parts"]]
    for step in manifest["assembly"]:
        low, high = (set(side) for side in step["join"])
        assert low in groups
        assert high in groups
        groups = [g for g in groups if g not in (low, high)] + [low | high]
    assert len(groups) == 1


def test_lengths_and_resistances_of_the_cut_list(cube, manifest):
    device, _ = cube
    rows = zip(manifest["cords"], (0.44, 0.0, 0.1), (0.05, 0.0, 0.1), strict=True)
    for c, top, p in rows:
        assert [e["joint"] for e in c["ends"]] == ["pocket", "pocket"]
        pockets = [e["pocket"] for e in c["ends"]]
        # The ferrule, and a bend where the skin is level or leans.
        assert set(np.round(pockets, 2)) <= {7.0, 11.05, 12.26, 13.88}
        assert [e["wire"]["leaves"] for e in c["ends"]] == [
            "bend" if p > 7 else "mouth" for p in pockets
        ]
        assert c["between_ferrules"] == pytest.approx(c["channel_length"] - sum(pockets))
        assert c["prestretch"] == p
        loose = c["between_ferrules"] - c["sensing_length"] * p / (1 + p)
        assert c["unstretched"] == pytest.approx(loose, abs=0.02)
        assert c["cut_length"] == pytest.approx(c["unstretched"] + 7 + c["slack"])
        assert c["slack"] == 5 or any(e["after"] is not None for e in c["ends"])
        assert c["resistance_before"] == pytest.approx(14.5 * c["unstretched"])
        # With a gauge factor of 2, the stretched part gains twice its prestretch.
        gained = 14.5 * c["sensing_length"] / (1 + p) * 2 * p
        assert c["resistance"] == pytest.approx(c["resistance_before"] + gained)
        assert c["sensing_length"] <= c["between_ferrules"] + 0.01
        assert c["range"][1] == pytest.approx(c["resistance"] * (1 + top))
        assert c["reference_resistor"] == pytest.approx(np.sqrt(np.prod(c["range"])), rel=0.06)
    items = " ".join(b["item"] for b in manifest["bill"])
    for word in ("ninjaflex-85a", "rubber-2mm", "ferrule", "wire", "pin-", "resistor", "glue",
                 "Arduino Nano"):  # fmt: skip
        assert word in items
    assert device.fabrication.pockets


def test_end_is_in_the_joint_of_its_ferrule():
    """It is not in the joint behind the ferrule, which only its wire reaches."""
    lies = [Stretch(2, (1, 3), 0.0, 3.0), Stretch(0, (4, 5), 3.0, 43.0),
            Stretch(1, (2, 3), 43.0, 44.5)]  # fmt: skip
    found = held_by(lies, (0.0, 4.0))
    assert [(s.joint, s.start, s.stop) for s in found] == [(2, 0.0, 3.0), (0, 3.0, 44.5)]
    (only,) = held_by(lies, (4.0, 4.0))
    assert (only.joint, only.start, only.stop) == (0, 0.0, 44.5)
    assert held_by(lies, (0.0, 0.0)) == tuple(lies)
    assert held_by(lies[:1], (9.0, 9.0)) == tuple(lies[:1])


def test_bill_is_for_all_copies(cube, made):
    """The plates and the silicone are for all copies, too."""
    device, _ = cube
    signals = np.array([[0, 0, 0], [0.44, -0.19, 0.1]])
    cords = cut_list(device, made, SimpleNamespace(cords=built(made), signals=signals))
    three = replace(device, fabrication=replace(device.fabrication, copies=3))
    amounts = [
        [float(b.amount.split()[0]) for b in bill(d, made, cords, {"pin-5x11.9": 4})]
        for d in (device, three)
    ]
    assert amounts[1] == pytest.approx(3 * np.array(amounts[0]), rel=0.02)
    assert amounts[1][2] == 18  # ferrules


@pytest.mark.parametrize(
    ("loss", "length", "piece", "bends"),
    [(1.04, 30.0, 50.0, 6), (1.06, 30.0, 50.0, 0), (1.0, 19.0, 50.0, 0), (1.0, 30.0, 60.0, 0)],
)
def test_bends_are_omitted_if_they_cost_too_much(cube, monkeypatch, loss, length, piece, bends):
    """Paths are 65.7 mm long, which with bends is too long for the shortest `piece`."""
    device, body = cube
    device = replace(device, cord=replace(device.cord, lengths=(piece, 400.0)))
    monkeypatch.setattr(
        as_built,
        "built_cords",
        lambda task, channels: [SimpleNamespace(length=length, bent=bool(channels[0].leads))],
    )
    monkeypatch.setattr(
        as_built,
        "predict",
        lambda task, cords: SimpleNamespace(
            prediction=SimpleNamespace(unseen=loss if cords[0].bent else 1.0)
        ),
    )
    decide = as_built.decide_strain_relief
    decided, _, note = decide(device, None, body.surface, device.sensors, None)
    r = part_rules(decided)
    made = make_channels(device.sensors, body.surface, r.channel, r.inner_wall, r.pockets)
    assert sum(len(c.leads) for c in made) == bends
    assert bool(note) == (bends == 0)
    for phrase, costs in (
        ("error", loss > 1.05),
        ("too little", length < 20),
        ("longer", piece > 55),
    ):
        assert (phrase in "".join(note)) == costs
    assert not verify(device.sensors, body.surface, layout_limits(decided)).violations
    requested = replace(device, fabrication=replace(device.fabrication, strain_relief=True))
    kept, _, note = decide(requested, None, body.surface, device.sensors, None)
    assert kept is requested
    assert not note


def test_reference_resistor_gives_the_largest_swing():
    """Compare with all E24 values of six decades."""
    values = np.array([e * 10.0**d for d in range(6) for e in E24])
    rng = np.random.default_rng(2)
    for low, high in np.sort(10 ** rng.uniform(1.5, 4.5, (50, 2)), axis=1):
        swing = high / (high + values) - low / (low + values)
        chosen = choose_reference(low, high)
        got = high / (high + chosen) - low / (low + chosen)
        assert got == pytest.approx(swing.max(), rel=1e-3)


def test_the_guide_has_every_step_with_its_pictures(cube, folder, layout, manifest):
    device, _ = cube
    parts = {p["name"]: load_part(folder / "parts" / p["stl"]) for p in manifest["parts"]}
    warnings = ["A warning about a cord.", "A warning about a pose."]
    layout = replace(layout, warnings=(warnings[0],))
    guide = assembly_guide(device, layout, load_manifest(folder), parts, np.eye(3), [warnings[1]])
    write_guide(guide, folder)
    typed_json.save(folder / "layout.json", layout)
    page = (folder / "guide.html").read_text("utf-8")
    joint_count = len(manifest["assembly"])
    late_count = sum(e["after"] is not None for c in manifest["cords"] for e in c["ends"])
    assert any(c["drawn"] for c in manifest["cords"])  # cords pass through the last joint
    # Each joint has a picture of its pins, its cords and its parts.
    assert page.count("data:image/png;base64,") == 1 + 3 * joint_count + late_count
    assert "://" not in page
    for part in manifest["parts"]:
        assert part["name"] in page
    assert [page.count(w) for w in warnings] == [1, 1]
    assert (folder / "templates.pdf").read_bytes().startswith(b"%PDF-")
    assert follow(folder, device) == []  # an assembler can follow it literally
    assert not list(folder.glob(".*.part"))


@pytest.mark.peer
def test_freecad_reads_the_same_volumes_from_step_files(folder, manifest, tmp_path):
    if shutil.which("freecadcmd") is None:
        pytest.skip("FreeCAD is not installed")
    script = tmp_path / "volumes.py"
    script.write_text(
        "import Part, json, glob, os\n"
        f"paths = sorted(glob.glob({str(folder / 'parts' / '*.step')!r}))\n"
        "out = {os.path.basename(p): Part.read(p).Volume for p in paths}\n"
        f"open({str(tmp_path / 'out.json')!r}, 'w').write(json.dumps(out))\n"
    )
    subprocess.run(["freecadcmd", str(script)], capture_output=True, timeout=300, check=False)
    volumes = json.loads((tmp_path / "out.json").read_text("utf-8"))
    for p in manifest["parts"]:
        assert volumes[p["step"]] == pytest.approx(p["step_volume"], rel=1e-6)
    total = sum(p["step_volume"] for p in manifest["parts"])
    assert volumes["assembly.step"] == pytest.approx(total, rel=1e-6)


def test_part_larger_than_the_bed_is_refused(cube, made, layout):
    device, _ = cube
    small = replace(device, fabrication=replace(device.fabrication, bed=(25.0, 25.0, 25.0)))
    with raises(FabricationError, "part-too-large"):
        write_parts(small, made, Path("/nonexistent"), layout, (), layout.prediction)


def test_guide_of_parts_in_pieces_can_be_followed(cube, made, layout, tmp_path):
    """Pieces are joined first, so that each joint of a cord is as many steps later."""
    device, _ = cube
    made = replace(made, parts=tuple(replace(p, solid=None) for p in made.parts))
    signals = np.array([[0, 0, 0], [0.44, -0.19, 0.1]])
    cords = cut_list(device, made, SimpleNamespace(cords=built(made), signals=signals))
    small = replace(device, fabrication=replace(device.fabrication, bed=(58.0, 58.0, 100.0)))
    write_parts(small, made, tmp_path, layout, cords, layout.prediction)
    manifest = load_manifest(tmp_path)
    pieces = len(manifest.assembly) - len(made.cuts)
    assert pieces > 0
    for cord in manifest.cords:
        for stretch in cord.stretches:
            assert cord.sensor in manifest.assembly[stretch.joint].cords
    parts = {p.name: load_part(tmp_path / "parts" / p.stl) for p in manifest.parts}
    steps = plain_steps(guide_steps(small, manifest, parts))
    assembler = Assembler(
        json.loads((tmp_path / "parts" / "manifest.json").read_text("utf-8")),
        typed_json.to_json(layout),
        {n: s.vertices[s.faces] for n, s in parts.items()},
        small.cord.ferrule_length,
        small.cord.max_strain,
    )
    assert follow_steps({"steps": steps}, assembler) == []


@pytest.mark.parametrize(
    ("bay", "code", "key"),
    [
        ("size = [9, 9, 9]", "key-missing", "body.bay.at"),
        ("at = [0, 0]", "wrong-shape", "body.bay.at"),
        ("at = [0, 0, 30]\nsize = [9, 9]", "wrong-shape", "body.bay.size"),
        ("at = [0, 0, 30]\nsize = [9, 9, -1]", "out-of-range", "body.bay.size"),
        ("at = [0, 0, 30]\ndepth = 3", "key-unknown", "body.bay.depth"),
        ("at = [0, 0, 30]", "bay-without-pockets", "fabrication.pockets"),
    ],
)
def test_invalid_bay_is_refused(tmp_path, bay, code, key):
    text = (DEVICES / "cube" / "device.toml").read_text("utf-8")
    shutil.copy(DEVICES / "cube" / "cube.py", tmp_path)
    text = text.replace("[material]", f"[body.bay]\n{bay}\n\n[material]", 1)
    (tmp_path / "device.toml").write_text(text.replace("marker_seats = 8", "pockets = false"))
    with raises(DeviceError, code, key=key):
        load_device(tmp_path)


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("pockets = 3", "value-type"),
        ("marker_seats = 2.5", "value-type"),
        ("marker_size = -1", "out-of-range"),
        ("wire_diameter = 2.6", "wire-too-thick"),
        ("strain_relief = 1", "value-type"),
        ("wire_diameter = 0", "out-of-range"),
        ("limit_cut = true", "key-unknown"),
    ],
)
def test_invalid_setting_is_refused(tmp_path, line, code):
    text = (DEVICES / "cube" / "device.toml").read_text("utf-8")
    shutil.copy(DEVICES / "cube" / "cube.py", tmp_path)
    (tmp_path / "device.toml").write_text(text.replace("marker_seats = 8", line))
    with raises(DeviceError, code, key=f"fabrication.{line.split()[0]}"):
        load_device(tmp_path)
