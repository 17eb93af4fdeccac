"""Commands of all pages, those for hardware too, exist with the options that are given."""

import re
import shlex

import pytest

from defsense_fab.cli.main import parse
from defsense_fab.core.errors import DefsenseError
from tests.support.commands import all_commands, is_group
from tests.support.places import ROOT

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
GROUPS = {words for words, app in all_commands() if is_group(app)}
_BLOCK = re.compile(r"^ *```\w*\n(.*?)^ *```", re.DOTALL | re.MULTILINE)
_NAMED = re.compile(r"`defsense ([^`]*)`")


def complete_commands(text):
    """Yield the lines of fenced blocks that call `defsense`, with continued lines joined."""
    for block in _BLOCK.findall(text):
        for line in map(str.strip, block.replace("\\\n", " ").splitlines()):
            words = shlex.split(line, comments=True) if line.startswith("defsense ") else []
            if words:
                yield [w for w in words[1 : words.index(">") if ">" in words else None] if w]


def named_commands(text):
    """Yield the commands that sentences name, in full or by their first words."""
    for line in _NAMED.findall(_BLOCK.sub("", text)):
        words = shlex.split(line.partition(">")[0].replace("...", "").replace("[NAME]", ""))
        words = [w for w in words if w != "COMMAND"]
        if tuple(words) not in GROUPS:
            yield words


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_commands_of_the_pages_parse(page):
    text = page.read_text(encoding="utf-8")
    for words in complete_commands(text):
        try:
            parse(words)
        except DefsenseError as error:
            pytest.fail(f"defsense {shlex.join(words)}: {error}")
    for words in named_commands(text):
        try:
            parse(words)
        except DefsenseError as error:
            if error.code != "argument-missing":  # sentences leave out arguments and values
                pytest.fail(f"defsense {shlex.join(words)}: {error}")


def test_pages_have_commands():
    texts = [p.read_text(encoding="utf-8") for p in PAGES]
    assert sum(1 for text in texts for _ in complete_commands(text)) > 50
    assert sum(1 for text in texts for _ in named_commands(text)) > 80
