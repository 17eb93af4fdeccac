"""Pages, comments, forms and JSON Schemas agree with what the reader accepts."""

import json
import re
import tomllib
from pathlib import Path

import pytest

from defsense_fab.core.device.device_file import DeviceFile
from defsense_fab.core.errors import DefsenseError
from defsense_fab.core.schema.document import parse_document
from defsense_fab.core.schema.fields import field, sections
from defsense_fab.core.schema.reader import Reader
from defsense_fab.core.schema.reference import as_toml, commented, json_schema, markdown
from defsense_fab.core.schema.types import members, number_shape
from defsense_fab.runtime.outputs.live_file import LiveFile
from defsense_fab.workflow.reproduce.experiment import ExperimentFile
from defsense_fab.workflow.study.study_file import StudyFile
from tests.support.places import BAR, DEVICES, ROOT

KINDS = {
    "device": DeviceFile, "live": LiveFile, "study": StudyFile, "experiment": ExperimentFile,
}  # fmt: skip
FILES = [
    (kind, path)
    for folder in ("fixtures", "examples", "tests")
    for path in sorted(Path(ROOT, folder).rglob("*.toml"))
    if (kind := KINDS.get(path.stem)) and "build" not in path.parts
]


def every_field():
    return [(s, f) for kind in KINDS.values() for s in sections(kind) for f in s.fields]


def test_every_key_is_described_by_a_sentence():
    fields = every_field()
    assert len(fields) > 180
    for section, f in fields:
        text = f"{section.header} {f.name}: {f.description!r}"
        assert re.fullmatch(r"[A-Z(].*\.", f.description), text
        assert "|" not in f.description + f.default_words, text
        assert f.is_required or f.default is not None or f.default_words or f.choices or (
            f.catalogue_default or f.tables
        ), text  # fmt: skip


@pytest.mark.parametrize("name", KINDS)
def test_the_page_has_a_row_for_every_key_and_its_links_lead_somewhere(name):
    text = markdown(KINDS[name])
    rows = [line for line in text.splitlines() if line.startswith("| `")]
    assert len(rows) == sum(len(s.fields) for s in sections(KINDS[name]))
    assert all(len(re.split(r"(?<!\\)\|", row)) == 6 for row in rows)
    headings = re.findall(r"^### `(.*)`$", text, re.M)
    anchors = {re.sub(r"[^a-z0-9]+", "-", h.lower()).strip("-") for h in headings}
    assert set(re.findall(r"\(#([^)]*)\)", text)) <= anchors
    assert len(headings) == len(set(headings))


def test_the_page_has_units_bounds_choices_and_defaults():
    rows = {line.split("`")[1]: line for line in markdown(DeviceFile).splitlines() if "| `" in line}
    assert "| number, mm, above 0 | `1.1` |" in rows["wire_diameter"]
    assert "| number, from 0.0001 to 0.2 | this or `edge_length` |" in rows["accuracy"]
    assert '| `held`, `bonded` | `"held"` |' in rows["assembly"]
    assert "| the row's: `1` to `1.8` |" in rows["wall"]
    assert rows["process"].endswith('| `"fdm-tpu"` |')


def test_a_field_has_what_a_form_needs():
    edge = field(DeviceFile, "mesh.edge_length")
    assert (edge.label, edge.unit, edge.bounds) == ("Edge length, mm", "mm", (0.0, None))
    copies = field(DeviceFile, "fabrication.copies")
    assert (copies.label, copies.bounds, copies.default) == ("Copies", (1, 100), 1)
    assert field(DeviceFile, "design.prefer").choices == ("simple", "accuracy")
    assert field(DeviceFile, "poses.handles.region").is_required
    with pytest.raises(KeyError):
        field(DeviceFile, "mesh.edge")


@pytest.mark.parametrize("path", sorted(DEVICES.glob("*/device.toml")), ids=lambda p: p.parent.name)
def test_comments_change_no_value_and_stand_once(path):
    text = path.read_text(encoding="utf-8")
    result = commented(text, DeviceFile)
    assert tomllib.loads(result) == tomllib.loads(text)
    added = [line for line in result.splitlines() if line.startswith("# ")]
    assert len(added) > 15
    assert max(map(len, added)) <= 88
    assert commented(result, DeviceFile) == result
    assert commented("# mine\nname = 1\nname = 2", DeviceFile) == "# mine\nname = 1\nname = 2"


