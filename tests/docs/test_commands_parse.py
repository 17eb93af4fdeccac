"""Commands of all pages, those for hardware too, exist with the options that are given."""

import re
import shlex
from pathlib import Path

import pytest

from defsense_fab.cli.main import make_parser

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
_BLOCK = re.compile(r"^```\w*\n(.*?)^```", re.DOTALL | re.MULTILINE)


def commands(text):
    """Lines of fenced blocks that call `defsense`, without comments and continued lines joined."""
    for block in _BLOCK.findall(text):
        for line in block.replace("\\\n", " ").splitlines():
            words = shlex.split(line, comments=True) if line.startswith("defsense ") else []
            if words:
                yield words[1:]


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_commands_of_the_pages_parse(page, capsys):
    parser = make_parser()
    for words in commands(page.read_text(encoding="utf-8")):
        try:
            parser.parse_args(words)
        except SystemExit:
            pytest.fail(f"defsense {shlex.join(words)}: {capsys.readouterr().err}")


def test_pages_have_commands():
    assert sum(1 for p in PAGES for _ in commands(p.read_text(encoding="utf-8"))) > 50
