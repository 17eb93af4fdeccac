"""The start page: the gallery, uploaded bodies, and the devices that were opened before."""

from __future__ import annotations

import base64
import json
import shutil
import threading

import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import BodyError, DefsenseError, DeviceError, StorageError
from defsense_fab.core.storage.files import config_folder
from defsense_fab.studio.app import start_app as start_app_module
from defsense_fab.studio.app.studio_app import StudioApp
from defsense_fab.studio.messages.shell import Page
from defsense_fab.studio.messages.start import Gallery, RecentDevices
from defsense_fab.studio.project.agreement import Agreement
from defsense_fab.studio.session.job_strip import JobStrip
from defsense_fab.workflow.starts.body_file import BodyFile
from tests.conftest import box_surface
from tests.studio.devices import TEXT, write_device
from tests.studio.steps.browsers import FakeBrowser, FakeServer
from tests.support.errors import raises

TIMEOUT_S = 60.0
PNG = b"\x89PNG\r\n\x1a\n" + bytes(20)
PICTURE = "data:image/png;base64," + base64.b64encode(PNG).decode()


@pytest.fixture(autouse=True)
def no_jobs(monkeypatch):
    """Start no job; bodies are not made."""
    monkeypatch.setattr(JobStrip, "start", lambda *_: None)


@pytest.fixture
def open_studio(own_settings):
    """Return a function that opens the studio of a folder in one browser."""
    apps = []

    def open_folder(folder, trusted=False):
        app = StudioApp(FakeServer(), folder, Agreement(trusted))
        app.server = app._server
        app.browser = FakeBrowser(app)
        app.connect(app.browser)
        apps.append(app)
        return app

    yield open_folder
    for app in apps:
        app.close()


def screen(app):
    return app.server.events[Page].screen


def recent(app):
    return app.server.events[RecentDevices].devices


def name_of(app):
    return app.device.session.device.name


# The gallery


def test_the_gallery_is_shown_for_a_folder_without_a_device(open_studio, tmp_path):
    folder = tmp_path / "new" / "my-grip"
    app = open_studio(folder)
    assert screen(app) == "start"
    gallery = app.server.events[Gallery]
    bar = next(device for device in gallery.devices if device.name == "bar")
    assert bar.title == "Bar"
    assert bar.poses == ["bend_up", "bend_down", "twist"]
    assert bar.cords == 3
    assert bar.picture.startswith("data:image/png;base64,")
    assert "STL" in gallery.formats
    assert gallery.default_material in {material.name for material in gallery.materials}
    new = app.server.events[RecentDevices]
    assert (new.folder, new.is_new_folder) == (str(folder), False)
    app.poll()
    assert not folder.exists()  # nothing is written before the user chooses


def test_a_missing_folder_becomes_a_device_of_the_gallery(open_studio, tmp_path):
    folder = tmp_path / "new" / "my-grip"
    app = open_studio(folder)
    app.browser.ask("create-from-gallery", start="twist-bar", name="")
    assert screen(app) == "device"
    assert (name_of(app), app.folder) == ("my-grip", folder)
    body = load_device(folder).body
    assert Agreement().script_to_confirm(body) is None  # the script of the package is trusted
    assert [device.name for device in recent(app)] == ["my-grip"]


def test_the_next_device_gets_a_new_folder_next_to_the_open_one(open_studio, tmp_path):
    app = open_studio(write_device(tmp_path / "grip"))
    new = app.server.events[RecentDevices]
    assert (new.folder, new.is_new_folder) == (str(tmp_path), True)
    (tmp_path / "My-bar").mkdir()
    app.browser.ask("create-from-gallery", start="bar", name="My bar")
    assert app.folder == tmp_path / "My-bar-2"  # nothing is overwritten
    assert name_of(app) == "My bar"
    app.browser.ask("create-from-gallery", start="cube", name="")
    assert app.folder == tmp_path / "cube"
    assert (tmp_path / "grip" / "device.toml").read_text() == TEXT
    assert [device.name for device in recent(app)] == ["cube", "My bar", "grip"]


@pytest.mark.parametrize("name", ["../../etc", "a/b", "CON", ".."])
def test_a_name_is_no_path(open_studio, tmp_path, name):
    app = open_studio(write_device(tmp_path / "folder" / "grip"))
    app.browser.ask("create-from-gallery", start="bar", name=name)
    assert app.folder.parent == tmp_path / "folder"
    assert name_of(app) == name


def test_other_programs_in_the_folder_need_an_agreement(open_studio, tmp_path):
    (tmp_path / "build123d.py").write_text("raise SystemExit\n", encoding="utf-8")
    app = open_studio(tmp_path)
    app.browser.ask("create-from-gallery", start="bar", name="bar")
    script = Agreement().script_to_confirm(load_device(tmp_path).body)
    assert [name for name, _ in script.files] == ["bar.py", "build123d.py"]