def check(value, schema, whole):
    """Whether a value is valid, by as much of JSON Schema as is used here."""
    if "$ref" in schema:
        schema = whole["$defs"][schema["$ref"].rpartition("/")[2]]
    if "anyOf" in schema and not any(check(value, option, whole) for option in schema["anyOf"]):
        return False
    if "enum" in schema and value not in schema["enum"]:
        return False
    kinds = {"object": dict, "array": list, "string": str, "boolean": bool, "integer": int,
             "number": (int, float)}  # fmt: skip
    kind = schema.get("type")
    if kind and (not isinstance(value, kinds[kind]) or (
        isinstance(value, bool) and kind != "boolean"
    )):  # fmt: skip
        return False
    if isinstance(value, dict):
        known, other = schema.get("properties", {}), schema.get("additionalProperties", True)
        if not set(schema.get("required", ())) <= set(value):
            return False
        for name, item in value.items():
            inner = known.get(name, other)
            if inner is False or (isinstance(inner, dict) and not check(item, inner, whole)):
                return False
    if isinstance(value, list):
        if not schema.get("minItems", 0) <= len(value) <= schema.get("maxItems", len(value)):
            return False
        items = schema.get("items", {})
        each = items if isinstance(items, list) else [items] * len(value)
        return all(check(v, s, whole) for v, s in zip(value, each, strict=False) if s)
    if isinstance(value, int | float) and not isinstance(value, bool):
        return (
            schema.get("minimum", value) <= value <= schema.get("maximum", value)
            and value > schema.get("exclusiveMinimum", value - 1)
            and value < schema.get("exclusiveMaximum", value + 1)
        )
    return True


@pytest.mark.parametrize(("kind", "path"), FILES, ids=lambda x: getattr(x, "stem", ""))
def test_the_json_schema_accepts_the_files_of_the_repository(kind, path):
    schema = json_schema(kind)
    assert json.loads(json.dumps(schema)) == schema
    values = tomllib.loads(path.read_text(encoding="utf-8"))
    assert check(values, schema, schema)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("edge_length", "edge_lenght"),
        ("edge_length = 8.0", "edge_length = -1"),
        ("edge_length = 8.0", 'edge_length = "6"'),
        ("axis = [0, 1, 0]", "axis = [0, 1]"),
        ('translate = "free"', 'translate = "fre"'),
        ('free = ["path", "plane"]', 'free = ["paths"]'),
        ('process = "fdm-tpu"', 'process = "fdm"'),
        ("schema = 1", "schema = 2"),
        ('name = "bar"\n', ""),
    ],
)
def test_reader_and_json_schema_refuse_the_same(old, new):
    schema = json_schema(DeviceFile)
    text = (BAR / "device.toml").read_text(encoding="utf-8")
    assert old in text
    wrong = text.replace(old, new, 1)
    assert not check(tomllib.loads(wrong), schema, schema)
    with pytest.raises(DefsenseError):
        parse_document(wrong, BAR / "device.toml").read(DeviceFile)


def test_the_bounds_of_the_page_are_those_of_the_reader():
    count = 0
    for section, f in every_field():
        if f.numbers is None or number_shape(members(f.kind)[0]) != ():
            continue
        low, high = f.bounds
        beyond = [x for x in (low and low - 1, high and high + 1, low == 0 and -1) if x]
        for value in beyond:
            reader = Reader()
            reader.read_value(f.kind, value, (f.name,))
            assert [p.code for p in reader.problems] == ["out-of-range"], (section.header, f.name)
            count += 1
    assert count > 60


def test_values_are_written_as_toml():
    for value in (True, 1, 0.25, "a", [1.5, 2], ("x",)):
        assert tomllib.loads(f"x = {as_toml(value)}")["x"] == (
            list(value) if isinstance(value, tuple) else value
        )
