"""From an empty folder to a device."""

from __future__ import annotations

import threading

import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import StorageError
from defsense_fab.studio.device.body_preview import BodyPreview
from defsense_fab.studio.page import start_page as start_page_module
from defsense_fab.studio.page.start_page import StartPage
from defsense_fab.studio.page.studio import ErrorPage, Studio
from defsense_fab.studio.page.studio_page import StudioPage
from defsense_fab.studio.project.agreement import Agreement
from defsense_fab.workflow.starts.dropped_body import DroppedBody
from tests.conftest import box_surface
from tests.studio.devices import TEXT, write_device
from tests.support.errors import raises

LONG = 60.0


@pytest.fixture
def begin(studio_server, monkeypatch):
    """The studio of a folder; no body is made by itself."""
    monkeypatch.setattr(BodyPreview, "start", lambda *given: None)
    monkeypatch.setattr("defsense_fab.studio.page.studio.limit_uploads", lambda *given: None)
    made = []

    def make(folder):
        made.append(Studio(studio_server, folder, Agreement()))
        return made[-1]

    yield make
    for studio in made:
        studio.close()


def click(handle):
    for told in handle._impl.update_cb:
        told(None)


def test_a_folder_that_is_not_there_becomes_the_device_of_the_gallery(begin, tmp_path):
    folder = tmp_path / "new" / "my-grip"
    studio = begin(folder)
    assert isinstance(studio.page, StartPage)
    studio.poll()
    assert not folder.exists()  # nothing is written before something is chosen
    click(studio.page.buttons["twist-bar"])
    assert isinstance(studio.page, StudioPage)
    assert studio.page.bench.project.device.name == "my-grip"
    assert (
        Agreement().script_to_confirm(load_device(folder).body) is None
    )  # its script is the package's
    assert studio.page.modes["Device"].has_tried_body


def test_programs_that_lay_in_the_folder_are_not_agreed_to_with_the_gallery(begin, tmp_path):
    (tmp_path / "build123d.py").write_text("raise SystemExit\n", encoding="utf-8")
    studio = begin(tmp_path)
    click(studio.page.buttons["bar"])
    asked = Agreement().script_to_confirm(load_device(tmp_path).body)
    assert [name for name, _ in asked.files] == ["bar.py", "build123d.py"]


def test_a_dropped_body_is_asked_its_unit_and_becomes_a_device(begin, tmp_path, monkeypatch):
    scale = 25.4
    surface = box_surface([0, 0, 0], [5, 1, 1])
    body = DroppedBody(b"content", "grip", ".stl", surface, "inch", True, ("closed 1 small holes",))
    monkeypatch.setattr(start_page_module, "load_body_content", lambda name, content: body)
    studio = begin(tmp_path)
    page = studio.page
    page.receive("../grip.stl", b"content")
    assert page.wait(LONG)
    form = page.form
    assert form.panel.visible
    assert "127 × 25.4 × 25.4 mm" in form.size_text.content
    assert form.body.is_doubtful
    assert "closed 1 small holes" in form.size_text.content
    form.choose_unit("cm")
    assert "50 × 10 × 10 mm" in form.size_text.content
    form.choose_unit("inch")
    form.name.value = "My grip"
    form.edge.value = 5.0
    form.create()
    assert isinstance(studio.page, StudioPage)
    device = studio.page.bench.project.device
    assert (device.name, device.body.scale, device.mesh.edge_length) == ("My grip", scale, 5)
    assert (tmp_path / "grip.stl").read_bytes() == b"content"
    assert sorted(p.name for p in tmp_path.iterdir() if p.is_file()) == ["device.toml", "grip.stl"]


def test_what_is_refused_is_told_on_the_page_which_goes_on(begin, tmp_path):
    studio = begin(tmp_path)
    page = studio.page
    page.receive("photo.stl", b"\x89PNG")
    assert page.wait(LONG)
    assert "`photo`" not in page.message.content
    assert "**photo: " in page.message.content
    upload = page.upload
    studio.refuse_upload(None, "<b>huge</b>.stl", "it has 2,048 MB, and 200 MB is the most")
    assert "it has 2,048 MB" in page.message.content
    assert "<b>" not in page.message.content
    assert page.upload is not upload  # viser's button waits for ever
    assert not any(tmp_path.iterdir())
    click(page.buttons["cube"])
    assert isinstance(studio.page, StudioPage)


