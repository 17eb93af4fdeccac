"""The start page of an empty folder, and devices that cannot be read."""

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
from defsense_fab.workflow.starts.body_file import BodyFile
from tests.conftest import box_surface
from tests.studio.devices import TEXT, click, write_device
from tests.support.errors import raises

TIMEOUT_S = 600.0


@pytest.fixture
def open_studio(studio_server, monkeypatch):
    """Return a function that opens the studio of a folder; no body is made automatically."""
    monkeypatch.setattr(BodyPreview, "start", lambda *_: None)
    monkeypatch.setattr("defsense_fab.studio.page.studio.UploadLimit", lambda *_: None)
    studios = []

    def open_folder(folder):
        studios.append(Studio(studio_server, folder, Agreement()))
        return studios[-1]

    yield open_folder
    for studio in studios:
        studio.close()


def test_a_missing_folder_becomes_a_device_of_the_gallery(open_studio, tmp_path):
    folder = tmp_path / "new" / "my-grip"
    studio = open_studio(folder)
    assert isinstance(studio.page, StartPage)
    studio.poll()
    assert not folder.exists()  # nothing is written before the user chooses
    click(studio.page.buttons["twist-bar"])
    assert isinstance(studio.page, StudioPage)
    assert studio.page.bench.project.device.name == "my-grip"
    body = load_device(folder).body
    assert Agreement().script_to_confirm(body) is None  # the script of the package is trusted
    assert studio.page.modes["Device"].has_tried_body


def test_other_programs_in_the_folder_need_an_agreement(open_studio, tmp_path):
    (tmp_path / "build123d.py").write_text("raise SystemExit\n", encoding="utf-8")
    studio = open_studio(tmp_path)
    click(studio.page.buttons["bar"])
    script = Agreement().script_to_confirm(load_device(tmp_path).body)
    assert [name for name, _ in script.files] == ["bar.py", "build123d.py"]


def test_an_uploaded_body_with_its_unit_becomes_a_device(open_studio, tmp_path, monkeypatch):
    scale = 25.4
    surface = box_surface([0, 0, 0], [5, 1, 1])
    body = BodyFile(b"content", "grip", ".stl", surface, "inch", True, ("closed 1 small holes",))
    monkeypatch.setattr(start_page_module, "load_body_content", lambda name, content: body)
    studio = open_studio(tmp_path)
    page = studio.page
    page.receive("../grip.stl", b"content")
    assert page.wait(TIMEOUT_S)
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


@pytest.fixture
def uploaded_form(open_studio, tmp_path, monkeypatch):
    """Return a function that uploads a box in a file and returns the studio and the form."""

    def upload(suffix=".stl"):
        surface = box_surface([0, 0, 0], [5, 1, 2])
        body = BodyFile(b"content", "grip", suffix, surface, "inch", suffix == ".stl", ())
        monkeypatch.setattr(start_page_module, "load_body_content", lambda name, content: body)
        studio = open_studio(tmp_path)
        studio.page.receive("grip" + suffix, b"content")
        assert studio.page.wait(TIMEOUT_S)
        return studio, studio.page.form

    return upload


def test_a_size_scales_an_uploaded_mesh_in_place_of_its_unit(uploaded_form):
    studio, form = uploaded_form()
    assert form.size.value == 127
    form.choose_size(170.0)
    assert form.unit.value == start_page_module.UNKNOWN_UNIT
    assert "170 × 34 × 68 mm" in form.size_text.content
    assert "guess" not in form.size_text.content
    form.edge.value = 6.0
    form.create()
    assert isinstance(studio.page, StudioPage)
    assert studio.page.bench.project.device.body.scale == 34


def test_the_unit_or_size_that_was_chosen_last_counts(uploaded_form):
    studio, form = uploaded_form()
    form.choose_size(170.0)
    form.choose_unit("cm")
    assert form.size.value == 50
    form.choose_unit(start_page_module.UNKNOWN_UNIT)
    assert "50 × 10 × 20 mm" in form.size_text.content
    form.choose_unit("cm")
    form.create()
    assert studio.page.bench.project.device.body.scale == 10


def test_an_impossible_size_is_an_error_and_the_form_stays(uploaded_form):
    studio, form = uploaded_form()
    form.choose_size(0.0)
    assert studio.page.error.code == "out-of-range"
    form.choose_size(10_000.0)
    form.create()
    assert studio.page.error.code == "body-size-impossible"
    form.choose_size(170.0)
    form.create()
    assert isinstance(studio.page, StudioPage)


def test_a_step_file_has_neither_a_unit_nor_a_size_to_choose(uploaded_form):
    _, form = uploaded_form(".step")
    assert not form.unit.visible
    assert not form.size.visible


