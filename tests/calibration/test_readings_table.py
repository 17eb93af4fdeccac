"""Plain tables: what is read, and what is refused with its place."""

import json

import numpy as np
import pytest

from defsense_fab.calibration.calibrate import calibrate
from defsense_fab.calibration.readings import Geometry
from defsense_fab.calibration.readings_table import read_table
from defsense_fab.cli.main import main
from defsense_fab.core.errors import CalibrationError
from tests.calibration.ideal_readings import GEOMETRY, readings, table
from tests.support.errors import raises

GOOD = readings(lambda e: 2 * e)
AT_NINE = {"place": "a.csv:9"}


def test_a_table_is_what_was_measured(tmp_path):
    found, warnings = read_table(table(tmp_path / "a.csv", GOOD), GEOMETRY)
    assert warnings == []
    assert [p.name for p in found.pieces] == [p.name for p in GOOD.pieces]
    assert found.strain == pytest.approx(GOOD.strain)
    assert found.resistance == pytest.approx(GOOD.resistance, abs=0.005)
    assert np.array_equal(found.radius, GOOD.radius, equal_nan=True)
    assert found.where[0] == "a.csv:2"


def test_semicolons_decimal_commas_and_other_columns(tmp_path):
    text = table(tmp_path / "a.csv", GOOD).read_text("utf-8").splitlines()
    lines = ["# measured on Tuesday", text[0].upper() + ",Note"] + [t + ",x" for t in text[1:]]
    path = tmp_path / "b.csv"
    path.write_text(
        "\ufeff" + "\n".join(t.replace(",", ";").replace(".", ",") for t in lines), encoding="utf-8"
    )
    found, warnings = read_table(path, GEOMETRY)
    assert found.resistance == pytest.approx(GOOD.resistance, abs=0.005)
    (notice,) = warnings
    assert notice.code == "columns-unused"
    assert "note" in notice.text


def test_rounds_and_faces(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(
        "specimen,jig_radius,channel,resistance,face,round\n"
        "s,75,top,2000,b,2\ns,75,top,2100,a,2\ns,flat,top,2050,a,1\n"
    )
    found, _ = read_table(path, GEOMETRY)
    assert found.strain == pytest.approx([-5.5 / 82.5, 5.5 / 82.5, 0])
    assert found.turn.tolist() == [2, 2, 1]
    path.write_text("specimen,jig_radius,channel,resistance\n" + 2 * "s,75,top,2000\n")
    assert read_table(path, GEOMETRY)[0].turn.tolist() == [0, 1]


def set_to(line, **values):
    """Edits the row that stands in this line of the file."""
    count = [1]

    def change(row):
        count[0] += 1
        return {**row, **values} if count[0] == line else row

    return change


def scaled(key, factor, only=lambda row: True):
    """Edits a column of some rows."""

    def change(row):
        if row[key] and only(row):
            row[key] = f"{float(row[key]) * factor:.6g}"
        return row

    return change


@pytest.mark.parametrize(
    ("change", "code", "data"),
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
def test_bad_tables(tmp_path, change, code, data):
    with raises(CalibrationError, code, **data):
        calibrate(read_table(table(tmp_path / "a.csv", GOOD, change), GEOMETRY)[0])


@pytest.mark.parametrize(
    ("text", "code", "data"),
    [
        ("", "empty-file", {}),
        ("specimen,jig_radius,channel,resistance\n", "no-rows", {}),
        (
            "specimen,radius,channel,ohm\ns,75,top,1\n",
            "missing-column",
            {"columns": ["jig_radius", "resistance"]},
        ),
        (
            "specimen,jig_radius,channel,resistance,resistance\n",
            "duplicate-column",
            {"column": "resistance"},
        ),
    ],
)
def test_bad_headers(tmp_path, text, code, data):
    path = tmp_path / "a.csv"
    path.write_text(text)
    with raises(CalibrationError, code, **data):
        read_table(path, GEOMETRY)


def test_bad_geometry():
    for thickness, offset, code in (
        (1.5, 2, "offset-too-large"), (15, 7.5, "offset-too-large"),
        (-15, 2, "out-of-range"), (15, 0, "out-of-range"), (float("nan"), 2, "out-of-range"),
    ):  # fmt: skip
        with raises(CalibrationError, code):
            Geometry(thickness, offset)


def test_the_command(tmp_path, capsys):
    """What it writes is what device.toml takes; errors leave nothing behind."""
    path, out = table(tmp_path / "a.csv", GOOD), tmp_path / "deep" / "response.json"
    assert main(["calibrate", "fit", str(path), "--out", str(out), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told == json.loads(out.read_text("utf-8"))
    assert told["model"] == "line"
    assert told["interval"][0] < told["k_res"] < told["interval"][1]
    assert told["strain_range"] == pytest.approx([-5.5 / 82.5, 5.5 / 82.5])
    assert abs(told["neutral_drift"]) < 0.006
    page = out.with_suffix(".html").read_text("utf-8")
    assert f"{told['k_res']:.2f}" in page
    assert page.count("data:image/png") == 3
    bad, none = tmp_path / "bad.csv", tmp_path / "none.json"
    bad.write_text("specimen\n")
    assert main(["calibrate", "fit", str(bad), "--out", str(none)]) == 2
    assert not none.exists()
    assert not none.with_suffix(".html").exists()
    error = capsys.readouterr().err.strip().splitlines()[-1]
    assert "bad.csv:1" in error
    assert "jig_radius" in error


def test_places_that_the_result_must_not_go_to(tmp_path, capsys):
    path = table(tmp_path / "a.csv", GOOD)
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


def test_rounds_are_whole_numbers(tmp_path):
    path = tmp_path / "a.csv"
    for bad in ("nan", "1.5", "-1", "1e999"):
        path.write_text(f"specimen,jig_radius,channel,resistance,round\ns,75,top,2000,{bad}\n")
        with raises(CalibrationError, "not-a-count", place="a.csv:2", column="round"):
            read_table(path, GEOMETRY)
