"""Writers on a full disk: errors of the system, not of the libraries that write."""

import errno
from pathlib import Path

import build123d as bd
import pytest
import trimesh

from defsense_fab.core.mesh import Surface
from defsense_fab.geometry.kernels import occ
from defsense_fab.geometry.printing.export import write_3mf, write_stl

FULL = Path("/dev/full")
BOX = trimesh.creation.box((10, 20, 30))
SURFACE = Surface(BOX.vertices, BOX.faces)


@pytest.mark.skipif(not FULL.exists(), reason="no /dev/full here")
@pytest.mark.parametrize(
    "write",
    [
        lambda: write_stl(SURFACE, FULL),
        lambda: write_3mf({"box": SURFACE}, FULL, "box"),
        lambda: occ.write_step(bd.Box(10, 20, 30).solid().wrapped, FULL, "box"),
        lambda: occ.write_assembly({"box": bd.Box(1, 2, 3).solid().wrapped}, FULL, "box"),
    ],
    ids=["stl", "3mf", "step", "assembly"],
)
def test_a_full_disk_is_an_error_of_the_system(write):
    with pytest.raises(OSError) as caught:
        write()
    assert caught.value.errno == errno.ENOSPC
