"""Python, and the libraries that the project asks for: their versions, and whether they import."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib import metadata
from typing import TYPE_CHECKING

from ...core.machine.optional_libraries import PROJECT, pip_install
from .finding import Finding, judged
from .isolated import HANGS, call
from .system_libraries import system_command

if TYPE_CHECKING:
    from packaging.requirements import Requirement

#: Modules that are not called as their distribution is.
_MODULES = {
    "libigl": "igl",
    "netgen-mesher": "netgen.meshing",
    "py-lib3mf": "lib3mf",
    "pyserial": "serial",
    "opencv-contrib-python-headless": "cv2",
    "python-rtmidi": "rtmidi",
    "usd-core": "pxr.Usd",
}
#: What the extras are for; of others their name is told.
_FOR = {
    "cadquery": "bodies from CadQuery scripts",
    "exchange": "C3D, Parquet and XDF files",
    "live": "the live view, and outputs to other programs",
    "midi": "MIDI ports",
    "cluster": "studies on a cluster",
    "animation": "recorded animations in USD",
}
#: It finds MKL only by what the solver sets: `kernels.check_solver` tells of it.
_TRIED_ELSEWHERE = {"pypardiso"}
_TOGETHER = 2  # imports at a time


@dataclass(frozen=True)
class _Asked:
    requirement: Requirement
    extra: str  # empty: the core's


def check_python() -> Finding:
    """Its version against `requires-python`."""
    is_ = ".".join(map(str, sys.version_info[:3]))
    try:
        asked = metadata.metadata(PROJECT)["Requires-Python"] or ""
        from packaging.specifiers import SpecifierSet
    except ImportError as error:  # PackageNotFoundError, too
        return judged("python", "Python", False, f"{is_}; {_absent(error)}", command=_INSTALL)
    good = SpecifierSet(asked).contains(is_)
    return judged("python", "Python", good, f"{is_} ({asked} is asked for)",
                  command="" if good else "python3.11 -m venv .venv")  # fmt: skip


#: Brings what is missing of the core.
_INSTALL = pip_install(PROJECT)


def _absent(error: ImportError) -> str:
    if isinstance(error, metadata.PackageNotFoundError):
        return f"{error.name} is not installed as a package, so what it asks for is not known"
    return f"{error}, so versions cannot be compared"


def check_libraries(seconds: float) -> list[Finding]:
    """Each library of the core and of each extra but `dev`. An import may last so many seconds."""
    try:
        asked = list(_asked())
    except ImportError as error:
        return [judged("libraries", "libraries", False, _absent(error), command=_INSTALL)]
    with ThreadPoolExecutor(_TOGETHER) as pool:
        return list(pool.map(lambda one: _check(one, seconds), asked))


def _asked() -> Iterator[_Asked]:
    from packaging.requirements import Requirement

    extras = [e for e in metadata.metadata(PROJECT).get_all("Provides-Extra") or () if e != "dev"]
    for text in metadata.requires(PROJECT) or ():
        one = Requirement(text)
        if one.name in _TRIED_ELSEWHERE or one.name == PROJECT:  # the extra of all extras
            continue
        if one.marker is None or one.marker.evaluate({"extra": ""}):
            yield _Asked(one, "")
            continue
        for extra in extras:
            if one.marker.evaluate({"extra": extra}):
                yield _Asked(one, extra)
                break


def _check(asked: _Asked, seconds: float) -> Finding:
    one, extra = asked.requirement, asked.extra
    needed_for = _FOR.get(extra, f"the extra {extra}") if extra else ""
    asked_for = f"{one.name}{one.specifier}"
    command = pip_install(asked_for)
    try:
        version = metadata.version(one.name)
    except metadata.PackageNotFoundError:
        told, good = "is not installed", False
    else:
        good = one.specifier.contains(version, prereleases=True)
        told = version if good else f"{version} is installed, {one.specifier} is asked for"
        if good:
            module = _MODULES.get(one.name.lower(), one.name.replace("-", "_"))
            trouble = call(__name__, "load", module, seconds=seconds).trouble
            if trouble:
                good, told = False, f"{version}: its import {_as_clause(trouble)}"
                command = system_command(trouble) or pip_install("--force-reinstall", asked_for)
                if trouble.startswith(HANGS):
                    command = f"defsense doctor --timeout {10 * seconds:g}"
    return judged("libraries", one.name, good, told, command=command, needed_for=needed_for)


def _as_clause(trouble: str) -> str:
    return trouble if trouble.startswith((HANGS, "crashes")) else f"fails ({trouble})"


def load(module: str) -> str:
    """Import a module; where it is."""
    return getattr(importlib.import_module(module), "__file__", None) or ""
