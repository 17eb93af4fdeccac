"""Folders of the repository that tests read from."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DEVICES = ROOT / "fixtures" / "devices"
BAR = DEVICES / "bar"
VICON = ROOT / "fixtures" / "c3d"
FIRMWARE = ROOT / "firmware"