@pytest.mark.parametrize(
    ("start", "name", "code"), [("plane", "x", "unknown-start"), ("bar", "a\nb", "name-invalid")]
)
def test_invalid_choices_create_nothing(open_studio, tmp_path, start, name, code):
    app = open_studio(tmp_path / "new")
    with raises(DefsenseError, code):
        app.browser.ask("create-from-gallery", start=start, name=name)
    assert screen(app) == "start"
    assert not (tmp_path / "new").exists()


def test_the_user_can_try_again_if_the_folder_cannot_be_written(open_studio, tmp_path, monkeypatch):
    app = open_studio(tmp_path / "new")

    def refuse(*_):
        raise StorageError("cannot be written", code="folder-not-writable", where="new")

    with monkeypatch.context() as patch:
        patch.setattr(start_app_module, "create_starting_device", refuse)
        with raises(StorageError, "folder-not-writable"):
            app.browser.ask("create-from-gallery", start="bar", name="bar")
    assert screen(app) == "start"
    app.browser.ask("create-from-gallery", start="bar", name="bar")
    assert screen(app) == "device"


def test_two_browsers_that_start_at_once_share_no_folder(open_studio, tmp_path):
    app = open_studio(tmp_path / "new")
    threads = [
        threading.Thread(
            target=FakeBrowser(app).ask,
            args=("create-from-gallery",),
            kwargs={"start": name, "name": name},
        )
        for name in ("bar", "cube")
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(TIMEOUT_S)
    assert sorted(device.name for device in recent(app)) == ["bar", "cube"]
    for device in recent(app):
        assert load_device(config_folder() / device.folder).name == device.name


# Uploaded bodies


@pytest.fixture
def upload(open_studio, tmp_path, monkeypatch):
    """Return a function that uploads a box in a file, and returns the studio."""

    def send(suffix=".stl", folder=None):
        surface = box_surface([0, 0, 0], [5, 1, 2])
        repairs = ("merged 4 vertices", "closed 1 small hole of 2 mm")
        body = BodyFile(b"content", "grip", suffix, surface, "inch", suffix == ".stl", repairs)
        monkeypatch.setattr(start_app_module, "load_body_content", lambda name, content: body)
        app = open_studio(folder or tmp_path / "new")
        app.receive(app.browser, "../grip" + suffix, b"content")
        return app

    return send


def create_from_body(app, **values):
    given = {"name": "My grip", "unit": None, "size": None, "material": "ninjaflex-85a"}
    content = {**given, "edgeLength": 5.0, **values}
    app.browser.ask("create-from-body", **content)


def test_an_uploaded_body_with_its_unit_becomes_a_device(upload, tmp_path):
    app = upload()
    guess = app.browser.ask("describe-upload", unit=None, size=None)
    assert (guess.unit, guess.is_doubtful, guess.has_unit) == ("inch", True, False)
    assert guess.size == pytest.approx([127, 25.4, 50.8])
    assert guess.repairs == ["closed 1 small hole of 2 inch"]
    surface = app.browser.ask("uploaded-surface")
    assert surface.arrays["vertices"].max() * guess.scale == pytest.approx(127)
    in_cm = app.browser.ask("describe-upload", unit="cm", size=None)
    assert (in_cm.size, in_cm.is_doubtful) == ([50, 10, 20], False)
    assert in_cm.edge_length < in_cm.max_edge_length == 10
    create_from_body(app, unit="inch")
    assert screen(app) == "device"
    device = app.device.session.device
    assert (device.name, device.body.scale, device.mesh.edge_length) == ("My grip", 25.4, 5)
    assert device.material.name == "ninjaflex-85a"
    folder = tmp_path / "new"
    assert (folder / "grip.stl").read_bytes() == b"content"
    assert sorted(p.name for p in folder.iterdir() if p.is_file()) == ["device.toml", "grip.stl"]


def test_a_size_scales_an_uploaded_mesh_in_place_of_its_unit(upload):
    app = upload()
    scaled = app.browser.ask("describe-upload", unit=None, size=170)
    assert (scaled.unit, scaled.is_doubtful) == ("", False)
    assert scaled.size == pytest.approx([170, 34, 68])
    create_from_body(app, size=170.0)
    assert app.device.session.device.body.scale == 34


@pytest.mark.parametrize(
    ("values", "kind", "code"),
    [
        ({"size": 0.0}, DeviceError, "out-of-range"),
        ({"unit": "ell"}, DeviceError, "unknown-unit"),
        ({"unit": "cm", "size": 10.0}, DeviceError, "options-conflict"),
        ({"size": 10_000.0}, BodyError, "body-size-impossible"),
        ({"unit": "cm", "edgeLength": 99_999.0}, DeviceError, "out-of-range"),
        ({"unit": "cm", "material": "steel"}, DeviceError, "unknown-material"),
        ({"unit": "cm", "name": " "}, DeviceError, "name-invalid"),
    ],
)
def test_invalid_values_are_errors_and_the_upload_stays(upload, values, kind, code):
    app = upload()
    with raises(kind, code):
        create_from_body(app, **values)
    assert screen(app) == "start"
    create_from_body(app, unit="cm")
    assert screen(app) == "device"


def test_a_step_file_has_neither_a_unit_nor_a_size_to_choose(upload):
    app = upload(".step")
    assert app.browser.ask("describe-upload", unit=None, size=None).has_unit
    with raises(DeviceError, "size-not-applicable"):
        app.browser.ask("describe-upload", unit=None, size=170)
    with raises(DeviceError, "unit-not-applicable"):
        app.browser.ask("describe-upload", unit="inch", size=None)


def test_an_uploaded_body_belongs_to_its_browser(upload, tmp_path):
    app = upload(folder=write_device(tmp_path / "other"))
    with raises(BodyError, "no-upload"):
        FakeBrowser(app).ask("describe-upload", unit=None, size=None)
    create_from_body(app, unit="cm")
    assert app.folder == tmp_path / "My-grip"
    with raises(BodyError, "no-upload"):
        app.browser.ask("describe-upload", unit=None, size=None)


def test_an_upload_of_a_closed_page_is_forgotten(upload):
    app = upload()
    app.browser.is_open = False  # it is closed while the next file is read
    app.receive(app.browser, "grip.stl", b"content")
    with raises(BodyError, "no-upload"):
        app.browser.ask("describe-upload")


def test_a_file_that_is_no_body_is_refused(open_studio, tmp_path):
    app = open_studio(tmp_path)
    with raises(BodyError, "unknown-format"):
        app.receive(app.browser, "photo.stl", b"\x89PNG")
    assert not any(p.name != "settings" for p in tmp_path.iterdir())


# Devices that were opened before


def test_a_recent_device_is_opened_and_closed(open_studio, tmp_path):
    app = open_studio(write_device(tmp_path / "one"))
    app.browser.ask("create-from-gallery", start="bar", name="two")
    assert [(d.name, d.is_open, d.is_missing) for d in recent(app)] == [
        ("two", True, False), ("grip", False, False),
    ]  # fmt: skip
    app.browser.ask("open-device", folder=str(tmp_path / "one"))
    assert name_of(app) == "grip"
    assert [(d.name, d.is_open) for d in recent(app)] == [("grip", True), ("two", False)]
    app.browser.ask("close-device")
    assert screen(app) == "start"
    assert not any(device.is_open for device in recent(app))
    app.poll()
    assert screen(app) == "start"
    with raises(DefsenseError, "no-device"):
        app.browser.ask("undo")
    app.browser.ask("open-device", folder=str(tmp_path / "one"))
    assert screen(app) == "device"


def test_the_list_outlives_the_program(open_studio, tmp_path):
    open_studio(write_device(tmp_path / "one"))
    app = open_studio(tmp_path / "new")
    assert [device.folder for device in recent(app)] == [str(tmp_path / "one")]
    app.browser.ask("open-device", folder=str(tmp_path / "one"))
    assert name_of(app) == "grip"


def test_other_folders_are_not_opened(open_studio, tmp_path):
    write_device(tmp_path / "secret")
    app = open_studio(write_device(tmp_path / "one"))
    for folder in ("secret", "one/../secret", "missing", ""):
        with raises(DeviceError, "folder-not-listed"):
            app.browser.ask("open-device", folder=str(tmp_path / folder))
    assert name_of(app) == "grip"


def test_a_missing_device_is_marked_and_can_be_removed(open_studio, tmp_path):
    app = open_studio(write_device(tmp_path / "one"))
    app.browser.ask("create-from-gallery", start="bar", name="two")
    shutil.move(tmp_path / "one", tmp_path / "away")
    with raises(DeviceError, "file-not-found"):
        app.browser.ask("open-device", folder=str(tmp_path / "one"))
    assert [(d.name, d.is_missing) for d in recent(app)] == [("two", False), ("grip", True)]
    app.browser.ask("forget-device", folder=str(tmp_path / "one"))
    assert [device.name for device in recent(app)] == ["two"]
    assert (tmp_path / "away" / "device.toml").exists()


def test_no_device_is_left_while_a_job_runs(open_studio, tmp_path, monkeypatch):
    app = open_studio(write_device(tmp_path / "one"))
    write_device(tmp_path / "two")
    monkeypatch.setattr(JobStrip, "is_running", property(lambda _: True))
    with raises(DefsenseError, "job-running"):
        app.browser.ask("close-device")
    with raises(DefsenseError, "job-running"):
        app.browser.ask("create-from-gallery", start="bar", name="x")
    assert not (tmp_path / "x").exists()
    assert name_of(app) == "grip"


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"devices": [1, {"folder": 3}]}', "\xff"])
def test_a_damaged_list_is_empty(open_studio, tmp_path, text):
    config_folder().mkdir(parents=True)
    (config_folder() / "recent-devices.json").write_text(text, encoding="latin-1")
    app = open_studio(write_device(tmp_path / "one"))
    assert [device.name for device in recent(app)] == ["grip"]


