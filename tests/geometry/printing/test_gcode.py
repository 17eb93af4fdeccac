"""Beads in G-code of several slicers."""

from __future__ import annotations

import numpy as np
import pytest

from defsense_fab.core.errors import FabricationError
from defsense_fab.geometry.printing.gcode import KINDS, read_beads
from tests.support.trace_block import synthetic_gcode

AREA = np.pi / 4 * 1.75**2  # of the filament, mm^2


def read(folder, text, **options):
    path = folder / "a.gcode"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_beads(path, **options)


def test_dialects_give_the_same_beads(tmp_path):
    beads = [read(tmp_path, synthetic_gcode(d)) for d in ("prusa", "cura", "bambu")]
    for other in beads[1:]:
        assert len(other) == len(beads[0])
        for name in ("start", "end", "width", "height", "volume", "tool", "kind"):
            # Absolute extrusion is rounded to five decimals.
            assert getattr(other, name) == pytest.approx(getattr(beads[0], name), abs=2e-3)
    assert set(np.unique(beads[0].kind)) == {KINDS.index("object"), KINDS.index("tower")}
    assert [b.slicer.split()[0] for b in beads] == [
        "PrusaSlicer",
        "Cura_SteamEngine",
        "BambuStudio",
    ]
    assert [bool(b.warnings) for b in beads] == [False, True, True]


def test_bead_has_the_section_of_its_filament(tmp_path):
    beads = read(tmp_path, ";TYPE:Perimeter\n;HEIGHT:0.2\nM83\nG1 Z0.2\nG1 X10 E0.5\n")
    assert beads.start[0] == pytest.approx([0, 0, 0.1])
    assert beads.end[0] == pytest.approx([10, 0, 0.1])
    assert beads.volume[0] == pytest.approx(0.5 * AREA)
    section = 0.2 * (beads.width[0] - 0.2) + np.pi / 4 * 0.2**2
    assert section * 10 == pytest.approx(beads.volume[0])
    assert beads.line[0] == 5
    thick = read(tmp_path, "G1 Z0.2\nG1 X10 E0.5\n", filament_mm=[2.85])
    assert thick.volume[0] == pytest.approx(0.5 * np.pi / 4 * 2.85**2)


def test_positions_and_extrusions_are_relative_or_absolute(tmp_path):
    text = (
        "M82\nG92 E5\nG1 Z.2\nG1 X10 E6\nG92 E0 X0\nG1 X10 E1\nG91\nG1 X5 E1\nG90\nM83\nG1 X0 E1\n"
    )
    beads = read(tmp_path, text)
    assert beads.start[:, 0] == pytest.approx([0, 10, 20, 25])
    assert beads.end[:, 0] == pytest.approx([10, 20, 25, 10])
    assert beads.volume == pytest.approx(AREA)


def test_retractions_and_wipes_deposit_nothing(tmp_path):
    text = "M83\nG1 Z.2\nG1 X5 E1\nG1 E-2\nG1 X9 E-.5\nG0 X1\nG1 E2.5\nG1 X5 E1\n"
    beads = read(tmp_path, text)
    assert len(beads) == 2
    assert beads.volume == pytest.approx(AREA)


@pytest.mark.parametrize(
    ("move", "length"),
    [
        ("G3 X0 Y10 I-10 J0 E1", np.pi * 5),
        ("G2 X0 Y10 I-10 J0 E1", np.pi * 15),
        ("G3 X0 Y10 R10 E1", np.pi * 5),
        ("G2 X0 Y10 R-10 E1", np.pi * 15),
        ("G2 X10 Y0 I-10 J0 E1", np.pi * 20),
    ],
)
def test_arcs_are_split_into_chords(tmp_path, move, length):
    beads = read(tmp_path, f"M83\nG1 X10 Z.2\n{move}\n")
    assert beads.length.sum() == pytest.approx(length, rel=1e-3)
    assert beads.volume.sum() == pytest.approx(AREA)
    assert np.linalg.norm(beads.start[:, :2], axis=1) == pytest.approx(10, abs=1e-6)


def test_tools_follow_commands_of_several_firmwares(tmp_path):
    moves = ["T1", "T255", "T?", "ACTIVATE_EXTRUDER EXTRUDER=extruder", "N7 T2*33", "T0 ; back"]
    text = "M83\nG1 Z.2\n" + "".join(f"{t}\nG91\nG1 X1 E1\nG90\n" for t in moves)
    assert read(tmp_path, text).tool.tolist() == [1, 1, 1, 0, 2, 0]


def test_kinds_outside_the_object_are_known(tmp_path):
    names = ["Skirt/Brim", "SKIRT", "Brim", "Support material", "SUPPORT-INTERFACE", "Wipe tower"]
    names += ["PRIME-TOWER", "Prime tower", "Custom", "WALL-OUTER", "Overhang wall", "Top surface"]
    text = "M83\nG1 Z.2\n" + "".join(f";TYPE:{n}\nG91\nG1 X1 E1\nG90\n" for n in names)
    kinds = [KINDS[k] for k in read(tmp_path, text).kind]
    assert kinds == [*["skirt"] * 3, *["support"] * 2, *["tower"] * 3, "custom", *["object"] * 3]


@pytest.mark.parametrize(
    ("content", "code", "line"),
    [
        ("solid cube\nfacet normal 0 0 1\n", "not-gcode", 1),
        (b"G1 X1 E1\n\x00\x01", "not-gcode", 2),
        (b"GCDE\x01\x00", "gcode-binary", None),
        ("", "not-gcode", 1),
        ("G28\nG1 X1\n", "gcode-without-extrusion", None),
        ("M83\nG1 X1 E1\nG1 X2..5 E1\n", "gcode-line-invalid", 3),
        ("M83\nG1 X1 E1\nG1 Xinf E1\n", "gcode-line-invalid", 3),
    ],
)
def test_files_that_cannot_be_read_are_errors(tmp_path, content, code, line):
    with pytest.raises(FabricationError) as error:
        read(tmp_path, content)
    assert error.value.code == code
    if line is not None:
        assert error.value.data["line"] == line