def test_refused_files_are_reported_and_the_page_stays_usable(open_studio, tmp_path):
    studio = open_studio(tmp_path)
    page = studio.page
    page.receive("photo.stl", b"\x89PNG")
    assert page.wait(TIMEOUT_S)
    assert page.error is not None
    upload = page.upload
    studio.refuse_upload(None, "<b>huge</b>.stl", "2,048 MB exceeds the limit of 200 MB")
    assert "2,048 MB exceeds" in page.message.content
    assert "<b>" not in page.message.content
    assert page.upload is not upload  # the button of viser would wait forever
    assert not any(tmp_path.iterdir())
    click(page.buttons["cube"])
    assert isinstance(studio.page, StudioPage)


def test_the_user_can_try_again_if_the_folder_cannot_be_written(open_studio, tmp_path, monkeypatch):
    studio = open_studio(tmp_path / "new")
    page = studio.page

    def refuse(*_):
        raise StorageError("cannot be written", code="folder-not-writable", where="new")

    with monkeypatch.context() as patch:
        patch.setattr(start_page_module, "create_starting_device", refuse)
        click(page.buttons["bar"])
    assert page.error.code == "folder-not-writable"
    assert studio.page is page
    click(page.buttons["bar"])
    assert isinstance(studio.page, StudioPage)


@pytest.mark.parametrize(
    ("text", "code"),
    [
        (TEXT.replace('name = "grip"', "name ="), "toml-invalid"),
        (TEXT.replace("edge_length = 6.0", "edge_length = -1"), "out-of-range"),
        (TEXT.replace("grip.py", "gone.py"), "file-not-found"),
    ],
)
def test_an_invalid_device_is_shown_as_an_error_until_it_is_fixed(
    open_studio, tmp_path, text, code
):
    folder = write_device(tmp_path / "grip")
    (folder / "device.toml").write_text(text)
    studio = open_studio(folder)
    page = studio.page
    assert isinstance(page, ErrorPage)
    assert page.error.code == code
    studio.poll()
    assert studio.page is page  # the same error is not shown again
    (folder / "device.toml").write_bytes(b"\xff\xfe")
    studio.poll()
    assert isinstance(studio.page, ErrorPage)
    assert studio.page is not page
    (folder / "device.toml").write_text(TEXT)
    studio.poll()
    assert isinstance(studio.page, StudioPage)


def test_the_page_stays_if_the_file_disappears(open_studio, tmp_path):
    folder = write_device(tmp_path / "grip")
    studio = open_studio(folder)
    page = studio.page
    (folder / "device.toml").rename(folder / "away.toml")
    studio.poll()
    assert studio.page is page
    assert page.bench.status.code == "file-unreadable"
    (folder / "away.toml").rename(folder / "device.toml")
    studio.poll()
    assert page.bench.status.error is None


def test_a_history_that_cannot_be_written_is_shown_as_an_error(open_studio, tmp_path, monkeypatch):
    folder = write_device(tmp_path / "grip")

    def refuse(*_):
        raise StorageError("cannot be written", code="folder-not-writable", where="history.jsonl")

    with monkeypatch.context() as patch:
        patch.setattr("defsense_fab.studio.project.history.write_text", refuse)
        studio = open_studio(folder)
    assert studio.page.error.code == "folder-not-writable"
    studio.poll()
    assert isinstance(studio.page, StudioPage)


@pytest.mark.parametrize("name", [".studio", ".studio/history.jsonl"])
def test_symbolic_links_are_not_written_to(open_studio, tmp_path, name):
    folder = write_device(tmp_path / "grip")
    outside = tmp_path / "outside"
    if name == ".studio":
        outside.mkdir()
    else:
        (folder / ".studio").mkdir()
        outside.write_text("mine")
    (folder / name).symlink_to(outside)
    studio = open_studio(folder)
    assert studio.page.error.code == "path-is-link"
    assert not any(outside.iterdir()) if outside.is_dir() else outside.read_text("utf-8") == "mine"
    (folder / name).unlink()
    studio.poll()
    assert isinstance(studio.page, StudioPage)


def test_a_file_is_not_a_folder(studio_server, tmp_path):
    (tmp_path / "x").touch()
    with raises(StorageError, "not-a-folder"):
        Studio(studio_server, tmp_path / "x", Agreement())


def test_two_browsers_that_start_at_once_create_one_device(open_studio, tmp_path):
    studio = open_studio(tmp_path)
    page = studio.page
    threads = [
        threading.Thread(target=click, args=(page.buttons[name],)) for name in ("bar", "cube")
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(TIMEOUT_S)
    assert isinstance(studio.page, StudioPage)
    assert len(list(tmp_path.glob("*.py"))) == 1
