"""What pyproject.toml cannot say: flags of the C compiler, and that the package carries devices,
examples and firmware that lie elsewhere in the repository. Links would do on Linux; on Windows they
are checked out as text."""

import runpy
from pathlib import Path

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext
from setuptools.command.build_py import build_py

PACKAGE = Path("defsense_fab")
KINDS = {".toml", ".py", ".stl", ".md", ".png", ".ino", ".h", ".c", ".cpp", ".properties", ".hex"}


def carried(name, folder):
    """Files of a folder: devices that have a picture beside them, examples that are experiments,
    and all of the firmware, without what was built there."""
    if name == "arduino":
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


class BuildKernels(build_ext):
    """Compiles `kernels/`, with flags under which all processors compute the same numbers."""

    def build_extensions(self):
        if self.compiler.compiler_type == "msvc":
            flags = ["/O2", "/fp:precise", "/std:c11"]
        else:
            flags = [
                "-O3",
                "-g0",
                "-std=gnu99",
                "-ffp-contract=off",
                "-fno-math-errno",
                "-fno-trapping-math",
            ]
        for extension in self.extensions:
            extension.extra_compile_args = flags
        super().build_extensions()


# The stable interface of Python 3.11, the first one with buffers: one wheel for all Pythons.
KERNELS = Extension(
    "defsense_fab.core.machine.kernels",
    sorted(p.as_posix() for p in Path("kernels").glob("*.c")),
    depends=["kernels/kernels.h", "kernels/cords.h", "setup.py"],
    define_macros=[("Py_LIMITED_API", "0x030B0000")],
    py_limited_api=True,
)

setup(
    cmdclass={"build_py": BuildWithData, "build_ext": BuildKernels},
    ext_modules=[KERNELS],
    options={"bdist_wheel": {"py_limited_api": "cp311"}},
)
