"""The package uses the words of the glossary, and none of those that it replaces."""

import ast
import io
import re
import tokenize

import pytest

from tests.support.places import ROOT

GLOSSARY = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
WORDS = (ROOT / "docs" / "contributing" / "words.md").read_text(encoding="utf-8")
#: Packages whose names and texts are checked: all.
CHECKED = sorted(p.parent.name for p in (ROOT / "defsense_fab").glob("*/__init__.py"))
#: Retired names that are keys of documented files.
SERIALIZED = {
    "core/storage/session_manifest.py": {"begun"},
    "store/mesh.py": {"asked"},
    "training/recordings/session_dataset.py": {"begun"},
}


def section(title):
    text = WORDS.split(f"## {title}\n", 1)[1]
    return text.split("\n## ", 1)[0].split(":\n\n", 1)[1]


NAMES = set(re.findall(r"`([a-z_]+)`", section("Names that are not used")))
PHRASES = [p.strip() for p in section("Phrases that are not used").replace("\n", " ").split(";")]
FORBIDDEN = re.compile(rf"(?<!\w)(?:{'|'.join(map(re.escape, PHRASES))})(?!\w)", re.IGNORECASE)


def names_of(tree):
    """Yield each name that a module binds, with its line."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            yield node.name, node.lineno
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id, node.lineno
        elif isinstance(node, ast.arg):
            yield node.arg, node.lineno


def texts_of(path):
    """Yield each comment and each text of a module, with its line."""
    source = path.read_text(encoding="utf-8")
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type in (tokenize.COMMENT, tokenize.STRING):
            yield " ".join(token.string.replace("#", " ").split()), token.start[0]


def test_the_glossary_has_at_most_80_terms():
    table = GLOSSARY.split("|---|---|\n", 1)[1]
    assert 40 < len(table.splitlines()) <= 80


@pytest.mark.parametrize("package", CHECKED)
def test_no_retired_name_or_phrase_is_used(package):
    found = []
    for path in sorted((ROOT / "defsense_fab" / package).rglob("*.py")):
        place = path.relative_to(ROOT).as_posix()
        tree = ast.parse(path.read_text(encoding="utf-8"))
        allowed = SERIALIZED.get(place.removeprefix("defsense_fab/"), set())
        found += [
            f"{place}:{n}: {name}"
            for name, n in names_of(tree)
            if name.strip("_") in NAMES - allowed
        ]
        found += [
            f"{place}:{n}: {hit[0]}"
            for text, n in texts_of(path)
            if (hit := FORBIDDEN.search(text)) and hit[0] not in allowed
        ]
    assert found == []


def test_retired_names_and_phrases_are_found():
    assert {name for name, _ in names_of(ast.parse("def f(seen): told = seen"))} & NAMES
    assert FORBIDDEN.search("The file is made anew.")
    assert not FORBIDDEN.search("least squares, at most 3, known values")
