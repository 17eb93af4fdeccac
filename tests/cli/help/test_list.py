"""`defsense list` shows what `device.toml` can name."""

import json

import pytest

from defsense_fab.cli.main import main, run_command
from defsense_fab.core.device.catalogues import CATALOGUES
from defsense_fab.core.errors import DeviceError
from tests.support.errors import raises


@pytest.mark.parametrize("kind", CATALOGUES)
def test_every_row_is_listed_with_its_key_numbers_also_in_a_narrow_terminal(
    kind, capsys, monkeypatch
):
    monkeypatch.setenv("COLUMNS", "80")
    assert main(["list", kind]) == 0
    out = capsys.readouterr().out
    for name, row in CATALOGUES[kind].rows().items():
        (line,) = (line for line in out.splitlines() if line.startswith(f"{name} "))
        numbers = [row[c.name] for c in CATALOGUES[kind].columns if c.name != "processes"]
        assert all(number in line for number in numbers)


def test_all_numbers_and_the_source_of_a_row_are_shown(capsys):
    assert main(["list", "printers", "fdm-tpu", "--json"]) == 0
    row = json.loads(capsys.readouterr().out)
    assert row == CATALOGUES["printers"].rows()["fdm-tpu"]
    assert row["source"]
    assert main(["list", "printers", "fdm-tpu"]) == 0
    assert row["source"] in capsys.readouterr().out


def test_the_lists_are_listed(capsys):
    assert main(["list", "--json"]) == 0
    counts = json.loads(capsys.readouterr().out)
    assert counts == {kind: len(c.rows()) for kind, c in CATALOGUES.items()}


def test_an_unknown_name_is_refused():
    with raises(DeviceError, "unknown-row"):
        run_command(["list", "materials", "ninjaflx"])
