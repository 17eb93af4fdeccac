"""Installing as the guide says: the lock is installed with --no-deps, so nothing else checks it."""

from importlib.metadata import distribution

from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

from tests.support.places import ROOT


def test_every_locked_package_takes_the_first_release_of_python_311():
    lines = (ROOT / "requirements.lock").read_text(encoding="utf-8").splitlines()
    pins = [Requirement(line) for line in lines if line and not line.startswith("#")]
    assert len(pins) > 100
    needs = {p.name: distribution(p.name).metadata.get("Requires-Python") or "" for p in pins}
    # Debian 12 has 3.11.2, Ubuntu's first 3.11 was 3.11.0.
    assert {n: r for n, r in needs.items() if "3.11.0" not in SpecifierSet(r)} == {}
