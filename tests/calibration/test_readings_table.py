"""Test reading plain tables, and the places that errors name."""

import json

import numpy as np
import pytest

from defsense_fab.calibration.calibrate import calibrate
from defsense_fab.calibration.readings import Geometry
from defsense_fab.calibration.readings_table import read_table
from defsense_fab.cli.main import main
from defsense_fab.core.errors import CalibrationError
from tests.calibration.ideal_readings import GEOMETRY, make_readings, write_table
from tests.support.errors import raises

GOOD = make_readings(lambda e: 2 * e)
AT_NINE = {"place": "a.csv:9"}


def test_table_is_read(tmp_path):
    result, warnings = read_table(write_table(tmp_path / "a.csv", GOOD), GEOMETRY)
    assert warnings == []
    assert [p.name for p in result.pieces] == [p.name for p in GOOD.pieces]
    assert result.strain == pytest.approx(GOOD.strain)
    assert result.resistance == pytest.approx(GOOD.resistance, abs=0.005)
    assert np.array_equal(result.radius, GOOD.radius, equal_nan=True)
    assert result.where[0] == "a.csv:2"


def test_semicolons_decimal_commas_and_unknown_columns(tmp_path):
    text = write_table(tmp_path / "a.csv", GOOD).read_text("utf-8").splitlines()
    lines = ["# measured on Tuesday", text[0].upper() + ",Note"] + [t + ",x" for t in text[1:]]
    path = tmp_path / "b.csv"
    path.write_text(
        "\ufeff" + "\n".join(t.replace(",", ";").replace(".", ",") for t in lines), encoding="utf-8"
    )
    result, warnings = read_table(path, GEOMETRY)
    assert result.resistance == pytest.approx(GOOD.resistance, abs=0.005)
    (notice,) = warnings
    assert notice.code == "columns-unused"
    assert "note" in notice.text


