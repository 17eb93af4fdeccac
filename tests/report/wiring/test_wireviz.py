"""The file for WireViz: it connects what the plan connects, and WireViz draws it."""

from __future__ import annotations

import shutil
import subprocess
import sysconfig
from pathlib import Path

import pytest

from defsense_fab.report.wiring.wireviz import wireviz_file
from tests.report.wiring.plans import CASES, join, nets, plan

KINDS = {"X": "cord", "R": "resistor", "ADS": "ADS1115", "BOARD": "board"}


def find_wireviz():
    """Return the path of the program, next to this Python or elsewhere; None if it is missing."""
    return shutil.which("wireviz", path=sysconfig.get_path("scripts")) or shutil.which("wireviz")


@pytest.mark.parametrize(("board", "converter", "cords"), CASES)
def test_file_connects_what_the_plan_connects(board, converter, cords):
    yaml = pytest.importorskip("yaml")
    wiring = plan(cords, board, converter)
    content = yaml.safe_load(wireviz_file(wiring))
    connectors, used_wires, pairs = content["connectors"], [], []
    for connection in content["connections"]:
        (start, [pin]), (cable, [wire]), (end, [other]) = (
            next(iter(c.items())) for c in connection
        )
        used_wires.append((cable, wire))
        # The pins of a rail are one piece of metal.
        pairs.append(
            tuple(
                (n, 0) if n in ("GROUND", "SUPPLY") else (n, p)
                for n, p in [(start, pin), (end, other)]
            )
        )
    for name, connector in connectors.items():
        pairs += [((name, a), (name, b)) for a, b in connector.get("loops", [])]
    found = set()
    for net in join(pairs):
        terminals = set()
        for name, pin in net:
            if pin:
                letters = name.rstrip("0123456789")
                label = connectors[name]["pinlabels"][pin - 1]
                terminals.add((KINDS[letters], int(name[len(letters) :] or 1), label))
        found.add(frozenset(terminals))
    assert found == nets(wiring)
    wires = [(n, k + 1) for n, c in content["cables"].items() for k in range(c["wirecount"])]
    assert sorted(used_wires) == sorted(wires)


@pytest.mark.parametrize(
    ("board", "converter", "cords"),
    [
        ("nano", "arduino", 1),
        ("nano", "arduino", 3),
        ("esp32", "ads1115", 8),
        ("pico", "ads1115", 16),
    ],
)
def test_wireviz_draws_the_file(board, converter, cords, tmp_path):
    program = find_wireviz()
    if program is None or shutil.which("dot") is None:
        pytest.skip("WireViz or Graphviz is not installed")
    file = tmp_path / "wireviz.yml"
    file.write_text(wireviz_file(plan(cords, board, converter)), encoding="utf-8")
    run = subprocess.run([program, str(file)], capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stderr
    assert (tmp_path / "wireviz.svg").read_text(encoding="utf-8").count("Resistor") == cords
    assert (tmp_path / "wireviz.png").read_bytes().startswith(b"\x89PNG")
    bill = Path(tmp_path / "wireviz.bom.tsv")
    assert "ohm, 1 %" in bill.read_text(encoding="utf-8")