def test_a_list_that_cannot_be_written_holds_until_the_program_ends(open_studio, tmp_path):
    config_folder().mkdir(parents=True)
    (config_folder() / "recent-devices.json").mkdir()
    app = open_studio(write_device(tmp_path / "one"))
    assert [device.name for device in recent(app)] == ["grip"]


def test_the_list_names_devices_as_their_files_do(open_studio, tmp_path):
    app = open_studio(write_device(tmp_path / "one"))
    app.browser.ask("rename-device", name="Handle")
    app.connect(app.browser)
    assert [device.name for device in recent(app)] == ["Handle"]
    stored = json.loads((config_folder() / "recent-devices.json").read_text())
    assert stored["devices"][0]["name"] == "grip"


def test_the_picture_of_a_device_is_kept(open_studio, tmp_path):
    app = open_studio(write_device(tmp_path / "one"))
    app.browser.ask("keep-picture", picture=PICTURE)
    assert recent(app)[0].picture == PICTURE


@pytest.mark.parametrize(
    "picture",
    [
        "", "data:image/png;base64,AAAA", "data:text/html;base64,PGI+", "data:image/png;base64,???",
        "data:image/png;base64," + base64.b64encode(PNG + bytes(100_000)).decode(),
    ],
)  # fmt: skip
def test_other_content_is_not_kept_as_a_picture(open_studio, tmp_path, picture):
    app = open_studio(write_device(tmp_path / "one"))
    with raises(StorageError, "picture-invalid"):
        app.browser.ask("keep-picture", picture=picture)
    assert recent(app)[0].picture == ""