def test_a_folder_that_cannot_be_written_is_told_and_another_try_is_possible(
    begin, tmp_path, monkeypatch
):
    studio = begin(tmp_path / "new")
    page = studio.page

    def refuse(*given):
        raise StorageError("new: Read-only file system; check the path and permissions")

    with monkeypatch.context() as patch:
        patch.setattr(start_page_module, "create_starting_device", refuse)
        click(page.buttons["bar"])
    assert "Read-only file system" in page.message.content
    assert studio.page is page
    click(page.buttons["bar"])
    assert isinstance(studio.page, StudioPage)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (TEXT.replace('name = "grip"', "name ="), "line 3"),
        (TEXT.replace("edge_length = 6.0", "edge_length = -1"), "device.toml:13"),
        (TEXT.replace("grip.py", "gone.py"), "no such file"),
    ],
)
def test_a_device_that_cannot_be_read_is_told_with_its_line_and_taken_up_once_mended(
    begin, tmp_path, text, said
):
    folder = write_device(tmp_path / "grip")
    (folder / "device.toml").write_text(text)
    studio = begin(folder)
    page = studio.page
    assert isinstance(page, ErrorPage)
    assert said in str(page.error)
    studio.poll()
    assert studio.page is page  # the same trouble is not told again
    (folder / "device.toml").write_bytes(b"\xff\xfe")
    studio.poll()
    assert "not valid TOML" in str(studio.page.error) or "cannot be read" in str(studio.page.error)
    (folder / "device.toml").write_text(TEXT)
    studio.poll()
    assert isinstance(studio.page, StudioPage)


def test_a_device_that_goes_while_it_is_shown_keeps_the_page(begin, tmp_path):
    folder = write_device(tmp_path / "grip")
    studio = begin(folder)
    page = studio.page
    (folder / "device.toml").rename(folder / "away.toml")
    studio.poll()
    assert studio.page is page
    assert page.bench.message_code == "file-unreadable"
    (folder / "away.toml").rename(folder / "device.toml")
    studio.poll()
    assert page.bench.apply.__self__ is page.bench


def test_a_read_only_folder_is_told_before_anything_is_lost(begin, tmp_path, monkeypatch):
    folder = write_device(tmp_path / "grip")

    def refuse(*given):
        raise StorageError("history.jsonl: Read-only file system; check the path and permissions")

    with monkeypatch.context() as patch:
        patch.setattr("defsense_fab.studio.project.history.write_text", refuse)
        studio = begin(folder)
    assert "Read-only file system" in str(studio.page.error)
    studio.poll()
    assert isinstance(studio.page, StudioPage)


@pytest.mark.parametrize("name", [".studio", ".studio/history.jsonl"])
def test_links_that_lead_out_of_the_folder_are_not_written_through(begin, tmp_path, name):
    folder = write_device(tmp_path / "grip")
    outside = tmp_path / "outside"
    if name == ".studio":
        outside.mkdir()
    else:
        (folder / ".studio").mkdir()
        outside.write_text("mine")
    (folder / name).symlink_to(outside)
    studio = begin(folder)
    assert "is a symbolic link" in str(studio.page.error)
    assert not any(outside.iterdir()) if outside.is_dir() else outside.read_text("utf-8") == "mine"
    (folder / name).unlink()
    studio.poll()
    assert isinstance(studio.page, StudioPage)


def test_a_file_is_no_folder(studio_server, tmp_path):
    (tmp_path / "x").touch()
    with raises(StorageError, "not-a-folder"):
        Studio(studio_server, tmp_path / "x", Agreement())


def test_two_browsers_that_begin_at_once_get_one_device(begin, tmp_path):
    studio = begin(tmp_path)
    page = studio.page
    threads = [
        threading.Thread(target=click, args=(page.buttons[name],)) for name in ("bar", "cube")
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(LONG)
    assert isinstance(studio.page, StudioPage)
    assert len(list(tmp_path.glob("*.py"))) == 1
