"""3MF files with extruders for several slicers."""

from __future__ import annotations

import re
import subprocess
import zipfile

import lib3mf
import numpy as np
import pytest

from defsense_fab.core.errors import FabricationError
from defsense_fab.geometry.printing import slicer_settings
from defsense_fab.geometry.printing.slicer_files import (
    WRITERS,
    ColoredSolid,
    write_bambu_3mf,
    write_prusa_3mf,
)
from defsense_fab.geometry.printing.slicer_settings import (
    TraceSettings,
    format_prusa_settings,
    slice_with_prusa,
    write_prusa_settings,
)
from tests.conftest import box_surface
from tests.support.trace_block import block_solids


def two_boxes():
    body, trace = box_surface([0, 0, 0], [20, 10, 2]), box_surface([2, 4, 2], [18, 6, 2.8])
    return [ColoredSolid("body & <skin>", body, 1), ColoredSolid("trace", trace, 2, True)]


def read_meshes(path):
    """Return the meshes of a file by name, read strictly by lib3mf."""
    model = lib3mf.get_wrapper().CreateModel()
    reader = model.QueryReader("3mf")
    reader.SetStrictModeActive(True)
    reader.ReadFromFile(str(path))
    assert reader.GetWarningCount() == 0
    meshes, found = model.GetMeshObjects(), {}
    while meshes.MoveNext():
        mesh = meshes.GetCurrentMeshObject()
        assert mesh.IsManifoldAndOriented()
        vertices = np.array([list(v.Coordinates) for v in mesh.GetVertices()])
        faces = np.array([list(t.Indices) for t in mesh.GetTriangleIndices()])
        found[mesh.GetName()] = vertices[faces]
    return found


@pytest.mark.parametrize("family", WRITERS)
def test_files_are_read_back_and_have_the_same_bytes(tmp_path, family):
    solids = two_boxes()
    for name in ("a.3mf", "b.3mf"):
        WRITERS[family](solids, tmp_path / name, "block")
    assert (tmp_path / "a.3mf").read_bytes() == (tmp_path / "b.3mf").read_bytes()
    meshes = read_meshes(tmp_path / "a.3mf")
    expected = {s.name: s.surface.vertices[s.surface.faces] for s in solids}
    if family == "prusa":
        expected = {"block": np.concatenate(list(expected.values()))}
    assert set(meshes) == set(expected)
    for name, corners in expected.items():
        assert meshes[name] == pytest.approx(corners, abs=2e-6)


def test_volumes_of_prusa_are_ranges_of_triangles(tmp_path):
    write_prusa_3mf(two_boxes(), tmp_path / "a.3mf", "block")
    text = zipfile.ZipFile(tmp_path / "a.3mf").read("Metadata/Slic3r_PE_model.config").decode()
    assert re.findall(r'firstid="(\d+)" lastid="(\d+)"', text) == [("0", "11"), ("12", "23")]
    assert re.findall(r'key="extruder" value="(\d)"', text) == ["1", "2"]
    assert text.count('key="fill_density" value="100%"') == 1


def test_prusa_opens_the_file_with_the_settings_in_it(tmp_path):
    text = format_prusa_settings(TraceSettings())
    write_prusa_3mf(two_boxes(), tmp_path / "a.3mf", "block", text)
    lines = zipfile.ZipFile(tmp_path / "a.3mf").read("Metadata/Slic3r_PE.config").decode()
    assert [line.removeprefix("; ") for line in lines.splitlines()] == text.splitlines()
    write_prusa_3mf(two_boxes(), tmp_path / "b.3mf", "block")
    assert "Metadata/Slic3r_PE.config" not in zipfile.ZipFile(tmp_path / "b.3mf").namelist()


def test_parts_of_bambu_are_the_components(tmp_path):
    write_bambu_3mf(two_boxes(), tmp_path / "a.3mf", "block")
    archive = zipfile.ZipFile(tmp_path / "a.3mf")
    model = archive.read("3D/3dmodel.model").decode()
    settings = archive.read("Metadata/model_settings.config").decode()
    components = re.findall(r'<component objectid="(\d+)"', model)
    assert re.findall(r'<part id="(\d+)"', settings) == components == ["1", "2"]
    assert re.findall(r'<item objectid="(\d+)"', model) == ["3"]
    assert re.findall(r'<object id="(\d+)"', settings) == ["3"]
    parts = settings.split("<part ")[1:]
    assert [re.search(r'key="extruder" value="(\d)"', p)[1] for p in parts] == ["1", "2"]
    assert not any("project_settings" in name for name in archive.namelist())


@pytest.mark.parametrize(
    ("solids", "code"),
    [
        ([], "no-solids"),
        ([ColoredSolid("a", box_surface([0, 0, 0], [1, 1, 1]), 0)], "extruder-invalid"),
        ([ColoredSolid("a", box_surface([0, 0, 0], [1, 1, 1]), 1)] * 2, "solid-name-repeated"),
    ],
)
@pytest.mark.parametrize("family", WRITERS)
def test_invalid_solids_are_errors(tmp_path, family, solids, code):
    with pytest.raises(FabricationError) as error:
        WRITERS[family](solids, tmp_path / "a.3mf", "block")
    assert error.value.code == code


def test_missing_slicer_is_an_error(tmp_path):
    with pytest.raises(FabricationError) as error:
        slice_with_prusa(tmp_path / "a.3mf", tmp_path / "a.ini", tmp_path / "a.gcode", "no-slicer")
    assert error.value.code == "slicer-missing"


@pytest.mark.parametrize(
    ("script", "code"),
    [
        ("echo bad model >&2; exit 1", "slicing-failed"),
        ("exit 0", "slicing-failed"),
        ('for a in "$@"; do case $a in *.gcode) o=$a; esac; done; echo "$V" > $o', None),
    ],
)
def test_failures_and_other_versions_of_the_slicer(tmp_path, script, code, monkeypatch):
    program = tmp_path / "slicer"
    program.write_text(f"#!/bin/sh\n{script}\n")
    program.chmod(0o755)
    files = tmp_path / "a.3mf", tmp_path / "a.ini", tmp_path / "a.gcode"
    if code is not None:
        with pytest.raises(FabricationError) as error:
            slice_with_prusa(*files, str(program))
        assert error.value.code == code
        return
    for version, count in ((slicer_settings.CHECKED_VERSION, 0), ("2.9.1", 1)):
        monkeypatch.setenv("V", f"; generated by PrusaSlicer {version}+x86 on 2026-01-01")
        assert len(slice_with_prusa(*files, str(program))) == count


@pytest.mark.slow
def test_prusa_slicer_reads_every_solid_as_closed(tmp_path):
    import shutil

    if shutil.which("prusa-slicer") is None:
        pytest.skip("prusa-slicer is not installed")
    write_prusa_3mf(block_solids(), tmp_path / "a.3mf", "block")
    write_prusa_settings(TraceSettings(), tmp_path / "a.ini")
    command = ["prusa-slicer", "--info", str(tmp_path / "a.3mf")]
    text = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert "manifold = yes" in text
    assert "open_edges" not in text
