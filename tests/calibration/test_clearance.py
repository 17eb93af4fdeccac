"""The clearance of a coupon goes into a device, and out of it again."""

import shutil

import pytest
from defsense_fab.calibration.clearance import write_clearance

from defsense_fab.cli.main import main
from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import DeviceError
from tests.support.places import DEVICES


@pytest.fixture
def folder(tmp_path):
    for name in ("device.toml", "bar.py"):
        shutil.copy(DEVICES / "bar" / name, tmp_path)
    return tmp_path


def test_it_is_written_with_comments_kept_and_undone(folder):
    path = folder / "device.toml"
    text = "# mine\n" + path.read_text("utf-8").replace(
        "[fabrication]\n", "[fabrication]  # my printer\n"
    )
    path.write_bytes(text.replace("\n", "\r\n").encode())
    before = path.read_bytes()
    found = write_clearance(folder, 0.25)
    assert (found.written, found.was) == (None, 0.2)
    assert load_device(folder).fabrication.clearance == 0.25
    assert b"# mine\r\n" in path.read_bytes()
    assert b"# my printer\r\n" in path.read_bytes()
    again = write_clearance(folder, 0.3)
    assert (again.written, again.now) == (0.25, 0.3)
    write_clearance(folder, None)
    assert (
        path.read_bytes().replace(b"\r\n", b"\n").strip() == before.replace(b"\r\n", b"\n").strip()
    )


def test_a_device_without_that_table_gets_it(folder):
    path = folder / "device.toml"
    path.write_text(path.read_text("utf-8").replace('[fabrication]\nprocess = "fdm-tpu"\n', ""))
    write_clearance(folder, 0.1)
    assert load_device(folder).fabrication.clearance == 0.1


@pytest.mark.parametrize("fits", [-0.1, 2.0, float("nan")])
def test_a_clearance_that_no_printer_has_is_refused(folder, fits):
    before = (folder / "device.toml").read_bytes()
    with pytest.raises(DeviceError, match="--fits"):
        write_clearance(folder, fits)
    assert (folder / "device.toml").read_bytes() == before


def test_the_command_tells_what_was_and_how_to_undo_it(folder, capsys):
    assert main(["calibrate", "clearance", str(folder), "--fits", "0.25"]) == 0
    said = capsys.readouterr().out
    assert "clearance is 0.25 mm" in said
    assert "it was 0.2 mm" in said
    assert f"defsense calibrate clearance {folder} --reset" in said
    assert main(["calibrate", "clearance", str(folder), "--reset"]) == 0
    assert "--fits 0.25" in capsys.readouterr().out
    assert load_device(folder).fabrication.clearance == 0.2


def test_processes_that_cast_have_no_coupon_which_is_said(folder, capsys):
    assert main(["calibrate", "coupon", str(folder / "out"), "--process", "cast-silicone"]) == 2
    assert "cast-silicone casts parts in printed moulds, and the coupon has no mould" in (
        capsys.readouterr().err.replace("\n", " ")
    )
    assert not (folder / "out").exists()
    path = folder / "device.toml"
    text = path.read_text("utf-8").replace('process = "fdm-tpu"', 'process = "cast-silicone"')
    path.write_text(text.replace("tango-black-plus", "ecoflex-00-30"))
    assert main(["calibrate", "clearance", str(folder), "--fits", "0.2"]) == 0
    assert "the coupon has no mould" in capsys.readouterr().out.replace("\n", " ")