def test_rounds_and_faces(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(
        "specimen,jig_radius,channel,resistance,face,round\n"
        "s,75,top,2000,b,2\ns,75,top,2100,a,2\ns,flat,top,2050,a,1\n"
    )
    result, _ = read_table(path, GEOMETRY)
    assert result.strain == pytest.approx([-5.5 / 82.5, 5.5 / 82.5, 0])
    assert result.turn.tolist() == [2, 2, 1]
    path.write_text("specimen,jig_radius,channel,resistance\n" + 2 * "s,75,top,2000\n")
    assert read_table(path, GEOMETRY)[0].turn.tolist() == [0, 1]


def set_to(line, **values):
    """Return a change that sets cells of the row in a line of the file."""
    count = [1]

    def change(row):
        count[0] += 1
        return {**row, **values} if count[0] == line else row

    return change


def scaled(key, factor, only=lambda row: True):
    """Return a change that scales a column of some rows."""

    def change(row):
        if row[key] and only(row):
            row[key] = f"{float(row[key]) * factor:.6g}"
        return row

    return change


@pytest.mark.parametrize(
    ("change", "code", "facts"),
    [
        (set_to(9, resistance="OL"), "open-circuit", AT_NINE),
        (set_to(9, resistance="inf"), "open-circuit", AT_NINE),
        (set_to(9, resistance="0"), "impossible-resistance", {**AT_NINE, "state": "shorted"}),
        (set_to(9, resistance="-5"), "impossible-resistance", AT_NINE),
        (set_to(9, resistance="2.1k"), "not-a-number", {**AT_NINE, "column": "resistance"}),
        (set_to(9, resistance=""), "empty-cell", {**AT_NINE, "column": "resistance"}),
        (set_to(9, resistance="15"), "impossible-change", {**AT_NINE, "state": "shorted"}),
        (set_to(9, resistance="900000"), "impossible-change", {**AT_NINE, "state": "open"}),
        (set_to(9, resistance="2.1"), "units-mixed", AT_NINE),
        (set_to(9, channel="middle"), "unknown-cord", {**AT_NINE, "column": "channel"}),
        (set_to(9, specimen=""), "empty-cell", {**AT_NINE, "column": "specimen"}),
        (set_to(9, jig_radius="80"), "unknown-jig", {**AT_NINE, "guess": None}),
        (set_to(9, jig_radius="82.5"), "unknown-jig", {**AT_NINE, "guess": "neutral plane"}),
        (scaled("jig_radius", 0.1), "unknown-jig", {"place": "a.csv:3", "guess": "cm"}),
        (scaled("jig_radius", 0.001), "unknown-jig", {"place": "a.csv:3", "guess": "m"}),
        (scaled("jig_radius", 1 / 25.4), "unknown-jig", {"place": "a.csv:3", "guess": "inches"}),
        (scaled("resistance", 1e-3, lambda r: r["specimen"] == "200"), "units-mixed", {}),
        (scaled("resistance", 1e-3, lambda r: r["channel"] == "top"), "units-mixed", {}),
        (scaled("resistance", 1e3, lambda r: not r["jig_radius"]), "units-mixed", {}),
        (lambda r: r | {"jig_radius": r["jig_radius"] and "75"}, "too-few-radii", {"count": 1}),
        (lambda r: r | {"jig_radius": r["jig_radius"] or "75"}, "no-flat-reading", {}),
        (lambda r: {**r, "more": "1"}, "too-many-cells", {"line": 2}),
    ],
)  # fmt: skip
def test_invalid_table_is_refused(tmp_path, change, code, facts):
    with raises(CalibrationError, code, **facts):
        calibrate(read_table(write_table(tmp_path / "a.csv", GOOD, change), GEOMETRY)[0])


@pytest.mark.parametrize(
    ("text", "code", "facts"),
    [
        ("", "file-empty", {}),
        ("specimen,jig_radius,channel,resistance\n", "no-rows", {}),
        (
            "specimen,radius,channel,ohm\ns,75,top,1\n",
            "column-missing",
            {"columns": ["jig_radius", "resistance"]},
        ),
        (
            "specimen,jig_radius,channel,resistance,resistance\n",
            "column-repeated",
            {"column": "resistance"},
        ),
    ],
)
def test_invalid_header_is_refused(tmp_path, text, code, facts):
    path = tmp_path / "a.csv"
    path.write_text(text)
    with raises(CalibrationError, code, **facts):
        read_table(path, GEOMETRY)


def test_invalid_geometry_is_refused():
    for thickness, offset, code in (
        (1.5, 2, "offset-too-large"), (15, 7.5, "offset-too-large"),
        (-15, 2, "out-of-range"), (15, 0, "out-of-range"), (float("nan"), 2, "out-of-range"),
    ):  # fmt: skip
        with raises(CalibrationError, code):
            Geometry(thickness, offset)


def test_command_writes_the_response(tmp_path, capsys):
    """The file can be used in device.toml; after an error no file is left."""
    path, out = write_table(tmp_path / "a.csv", GOOD), tmp_path / "deep" / "response.json"
    assert main(["calibrate", "fit", str(path), "--out", str(out), "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data == json.loads(out.read_text("utf-8"))
    assert data["model"] == "line"
    assert data["interval"][0] < data["k_res"] < data["interval"][1]
    assert data["strain_range"] == pytest.approx([-5.5 / 82.5, 5.5 / 82.5])
    assert abs(data["neutral_drift"]) < 0.006
    page = out.with_suffix(".html").read_text("utf-8")
    assert f"{data['k_res']:.2f}" in page
    assert page.count("data:image/png") == 3
    bad, none = tmp_path / "bad.csv", tmp_path / "none.json"
    bad.write_text("specimen\n")
    assert main(["calibrate", "fit", str(bad), "--out", str(none)]) == 2
    assert not none.exists()
    assert not none.with_suffix(".html").exists()
    error = capsys.readouterr().err.strip().splitlines()[-1]
    assert "bad.csv:1" in error
    assert "jig_radius" in error


def test_result_does_not_overwrite_sources_or_folders(tmp_path, capsys):
    path = write_table(tmp_path / "a.csv", GOOD)
    text = path.read_text("utf-8")
    (tmp_path / "folder.json").mkdir()
    for out in ("a.csv", "x.html", "folder.json", ".", "no/"):
        assert main(["calibrate", "fit", str(path), "--out", str(tmp_path / out)]) == 2
        assert ".json" in capsys.readouterr().err
    (tmp_path / "b.html").write_text(text)
    assert (
        main(["calibrate", "fit", str(tmp_path / "b.html"), "--out", str(tmp_path / "b.json")]) == 2
    )
    assert "b.html" in capsys.readouterr().err
    assert path.read_text("utf-8") == (tmp_path / "b.html").read_text("utf-8") == text
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.csv", "b.html", "folder.json"]


def test_round_that_is_not_a_whole_number_is_refused(tmp_path):
    path = tmp_path / "a.csv"
    for bad in ("nan", "1.5", "-1", "1e999"):
        path.write_text(f"specimen,jig_radius,channel,resistance,round\ns,75,top,2000,{bad}\n")
        with raises(CalibrationError, "not-a-count", place="a.csv:2", column="round"):
            read_table(path, GEOMETRY)
