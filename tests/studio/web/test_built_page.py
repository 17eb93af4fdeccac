"""The committed page is what its sources and the Python messages give."""

from __future__ import annotations

import json
import shutil
import subprocess

import msgspec
import pytest

from defsense_fab.studio.messages.catalogue import schema
from tests.support.places import ROOT

SOURCES = ROOT / "defsense_fab" / "studio" / "web"
BUILT = ROOT / "defsense_fab" / "data" / "web"
INSTALL_TIMEOUT_S = 600.0


def run(*words, folder):
    return subprocess.run(
        words,
        cwd=folder,
        capture_output=True,
        encoding="utf-8",
        errors="replace",
        timeout=INSTALL_TIMEOUT_S,
    )


def require_node():
    """Skip the test without npm and the recorded Node, of which a patch version may differ."""
    recorded = (SOURCES / ".node-version").read_text(encoding="utf-8").strip()
    if shutil.which("node") is None or shutil.which("npm") is None:
        pytest.skip(f"Node {recorded} with npm is not installed")
    installed = run("node", "--version", folder=ROOT).stdout.strip().removeprefix("v")
    if installed.split(".")[:2] != recorded.split(".")[:2]:
        pytest.skip(f"Node {recorded} is needed, this is {installed}")


@pytest.fixture(scope="module")
def sources(tmp_path_factory):
    """Return a copy of the sources with their packages."""
    require_node()
    folder = tmp_path_factory.mktemp("front-end") / "defsense_fab" / "studio" / "web"
    shutil.copytree(SOURCES, folder, ignore=shutil.ignore_patterns("node_modules"))
    installed = run("npm", "ci", "--no-audit", "--no-fund", folder=folder)
    # The lock file is at fault, not the network.
    assert "code EUSAGE" not in installed.stderr, installed.stderr
    if installed.returncode != 0:
        lines = [line for line in installed.stderr.splitlines() if line.strip()]
        pytest.skip(f"npm ci failed: {' '.join(lines[:3])}")
    return folder


def test_the_schema_is_that_of_the_messages():
    text = msgspec.json.format(msgspec.json.encode(schema()), indent=1).decode() + "\n"
    assert text == (SOURCES / "protocol.schema.json").read_text(encoding="utf-8")


@pytest.mark.slow
def test_the_types_of_the_page_are_those_of_the_schema(sources):
    types = sources / "src" / "protocol" / "messages.ts"
    types.unlink()
    done = run("npm", "run", "--silent", "protocol", folder=sources)
    assert done.returncode == 0, done.stderr
    assert types.read_bytes() == (SOURCES / "src" / "protocol" / "messages.ts").read_bytes()


@pytest.mark.slow
def test_the_built_page_is_that_of_the_sources(sources):
    done = run("npm", "run", "--silent", "build", folder=sources)
    assert done.returncode == 0, done.stdout + done.stderr
    rebuilt = {p.name: p.read_bytes() for p in (sources / "../../data/web").iterdir()}
    committed = {p.name: p.read_bytes() for p in BUILT.iterdir()}
    assert sorted(rebuilt) == sorted(committed)
    differing = [name for name in rebuilt if rebuilt[name] != committed[name]]
    assert not differing, "run `npm run build` in defsense_fab/studio/web"


def test_the_lock_file_names_no_registry():
    lock = json.loads((SOURCES / "package-lock.json").read_text(encoding="utf-8"))
    assert not [name for name, package in lock["packages"].items() if "resolved" in package]


def test_the_licenses_of_all_packages_in_the_page_are_shipped():
    lock = json.loads((SOURCES / "package-lock.json").read_text(encoding="utf-8"))
    licenses = (BUILT / "LICENSES.txt").read_text(encoding="utf-8")
    for path, package in lock["packages"].items():
        if path and not package.get("dev"):
            name = path.removeprefix("node_modules/")
            assert f"{name} {package['version']}\n" in licenses
    assert licenses.count("Permission is hereby granted, free of charge") == 1 + licenses.count(
        "-" * 80
    )


def test_reports_need_three_only():
    """Chunks of their own would have to be copied into reports, too."""
    assert {p.name for p in BUILT.glob("*.js")} == {"index.js", "report.js", "three.js"}
