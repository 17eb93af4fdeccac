"""Check exported parts with an independent slicer."""

import shutil
import subprocess

import pytest


def accept(folder):
    """Every STL in the folder is closed and outward for prusa-slicer, where it is installed. It
    exits with 0 for any mesh: what it prints counts."""
    if shutil.which("prusa-slicer") is None:
        pytest.skip("prusa-slicer is not installed")
    paths = sorted(folder.glob("*.stl"))
    assert paths
    for path in paths:
        output = subprocess.run(
            ["prusa-slicer", "--info", str(path)], capture_output=True, text=True, check=True
        ).stdout
        assert "manifold = yes" in output
        assert "open_edges" not in output
        assert "facets_reversed" not in output


def slice_(path, folder, *options):
    """Slice a file on a bed that holds it, and return the path of the G-code; the slicer's word is
    its exit code."""
    if shutil.which("prusa-slicer") is None:
        pytest.skip("prusa-slicer is not installed")
    out = folder / f"{path.stem}.gcode"
    # Seams that hide in corners would be three quarters of the time.
    process = subprocess.run(
        ["prusa-slicer", "-g", "--dont-arrange", "--bed-shape", "0x0,220x0,220x220,0x220",
         "--seam-position", "rear", *options, "--output", str(out), str(path)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert process.returncode == 0, process.stderr
    assert out.stat().st_size > 10_000
    return out
