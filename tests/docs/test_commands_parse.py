"""Commands of all pages, those for hardware too, exist with the options that are given."""

import re
import shlex
from pathlib import Path

import pytest

from defsense_fab.cli.main import make_parser

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
_BLOCK = re.compile(r"^```\w*\n(.*?)^```", re.DOTALL | re.MULTILINE)
_NAMED = re.compile(r"`defsense ([^`]*)`")


def commands(text):
    """Lines of fenced blocks that call `defsense`, without comments and continued lines joined."""
    for block in _BLOCK.findall(text):
        for line in block.replace("\\\n", " ").splitlines():
            words = shlex.split(line, comments=True) if line.startswith("defsense ") else []
            if words:
                yield words[1:]


def named(text):
    """Commands that sentences name, in full or by their first words."""
    for line in _NAMED.findall(_BLOCK.sub("", text)):
        words = shlex.split(line.partition(">")[0].replace("...", "").replace("[NAME]", ""))
        yield [w for w in words if w != "COMMAND"]


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_commands_of_the_pages_parse(page, capsys):
    parser = make_parser()
    text = page.read_text(encoding="utf-8")
    whole = list(commands(text))
    for words in [*whole, *named(text)]:
        try:
            parser.parse_args(words)
        except SystemExit as ended:
            said = capsys.readouterr().err
            begun = "required" in said or ("expected" in said and words[-1].startswith("-"))
            if ended.code and (words in whole or not begun):
                pytest.fail(f"defsense {shlex.join(words)}: {said}")


def test_pages_have_commands():
    texts = [p.read_text(encoding="utf-8") for p in PAGES]
    assert sum(1 for text in texts for _ in commands(text)) > 50
    assert sum(1 for text in texts for _ in named(text)) > 80
