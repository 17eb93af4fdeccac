"""Test writing the clearance of a coupon into a device, and removing it."""

import shutil

import pytest

from defsense_fab.cli.main import main
from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import DeviceError, FabricationError
from defsense_fab.workflow.calibrate.calibration_parts import write_coupon
from defsense_fab.workflow.calibrate.clearance import write_clearance
from defsense_fab.workflow.calibrate.options import PrintOptions
from tests.support.errors import raises
from tests.support.places import DEVICES


@pytest.fixture
def folder(tmp_path):
    for name in ("device.toml", "bar.py"):
        shutil.copy(DEVICES / "bar" / name, tmp_path)
    return tmp_path


def test_clearance_is_written_and_removed_without_changing_comments(folder):
    path = folder / "device.toml"
    text = "# mine\n" + path.read_text("utf-8").replace(
        "[fabrication]\n", "[fabrication]  # my printer\n"
    )
    path.write_bytes(text.replace("\n", "\r\n").encode())
    before = path.read_bytes()
    first = write_clearance(folder, 0.25)
    assert (first.written, first.was) == (None, 0.2)
    assert load_device(folder).fabrication.clearance == 0.25
    assert b"# mine\r\n" in path.read_bytes()
    assert b"# my printer\r\n" in path.read_bytes()
    second = write_clearance(folder, 0.3)
    assert (second.written, second.now) == (0.25, 0.3)
    write_clearance(folder, None)
    assert (
        path.read_bytes().replace(b"\r\n", b"\n").strip() == before.replace(b"\r\n", b"\n").strip()
    )


def test_missing_table_is_added(folder):
    path = folder / "device.toml"
    path.write_text(path.read_text("utf-8").replace('[fabrication]\nprocess = "fdm-tpu"\n', ""))
    write_clearance(folder, 0.1)
    assert load_device(folder).fabrication.clearance == 0.1


@pytest.mark.parametrize("fits", [-0.1, 2.0, float("nan")])
def test_impossible_clearance_is_refused(folder, fits):
    before = (folder / "device.toml").read_bytes()
    with raises(DeviceError, "out-of-range"):
        write_clearance(folder, fits)
    assert (folder / "device.toml").read_bytes() == before


def test_command_prints_both_clearances_and_the_undo_command(folder, capsys):
    assert main(["calibrate", "clearance", str(folder), "--fits", "0.25"]) == 0
    output = capsys.readouterr().out
    assert "0.25 mm" in output
    assert "0.2 mm" in output
    assert f"defsense calibrate clearance {folder} --reset" in output
    assert main(["calibrate", "clearance", str(folder), "--reset"]) == 0
    assert "--fits 0.25" in capsys.readouterr().out
    assert load_device(folder).fabrication.clearance == 0.2


def test_casting_process_has_no_coupon(folder, capsys):
    with raises(FabricationError, "process-casts", process="cast-silicone"):
        write_coupon(folder / "out", printing=PrintOptions(process="cast-silicone"))
    assert main(["calibrate", "coupon", str(folder / "out"), "--process", "cast-silicone"]) == 2
    assert "cast-silicone" in capsys.readouterr().err
    assert not (folder / "out").exists()
    path = folder / "device.toml"
    text = path.read_text("utf-8").replace('process = "fdm-tpu"', 'process = "cast-silicone"')
    path.write_text(text.replace("ninjaflex-85a", "ecoflex-00-30"))
    assert main(["calibrate", "clearance", str(folder), "--fits", "0.2"]) == 0
    assert "note: cast-silicone" in capsys.readouterr().out
