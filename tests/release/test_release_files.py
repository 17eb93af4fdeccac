"""Version, changelog and citation agree, and follow docs/contributing/release.md."""

from __future__ import annotations

import re

from defsense_fab.core.version import __version__
from tests.support.places import ROOT


def _read(name):
    return (ROOT / name).read_text(encoding="utf-8")


def test_version_changelog_and_citation_agree():
    releases = re.findall(
        r"^## (\S+) \((unreleased|\d{4}-\d\d-\d\d)\)$", _read("CHANGELOG.md"), re.M
    )
    assert len(releases) == len(re.findall(r"^## ", _read("CHANGELOG.md"), re.M))
    numbers = [tuple(map(int, number.split("."))) for number, _ in releases]
    assert numbers == sorted(set(numbers), reverse=True)
    assert "unreleased" not in dict(releases[1:]).values()
    number, date = releases[0]
    assert number == __version__
    citation = _read("CITATION.cff")
    assert re.findall(r"^version: (.+)$", citation, re.M) == [__version__]
    assert re.findall(r"^date-released: (.+)$", citation, re.M) == (
        [] if date == "unreleased" else [date]
    )
    assert re.search(r'^license = "Apache-2.0"$', _read("pyproject.toml"), re.M)
    assert re.search(r"^license: Apache-2.0$", citation, re.M)


def test_changelog_has_the_sections_of_its_rule():
    (rule,) = re.findall(
        r"sections by task.*?left out", _read("docs/contributing/release.md"), re.S
    )
    known = ["To do when you update", *re.findall(r"\*([^*]+)\*", rule)]
    for release in re.split(r"^## .+$", _read("CHANGELOG.md"), flags=re.M)[1:]:
        lead, *sections = re.split(r"^### (.+)$", release, flags=re.M)
        names, texts = sections[::2], sections[1::2]
        assert not lead.strip(), "a change stands in no section"
        assert names == sorted(names, key=known.index)
        assert len(set(names)) == len(names)
        for text in texts:
            lines = [line for line in text.splitlines() if line]
            assert lines[0].startswith("- ")
            assert all(line.startswith(("- ", "  ")) for line in lines)
