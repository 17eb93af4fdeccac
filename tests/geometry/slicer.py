"""What an independent slicer says of exported parts."""

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
        said = subprocess.run(
            ["prusa-slicer", "--info", str(path)], capture_output=True, text=True, check=True
        ).stdout
        assert "manifold = yes" in said
        assert "open_edges" not in said
        assert "facets_reversed" not in said
