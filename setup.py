"""What pyproject.toml cannot say: the package carries devices, examples and firmware that lie
elsewhere in the repository. Links would do on Linux; on Windows they are checked out as text."""

import runpy
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

PACKAGE = Path("defsense_fab")
KINDS = {".toml", ".py", ".stl", ".md", ".png", ".ino", ".h", ".c", ".cpp", ".properties"}


def carried(name, folder):
    """Files of a folder: devices that have a picture beside them, examples that are experiments,
    and all of the firmware, without what was built there."""
    if name == "firmware":
        found = folder.rglob("*")
    elif name == "devices":
        found = (f for p in folder.glob("*.png") for f in (p, *p.with_suffix("").iterdir()))
    else:
        found = (f for e in folder.glob("*/experiment.toml") for f in e.parent.iterdir())
    return sorted(f for f in found if f.is_file() and f.suffix in KINDS)


def copies():
    """Each file, and where the package has it."""
    places = runpy.run_path(str(PACKAGE / "core" / "storage" / "package_data.py"))["IN_REPOSITORY"]
    for name, folder in places.items():
        for file in carried(name, Path(folder)):
            yield file, PACKAGE / "data" / name / file.relative_to(folder)


class BuildWithData(build_py):
    """Copies them into what becomes the wheel."""

    def run(self):
        super().run()
        if not self.editable_mode:  # there the repository's are used
            for file, place in copies():
                target = Path(self.build_lib, place)
                self.mkpath(str(target.parent))
                self.copy_file(str(file), str(target))


setup(cmdclass={"build_py": BuildWithData})
