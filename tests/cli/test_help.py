"""The examples that a command's help ends with are whole commands, one a line."""

import argparse
import shlex

import pytest

from defsense_fab.cli.main import make_parser


def parsers(parser):
    """This parser and all below it."""
    yield parser
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for below in action.choices.values():
                yield from parsers(below)


ALL = {p.prog: p for p in parsers(make_parser())}
COMMANDS = [name for name, p in ALL.items() if p.get_default("run")]


def test_all_commands_are_there():
    assert {"defsense build", "defsense capture camera check"} <= set(COMMANDS)
    assert len(COMMANDS) > 15


@pytest.mark.parametrize("name", COMMANDS)
def test_examples_can_be_copied(name, monkeypatch, capsys):
    """In a narrow terminal too, where argparse wraps all else."""
    monkeypatch.setenv("COLUMNS", "40")
    with pytest.raises(SystemExit, match="0"):
        make_parser().parse_args([*name.split()[1:], "--help"])
    _, title, below = capsys.readouterr().out.rpartition("\nexample")
    assert title
    examples = below.splitlines()[1:]
    assert examples
    for line in examples:
        assert line.startswith(f"  {name} ") or line == f"  {name}"
        options = make_parser().parse_args(shlex.split(line)[1:])
        assert options.run.__module__.startswith("defsense_fab.cli.")


def test_no_group_hides_examples():
    """A group of commands has none of its own, but for the first."""
    groups = set(ALL) - set(COMMANDS)
    assert groups == {
        "defsense",
        "defsense calibrate",
        "defsense capture",
        "defsense capture camera",
    }
    assert "\nexample:\n  defsense build " in ALL["defsense"].format_help()
