"""fTetWild in a process of its own: `python -m` this module, with a folder that holds `IN`."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

import numpy as np

from ..child_process import OUT_OF_MEMORY, end_with_parent

IN, OUT = "surface.npz", "mesh.npz"


def main(folder: str) -> None:
    """Read vertices, faces, edge_length (mm) and epsilon; write nodes and tets, or the error,
    or what is missing of fTetWild itself."""
    end_with_parent()
    os.chdir(folder)  # fTetWild leaves a file of its own there
    found: dict[str, Any]
    try:
        import pytetwild
    except ImportError as error:
        np.savez("unfinished.npz", missing=str(error))
        Path("unfinished.npz").replace(OUT)
        return
    with np.load(IN) as given:
        try:
            nodes, tets = pytetwild.tetrahedralize(
                given["vertices"],
                given["faces"],
                edge_length_abs=float(given["edge_length"]),
                epsilon=float(given["epsilon"]),
                num_threads=1,
            )
            found = {"nodes": nodes, "tets": tets}
        except RuntimeError as error:
            found = {"error": str(error)}
        except MemoryError:
            found = {"error": OUT_OF_MEMORY}
    np.savez("unfinished.npz", **found)
    Path("unfinished.npz").replace(OUT)


if __name__ == "__main__":
    main(sys.argv[1])
