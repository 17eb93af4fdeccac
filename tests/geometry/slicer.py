"""Check exported parts with an independent slicer."""

import re
import shutil
import subprocess

import pytest

# What the guide advises for `fdm-tpu`: three walls, solid, layers of 0.2 mm, about 25 mm/s.
SOLID_TPU = {
    "nozzle-diameter": "0.4",
    "layer-height": "0.2",
    "extrusion-width": "0.4",
    "first-layer-extrusion-width": "0.4",
    "perimeters": "3",
    "fill-density": "100%",
    "fill-pattern": "rectilinear",
    "perimeter-speed": "25",
    "external-perimeter-speed": "20",
    "small-perimeter-speed": "20",
    "infill-speed": "30",
    "solid-infill-speed": "30",
    "top-solid-infill-speed": "25",
    "first-layer-speed": "15",
    "gap-fill-speed": "20",
}


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


def estimate_hours(path, folder, *options):
    """Slice a file as the guide advises for soft filament, and return the slicer's own estimate of
    the printing time, h."""
    profile = [f"--{name}={value}" for name, value in SOLID_TPU.items()]
    gcode = slice_(path, folder, *profile, *options).read_text("utf-8")
    time = re.search(r"estimated printing time \(normal mode\) = (.*)", gcode)[1]
    hours_of_unit = {"d": 24.0, "h": 1.0, "m": 1 / 60, "s": 1 / 3600}
    return sum(int(n) * hours_of_unit[unit] for n, unit in re.findall(r"(\d+)([dhms])", time))
