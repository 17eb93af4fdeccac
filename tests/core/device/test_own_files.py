"""Test which files of a folder are the device's own, and which are results."""

from defsense_fab.core.device.build_folder import REPRODUCED, own_files
from defsense_fab.core.storage.session_manifest import FILE


def test_results_in_a_device_folder_are_not_its_own_files(tmp_path):
    own = ["device.toml", "parts/build/arm.step", "parts/study/bar.py", "shapes/base.stl"]
    others = [
        "build/body.stl", "study/runs.log", f"session-1/{FILE}", "session-1/tracks.csv",
        f"reproduced/{REPRODUCED}", "reproduced/bar/full/bar.py", ".git/config", "parts/.lock",
        "parts/__pycache__/bar.pyc", "results/bar/simulated/bar.py",
    ]  # fmt: skip
    for name in (*own, *others):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("")
    (tmp_path / "shapes" / "again").symlink_to(tmp_path)  # following it would never end
    files = own_files(tmp_path, without=tmp_path / "results" / "bar" / "full")
    assert [p.relative_to(tmp_path).as_posix() for p in files] == own
