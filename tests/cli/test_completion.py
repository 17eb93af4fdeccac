"""Completions that a shell shows."""

import os
import shlex
import shutil
import subprocess
import sys

import pytest

bash = pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    """Return an environment in which `defsense` is on PATH."""
    folder = tmp_path_factory.mktemp("bin")
    program = folder / "defsense"
    program.write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} -m defsense_fab "$@"\n')
    program.chmod(0o755)
    return os.environ | {"PATH": f"{folder}:{os.environ['PATH']}"}


@pytest.fixture(scope="module")
def script(environment):
    return subprocess.run(
        ["defsense", "completion", "bash"], env=environment, check=True, capture_output=True
    ).stdout.decode()


@bash
@pytest.mark.parametrize(
    ("line", "completions"),
    [
        ("defsense bu", ["build"]),
        ("defsense build device --sch", ["--scheduler"]),
        ("defsense completion z", ["zsh"]),
        ("defsense new x --cord rubber-1", ["rubber-1.7mm"]),
        ("defsense new x --material dragon-skin-2", ["dragon-skin-20"]),
        ("defsense new x --poses bend,t", ["bend,twist"]),
        ("defsense new x --body b", ["bar", "blob", "body.stl"]),
        ("defsense new x --units i", ["inch"]),
        ("defsense build d", ["device/"]),
        ("defsense build de", ["device/"]),
        ("defsense modes device/ --fixed base --set a", []),
    ],
)
def test_bash_completes_words(line, completions, script, environment, tmp_path):
    (tmp_path / "body.stl").touch()
    (tmp_path / "device").mkdir()
    (tmp_path / "device" / "device.toml").touch()
    (tmp_path / "docs").mkdir()  # not a device
    ask = f"""
        eval "$SCRIPT"
        COMP_WORDS=({line}); COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1))
        $(complete -p defsense | sed 's/.*-F //; s/ .*//') 2>&1
        printf '%s\\n' "${{COMPREPLY[@]}}"
    """
    run = subprocess.run(
        ["bash", "-c", ask],
        cwd=tmp_path,
        env=environment | {"SCRIPT": script},
        capture_output=True,
        text=True,
        check=True,
    )
    assert run.stdout.split() == completions


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_scripts_of_other_shells_are_valid(shell, environment):
    if shutil.which(shell) is None:
        pytest.skip(f"needs {shell}")
    text = subprocess.run(
        ["defsense", "completion", shell], env=environment, check=True, capture_output=True
    ).stdout
    subprocess.run([shell, "-n"], input=text, check=True)


def test_completion_imports_no_numerical_library(environment):
    code = (
        "import sys; from defsense_fab.cli.main import main; main(sys.argv[1:]);"
        "sys.stderr.write(' '.join({'numpy', 'scipy', 'cv2'} & set(sys.modules)))"
    )
    words = ["__complete", "new", "x", "--body", "b"]
    run = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True)
    assert (run.returncode, run.stderr) == (0, "")
    assert {"bar", "blob"} <= set(run.stdout.split())
