"""The parts into which a device is cut along its cords."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from ..core.errors import FabricationError, StorageError
from ..core.mesh import Surface
from ..core.prediction import Prediction
from ..core.progress import Progress, silent
from ..core.storage.files import replace_folder
from ..store.manifest import FOLDER, Manifest, load_manifest, load_parts
from .device import table_html
from .given import of_kind, path
from .layout import Layout


@dataclass(frozen=True, repr=False)
class Parts:
    """The parts of a `layout`: their `surfaces` by name, in mm where they belong in the device; the
    `prediction` of the cords as they are built in, errors in mm; the `manifest` of all that is to
    be printed, cut and joined; `warnings`."""

    layout: Layout
    surfaces: Mapping[str, Surface]
    prediction: Prediction | None
    manifest: Manifest
    warnings: tuple[str, ...]

    def save(self, folder: str | Path) -> Path:
        """Write all files of the parts (STL, 3MF, manifest) into a new folder, whole or not
        at all. Raises StorageError."""
        folder = path(folder, "folder", StorageError)
        source = self.layout.poses.device.workspace.folder / "build" / FOLDER
        with replace_folder(folder) as new:
            shutil.copytree(source, new, dirs_exist_ok=True)
        return folder

    def __repr__(self) -> str:
        return f"<Parts of {self.manifest.device!r}: {', '.join(self.surfaces)}>"

    def _repr_html_(self) -> str:
        rows = {
            n: f"{s.volume / 1000:.1f} cm\N{SUPERSCRIPT THREE}" for n, s in self.surfaces.items()
        }
        return table_html(f"Parts of {self.manifest.device}", rows)


def fabricate(layout: Layout, progress: Progress = silent) -> Parts:
    """The parts, as `defsense build` makes them. Raises FabricationError."""
    of_kind(layout, "layout", Layout, FabricationError)
    device = layout.poses.device
    folder = device.workspace.built(device.record, "fabricate", progress)
    manifest = load_manifest(folder)
    return Parts(
        layout, load_parts(folder, manifest), manifest.prediction, manifest, manifest.warnings
    )
