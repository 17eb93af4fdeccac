"""Help of all commands: examples are complete commands, and texts start with a capital."""

import argparse
import shlex
import subprocess
import sys

import pytest

from defsense_fab.cli.main import make_parser


def parsers(parser):
    """Yield a parser and all parsers of its subcommands."""
    yield parser
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for subparser in action.choices.values():
                yield from parsers(subparser)


ALL = {p.prog: p for p in parsers(make_parser())}
COMMANDS = [name for name, p in ALL.items() if p.get_default("run")]


def test_all_commands_exist():
    assert {"defsense build", "defsense capture camera check"} <= set(COMMANDS)
    assert len(COMMANDS) > 15


@pytest.mark.parametrize("name", COMMANDS)
def test_examples_are_complete_commands(name, monkeypatch, capsys):
    """Also in a narrow terminal, where argparse wraps all other texts."""
    monkeypatch.setenv("COLUMNS", "40")
    with pytest.raises(SystemExit, match="0"):
        make_parser().parse_args([*name.split()[1:], "--help"])
    _, title, rest = capsys.readouterr().out.rpartition("\nexample")
    assert title
    examples = rest.splitlines()[1:]
    assert examples
    for line in examples:
        assert line.startswith(f"  {name} ") or line == f"  {name}"
        options = make_parser().parse_args(shlex.split(line)[1:])
        assert options.run.__module__.startswith("defsense_fab.cli.")


def test_groups_have_no_examples():
    """A group of commands has no examples, except for the whole program."""
    groups = set(ALL) - set(COMMANDS)
    assert groups == {
        "defsense",
        "defsense calibrate",
        "defsense capture",
        "defsense capture camera",
    }
    assert "\nexample:\n  defsense build " in ALL["defsense"].format_help()


@pytest.mark.parametrize("name", ALL)
def test_help_texts_start_with_a_capital_and_have_no_final_stop(name):
    for action in ALL[name]._actions:
        assert (
            action.help is None
            or action.help == argparse.SUPPRESS
            or (action.help[0].isupper() and not action.help.endswith("."))
        ), f"{name} {action.dest}: {action.help}"
        if isinstance(action, argparse._SubParsersAction):
            assert all(choice.help[0].isupper() for choice in action._choices_actions)


def test_program_runs_as_a_module():
    words = [sys.executable, "-m", "defsense_fab", "--version"]
    run = subprocess.run(words, capture_output=True, text=True, check=True)
    assert run.stdout.startswith("defsense-fab ")
