"""Where files are that come with the package but are kept elsewhere in the repository, since people
look for them there. `setup.py` copies them into wheels, and reads this file alone for it."""

from __future__ import annotations

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parents[2]
#: Folders of `data/` in an installed package, and of what folder of the repository each is made.
IN_REPOSITORY = {
    "devices": "fixtures/devices",
    "examples": "examples",
    "firmware": "firmware",
}


def package_data(name: str) -> Path:
    """The folder of that name: the package's own where it is installed, else the repository's."""
    inside = _PACKAGE / "data" / name
    return inside if inside.is_dir() else _PACKAGE.parent / IN_REPOSITORY[name]
