"""Help of all commands: examples are complete commands, and texts start with a verb."""

import shlex
import subprocess
import sys

import pytest

from defsense_fab.cli.app import make_app
from defsense_fab.cli.main import main, parse
from tests.support.commands import all_commands, is_group

COMMANDS = {" ".join(words): app for words, app in all_commands()}
GROUPS = [name for name, app in COMMANDS.items() if is_group(app)]
LEAVES = [name for name in COMMANDS if name not in GROUPS]


def help_of(name, capsys):
    assert main([*name.split(), "--help"]) == 0
    return capsys.readouterr().out


def test_all_commands_exist():
    assert {"build", "capture camera check"} <= set(LEAVES)
    assert len(LEAVES) > 15
    assert set(GROUPS) == {"board", "cache", "calibrate", "capture", "capture camera"}


@pytest.mark.parametrize("name", LEAVES)
def test_examples_are_complete_commands(name, monkeypatch, capsys):
    """Also in a narrow terminal, where all other texts are wrapped."""
    monkeypatch.setenv("COLUMNS", "40")
    _, title, rest = help_of(name, capsys).rpartition("\nExample")
    assert title
    examples = [line for line in rest.splitlines()[1:] if line.strip()]
    assert examples
    for line in examples:
        words = shlex.split(line)
        assert words[: 1 + len(name.split())] == ["defsense", *name.split()]
        run, _ = parse(words[1:])
        assert run.__module__.startswith("defsense_fab.cli.")


@pytest.mark.parametrize("name", LEAVES)
def test_every_argument_has_a_help_text_that_starts_with_a_capital_letter(name):
    app = COMMANDS[name]
    arguments = app.assemble_argument_collection(parse_docstring=True)
    for argument in arguments.filter_by(show=True):
        assert argument.parameter.help, f"{name} {argument.name}"
        assert argument.parameter.help[0].isupper(), f"{name} {argument.name}"


def test_descriptions_in_the_list_of_commands_start_with_a_capital_letter():
    for name, app in COMMANDS.items():
        assert app.help, name
        assert app.help[0].isupper(), name


def test_program_without_a_command_prints_its_help(capsys):
    assert main([]) == 0
    text = capsys.readouterr().out
    for name in (n for n in make_app() if not n.startswith("-")):
        assert f" {name} " in text
    assert "Example:\n  defsense build " in text


def test_program_runs_as_a_module():
    words = [sys.executable, "-m", "defsense_fab", "--version"]
    run = subprocess.run(words, capture_output=True, text=True, check=True)
    assert run.stdout.startswith("defsense-fab ")


@pytest.mark.parametrize("words", [["--help"], ["build", "--help"]])
def test_help_imports_no_numerical_library(words):
    code = (
        "import sys; from defsense_fab.cli.main import main; main(sys.argv[1:]);"
        "sys.stderr.write(' '.join({'numpy', 'scipy', 'cv2'} & set(sys.modules)))"
    )
    run = subprocess.run([sys.executable, "-c", code, *words], capture_output=True)
    assert (run.returncode, run.stderr) == (0, b"")


def test_help_and_version_need_no_heavy_import():
    code = (
        "import sys; from defsense_fab.cli import main as cli\n"
        "try: cli.main(['--help'])\n"
        "except SystemExit: pass\n"
        "print(sorted({'numpy','scipy','build123d','vtk','numba'} & set(sys.modules)))"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    assert out.stdout.splitlines()[-1] == b"[]"