def test_a_picture_that_is_a_link_is_neither_written_nor_read(open_studio, tmp_path):
    app = open_studio(write_device(tmp_path / "one"))
    (tmp_path / "mine").write_bytes(PNG)
    (tmp_path / "one" / ".studio" / "picture").symlink_to(tmp_path / "mine")
    with raises(StorageError, "path-is-link"):
        app.browser.ask("keep-picture", picture=PICTURE)
    app.connect(app.browser)
    assert recent(app)[0].picture == ""


# Devices that cannot be read


def test_an_invalid_device_is_shown_as_an_error_until_it_is_fixed(open_studio, tmp_path):
    folder = write_device(tmp_path / "grip")
    (folder / "device.toml").write_text(TEXT.replace("edge_length = 6.0", "edge_length = -1"))
    app = open_studio(folder)
    assert (screen(app), app.server.events[Page].problem.code) == ("broken", "out-of-range")
    app.browser.ask("close-device")
    assert screen(app) == "start"
    app.browser.ask("open-device", folder=str(folder))
    assert screen(app) == "broken"
    (folder / "device.toml").write_text(TEXT)
    app.poll()
    assert screen(app) == "device"


def test_a_device_that_cannot_be_read_is_restored_from_its_history(open_studio, tmp_path):
    folder = write_device(tmp_path / "grip")
    open_studio(folder).browser.ask("rename-device", name="Handle")
    (folder / "device.toml").write_text("name =")
    app = open_studio(folder)
    assert screen(app) == "broken"
    app.browser.ask("restore")
    assert (screen(app), name_of(app)) == ("device", "Handle")


def test_without_a_history_nothing_is_restored(open_studio, tmp_path):
    folder = write_device(tmp_path / "grip")
    (folder / "device.toml").write_text("name =")
    app = open_studio(folder)
    with raises(DefsenseError, "nothing-to-restore"):
        app.browser.ask("restore")
    assert (folder / "device.toml").read_text() == "name ="


def test_a_file_is_not_a_folder(tmp_path):
    (tmp_path / "x").touch()
    with raises(StorageError, "not-a-folder"):
        StudioApp(FakeServer(), tmp_path / "x", Agreement())
