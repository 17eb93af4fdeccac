"""Checks of Python and of the required libraries, and the licences of installed libraries."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib import metadata
from typing import TYPE_CHECKING

from ...core.errors import StorageError
from ...core.machine.optional_libraries import PROJECT, pip_install
from .checks import HANGS, Finding, call, system_command

if TYPE_CHECKING:
    from packaging.requirements import Requirement

#: Modules whose names differ from those of their distributions.
_MODULES = {
    "libigl": "igl",
    "netgen-mesher": "netgen.meshing",
    "py-lib3mf": "lib3mf",
    "pyserial": "serial",
    "opencv-contrib-python-headless": "cv2",
    "python-rtmidi": "rtmidi",
    "usd-core": "pxr.Usd",
}
#: Uses of the extras.
_EXTRA_USES = {
    "cadquery": "bodies from CadQuery scripts",
    "exchange": "C3D, Parquet and XDF files",
    "live": "outputs to the Lab Streaming Layer",
    "midi": "MIDI ports",
    "cluster": "studies on a cluster",
    "animation": "recorded animations in USD",
}
#: It finds MKL only with settings of the solver, and is checked by `machine.check_solver`.
_CHECKED_ELSEWHERE = {"pypardiso"}
PARALLEL_IMPORTS = 2
TIMEOUT_FACTOR = 10  # of the suggested time limit for a slow import
UNKNOWN = "not stated in its metadata"
_INSTALL = pip_install(PROJECT)
_NO_METADATA = f"{PROJECT} is not installed as a package, so its requirements are unknown"


@dataclass(frozen=True)
class RequiredLibrary:
    """A requirement of the project.

    Attributes:
        requirement: Name and versions.
        extra: The extra that requires it; empty for the core.
    """

    requirement: Requirement
    extra: str


def check_python() -> Finding:
    """Check the version of Python."""
    from packaging.specifiers import SpecifierSet

    version = ".".join(map(str, sys.version_info[:3]))
    try:
        required = metadata.metadata(PROJECT)["Requires-Python"] or ""
    except metadata.PackageNotFoundError:
        return Finding("python", "Python", False, f"{version}; {_NO_METADATA}", _INSTALL)
    is_good = SpecifierSet(required).contains(version)
    command = "" if is_good else "python3.11 -m venv .venv"
    return Finding("python", "Python", is_good, f"{version} ({required} is required)", command)


def check_libraries(seconds: float) -> list[Finding]:
    """Check each library of the core and of each extra but `dev`.

    Args:
        seconds: Time limit of an import, s.
    """
    try:
        libraries = list(_list_requirements())
    except metadata.PackageNotFoundError:
        return [Finding("libraries", "libraries", False, _NO_METADATA, _INSTALL)]
    with ThreadPoolExecutor(PARALLEL_IMPORTS) as pool:
        return list(pool.map(lambda library: check_library(library, seconds), libraries))


def _list_requirements() -> Iterator[RequiredLibrary]:
    from packaging.requirements import Requirement

    extras = [e for e in metadata.metadata(PROJECT).get_all("Provides-Extra") or () if e != "dev"]
    for text in metadata.requires(PROJECT) or ():
        requirement = Requirement(text)
        # The extra `all` requires the project itself.
        if requirement.name in _CHECKED_ELSEWHERE or requirement.name == PROJECT:
            continue
        marker = requirement.marker
        if marker is None or marker.evaluate({"extra": ""}):
            yield RequiredLibrary(requirement, "")
            continue
        for extra in extras:
            if marker.evaluate({"extra": extra}):
                yield RequiredLibrary(requirement, extra)
                break


def check_library(library: RequiredLibrary, seconds: float) -> Finding:
    """Check that a library is installed in a required version and can be imported.

    Args:
        library: The library.
        seconds: Time limit of its import, s.
    """
    requirement, extra = library.requirement, library.extra
    use = _EXTRA_USES.get(extra, f"the extra {extra}") if extra else ""
    specification = f"{requirement.name}{requirement.specifier}"

    def finding(is_good: bool, message: str, command: str = "") -> Finding:
        return Finding("libraries", requirement.name, is_good, message, command, use)

    install = pip_install(specification)
    try:
        version = metadata.version(requirement.name)
    except metadata.PackageNotFoundError:
        return finding(False, "is not installed", install)
    if not requirement.specifier.contains(version, prereleases=True):
        message = f"{version} is installed, {requirement.specifier} is required"
        return finding(False, message, install)
    module = _MODULES.get(requirement.name.lower(), requirement.name.replace("-", "_"))
    failure = call(__name__, "import_module", module, seconds=seconds).failure
    if not failure:
        return finding(True, version)
    command = system_command(failure) or pip_install("--force-reinstall", specification)
    if failure.startswith(HANGS):
        command = f"defsense doctor --timeout {TIMEOUT_FACTOR * seconds:g}"
    return finding(False, f"{version}: its import fails ({failure})", command)


def import_module(name: str) -> str:
    """Import a module; return its file."""
    return getattr(importlib.import_module(name), "__file__", None) or ""


@dataclass(frozen=True)
class Licence:
    """The licence of a distribution, or of a library in the firmware's images.

    Attributes:
        name: Its name.
        version: Its version.
        licence: Its licence, as its metadata or its source state it.
    """

    name: str
    version: str
    licence: str


#: Libraries that are compiled into the images of the firmware (firmware/images/README.md).
FIRMWARE_LICENCES = (
    Licence("firmware: ArduinoCore-avr", "1.8.7", "LGPL-2.1-or-later"),
    Licence("firmware: avr-libc", "2.0.0", "BSD-3-Clause"),
    Licence("firmware: libgcc", "5.4.0", "GPL-3.0-or-later WITH GCC-exception-3.1"),
)


def installed_licences() -> list[Licence]:
    """Return the licences of the project's installed dependencies, direct and indirect, by name.

    The extra `dev` is left out. The libraries in the images of the firmware follow.

    Raises:
        StorageError: The project is not installed as a package (`package-not-installed`).
    """
    from packaging.requirements import Requirement
    from packaging.utils import canonicalize_name

    pending: list[tuple[str, tuple[str, ...]]] = [(PROJECT, ("",))]
    visited_extras: dict[str, set[str]] = {}
    licences: dict[str, Licence] = {}
    while pending:
        name, extras = pending.pop()
        key = str(canonicalize_name(name))
        new = set(extras) - visited_extras.get(key, set())
        if not new:
            continue
        visited_extras.setdefault(key, set()).update(new)
        try:
            distribution = metadata.distribution(name)
        except metadata.PackageNotFoundError:
            if name == PROJECT:
                raise StorageError(
                    f"{PROJECT} is not installed as a package, so its dependencies are unknown",
                    code="package-not-installed",
                    action="Install it with pip",
                ) from None
            continue
        package = distribution.metadata
        if name == PROJECT:
            new |= {e for e in package.get_all("Provides-Extra") or () if e != "dev"}
        else:
            licence = read_licence(package)
            licences[key] = Licence(distribution.name, distribution.version, licence)
        pending += [
            (r.name, ("", *r.extras))
            for r in map(Requirement, distribution.requires or ())
            if r.marker is None or any(r.marker.evaluate({"extra": e}) for e in new)
        ]
    return [*(licences[key] for key in sorted(licences)), *FIRMWARE_LICENCES]


def read_licence(package: metadata.PackageMetadata) -> str:
    """Return License-Expression, else the classifiers, else the first line of License."""
    if expression := package.get_all("License-Expression"):
        return str(expression[0])
    classifiers = [
        c.rpartition(" :: ")[2]
        for c in package.get_all("Classifier") or ()
        if c.startswith("License :: ") and c != "License :: OSI Approved"
    ]
    if classifiers:
        return ", ".join(classifiers)
    text = str((package.get_all("License") or [""])[0]).strip()
    return text.splitlines()[0] if text else UNKNOWN
