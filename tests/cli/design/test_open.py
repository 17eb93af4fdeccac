"""`defsense open` opens the pages of a build."""

import json
import webbrowser

import pytest

from defsense_fab.cli.main import main, run_command
from defsense_fab.core.errors import StorageError
from tests.support.errors import raises


@pytest.fixture
def opened(monkeypatch):
    """Return the addresses that were opened."""
    addresses = []
    monkeypatch.setattr(webbrowser, "open", addresses.append)
    return addresses


@pytest.mark.parametrize(("words", "page"), [([], "report.html"), (["--guide"], "guide.html")])
def test_the_page_of_the_current_folder_is_opened(
    words, page, opened, tmp_path, monkeypatch, capsys
):
    build = tmp_path / "build"
    build.mkdir()
    (build / page).write_text("")
    monkeypatch.chdir(tmp_path)
    assert main(["open", *words, "--json"]) == 0
    assert opened == [(build / page).as_uri()]
    assert json.loads(capsys.readouterr().out) == {"page": opened[0]}


def test_a_device_that_is_not_built_has_no_page(opened, tmp_path):
    with raises(StorageError, "file-not-found"):
        run_command(["open", str(tmp_path)])
    assert not opened
