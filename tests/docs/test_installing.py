"""Installing as the guide says: the lock is installed with --no-deps, so nothing else checks it."""

import tomllib
from importlib.metadata import PackageNotFoundError, distribution

from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name

from tests.support.places import ROOT


def read_lock(name):
    lines = (ROOT / name).read_text(encoding="utf-8").splitlines()
    return [Requirement(line) for line in lines if line and not line.startswith("#")]


def required_packages(requirements):
    """Return the names of all installed packages that requirements and their requirements name."""
    todo, found = [Requirement(r) for r in requirements], set()
    while todo:
        requirement = todo.pop()
        name = canonicalize_name(requirement.name)
        if requirement.marker and not requirement.marker.evaluate({"extra": ""}):
            continue
        try:
            needs = [Requirement(r) for r in distribution(name).requires or ()]
        except PackageNotFoundError:  # OCP without VTK, in whose place the lock has the one with it
            continue
        if name not in found:
            found.add(name)
            todo += needs
    return found


def test_the_core_lock_has_what_a_build_needs():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    direct = [
        *project["project"]["dependencies"],
        "cadquery-ocp",
        *project["build-system"]["requires"],
    ]
    core = {canonicalize_name(p.name): str(p) for p in read_lock("requirements-core.lock")}
    assert core.keys() >= required_packages(direct)
    assert set(core.values()) < {str(p) for p in read_lock("requirements.lock")}


def test_every_locked_package_takes_the_first_release_of_python_311():
    pins = read_lock("requirements.lock")
    assert len(pins) > 100
    needs = {p.name: distribution(p.name).metadata.get("Requires-Python") or "" for p in pins}
    # Debian 12 has 3.11.2, Ubuntu's first 3.11 was 3.11.0.
    assert {n: r for n, r in needs.items() if "3.11.0" not in SpecifierSet(r)} == {}
