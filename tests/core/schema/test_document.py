"""Declared files are read with every problem named by its line, key and code."""

import pickle
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import pytest
from msgspec import Meta

from defsense_fab.core.errors import DeviceError, StudyError
from defsense_fab.core.schema.declare import Count, Positive, Problem, Table, Vector, key
from defsense_fab.core.schema.document import Document, load_document, parse_document
from defsense_fab.core.schema.fields import field
from defsense_fab.core.schema.reader import check_value, validate
from tests.support.errors import raises

Free = Literal["free"]


class Wheel(Table, frozen=True):
    """A part with a check."""

    radius: Annotated[Positive, key("Radius.", unit="mm")]
    width: Annotated[Positive | Free, key("Width.", unit="mm")] = 1.0
    turned: Annotated[
        tuple[float | Free, float | Free] | Free, key("Turn.", form='"free" or [a, b]')
    ] = (0.0, 0.0)

    def check(self):
        if self.width != "free" and self.width > self.radius:
            yield Problem(("width",), "is too wide", "too-wide", "Reduce it")


class Cart(Table, frozen=True, kw_only=True):
    """A whole file."""

    schema: Annotated[Literal[1], key("Version.")] = 1
    name: Annotated[str, key("Name.")]
    color: Annotated[str, key("Color.", choices=("red", "green"))] = "red"
    count: Annotated[Count | None, key("Count.")] = None
    load: Annotated[Annotated[float, Meta(ge=0, le=10)], key("Load.", unit="N")] = 0.0
    is_new: Annotated[bool, key("Whether it is new.")] = False
    at: Annotated[Vector | None, key("Place.", unit="mm")] = None
    points: Annotated[
        Annotated[tuple[tuple[float, float], ...], Meta(min_length=2)] | None, key("Points.")
    ] = None
    tags: Annotated[tuple[str, ...], key("Tags.", choices=("a", "b"))] = ()
    wheels: Annotated[tuple[Wheel, ...], key("Wheels.")] = ()
    parts: Annotated[dict[str, Wheel], key("Parts.")] = msgspec.field(default_factory=dict)
    weights: Annotated[tuple[dict[str, float], ...], key("Weights.")] = ()
    extra: Annotated[dict[str, Any], key("Anything.")] = msgspec.field(default_factory=dict)


def read(text):
    return parse_document(text, Path("folder/cart.toml"), StudyError).read(Cart)


def test_a_whole_file():
    cart = read(
        'name = "x"\ncount = 3.0\nload = 2\nat = [1, 2, 3]\npoints = [[1, 2], [3, 4]]\n'
        'weights = [{ a = 1 }]\nextra = { n = [1, { m = "" }] }\n'
        '[[wheels]]\nradius = 2\nturned = [1, "free"]\n[parts.x]\nradius = 3\nwidth = "free"\n'
    )
    assert (cart.count, cart.load, cart.at, cart.points) == (
        3, 2.0, (1.0, 2.0, 3.0), ((1.0, 2.0), (3.0, 4.0)),
    )  # fmt: skip
    assert isinstance(cart.load, float)
    assert isinstance(cart.count, int)
    assert cart.wheels == (Wheel(2.0, turned=(1.0, "free")),)
    assert cart.parts == {"x": Wheel(3.0, "free")}
    assert cart.weights == ({"a": 1.0},)
    assert cart.extra == {"n": [1, {"m": ""}]}


@pytest.mark.parametrize(
    ("text", "code", "key", "line"),
    [
        ("schema = true", "value-choice", "schema", 2),
        ("schema = 2", "value-choice", "schema", 2),
        ('color = "rod"', "value-choice", "color", 2),
        ("color = 3", "value-type", "color", 2),
        ('color = ""', "value-type", "color", 2),
        ("count = 0", "out-of-range", "count", 2),
        ("count = 2.5", "value-type", "count", 2),
        ("count = true", "value-type", "count", 2),
        ("load = 10.5", "out-of-range", "load", 2),
        ("load = nan", "not-finite", "load", 2),
        (f"load = {'9' * 400}", "not-finite", "load", 2),
        ('load = "3"', "value-type", "load", 2),
        ("is_new = 1", "value-type", "is_new", 2),
        ("at = [1, 2]", "wrong-shape", "at", 2),
        ("at = 3", "value-type", "at", 2),
        ("at = [1, inf, 2]", "not-finite", "at", 2),
        ("at = [1, true, 2]", "value-type", "at", 2),
        ("points = [[1, 2]]", "too-few-items", "points", 2),
        ("points = [[1, 2], [3]]", "wrong-shape", "points", 2),
        ("points = [[1, 2, 3], [1, 2, 3]]", "wrong-shape", "points", 2),
        ('tags = ["a", "c"]', "value-choice", "tags", 2),
        ("tags = [1]", "value-type", "tags", 2),
        ('tags = "a"', "value-type", "tags", 2),
        ("wheels = [1]", "value-type", "wheels", 2),
        ("wheels = [{}]", "key-missing", "wheels.1.radius", 2),
        ("wheels = [\n{ radius = 1 },\n{ radius = -1 }]", "out-of-range", "wheels.2.radius", 4),
        ("wheels = [{ radius = 1, width = 2 }]", "too-wide", "wheels.1.width", 2),
        ('wheels = [{ radius = 1, width = "x" }]', "value-type", "wheels.1.width", 2),
        ('wheels = [{ radius = 1, turned = [1, "x"] }]', "value-type", "wheels.1.turned", 2),
        ("wheels = [{ radius = 1, turned = [1] }]", "value-type", "wheels.1.turned", 2),
        ("[parts.x]\n\nradus = 1", "key-unknown", "parts.x.radus", 4),
        ("[parts]\nx = 1", "value-type", "parts.x", 3),
        ('weights = [{ a = "1" }]', "value-type", "weights.1.a", 2),
        ("extra = 1", "value-type", "extra", 2),
        ("colour = 1", "key-unknown", "colour", 2),
        ('wheels = [{ radius = "1" }]', "value-type", "wheels.1.radius", 2),
    ],
)
def test_errors_name_line_key_and_code(text, code, key, line):
    with raises(StudyError, code, key=key, line=line, file="folder/cart.toml") as caught:
        read(f'name = "x"\n{text}\n')
    (only,) = caught.value.data["errors"]
    assert str(only) == str(caught.value)
    assert only.where.startswith(f"cart.toml:{line}: {key}")


def test_a_required_key_is_missing_or_misspelt():
    with raises(StudyError, "key-missing", key="name", line=None):
        read("")
    with raises(StudyError, "key-unknown", key="nme", line=1, suggestion="name") as caught:
        read('nme = "x"')
    assert len(caught.value.data["errors"]) == 1
    with raises(StudyError, "key-unknown", suggestion=None):
        read('name = "x"\nzzz = 1')


def test_all_problems_are_reported_in_the_order_of_the_file():
    text = "[[wheels]]\nradius = -1\nwdth = 2\n[parts.x]\nradius = 1\nwidth = 3\n[extras]\n"
    with raises(StudyError, "key-missing", key="name") as caught:
        read(text)
    errors = caught.value.data["errors"]
    assert [(e.code, e.data["line"]) for e in errors] == [
        ("key-missing", None), ("out-of-range", 2), ("key-unknown", 3), ("too-wide", 6),
        ("key-unknown", 7),
    ]  # fmt: skip
    assert str(caught.value).splitlines() == [str(e) for e in errors]
    again = pickle.loads(pickle.dumps(caught.value))
    assert [e.code for e in again.data["errors"]] == [e.code for e in errors]


def test_a_file_that_cannot_be_read(tmp_path):
    with raises(DeviceError, "file-not-found"):
        load_document(tmp_path / "x.toml")
    (tmp_path / "x.toml").write_bytes(b"\xff")
    with raises(DeviceError, "toml-invalid"):
        load_document(tmp_path / "x.toml")
    with raises(DeviceError, "not-a-folder"):
        load_document(tmp_path / "x.toml" / "y.toml")
    with raises(StudyError, "toml-invalid"):
        parse_document("a = = 1", Path("x.toml"), StudyError)
    with raises(StudyError, "toml-invalid"):
        parse_document(f"a = {'9' * 5000}", Path("x.toml"), StudyError)


def test_values_without_a_text_have_no_lines():
    with raises(DeviceError, "out-of-range", key="load", line=None):
        Document({"name": "x", "load": -1}, Path("cart.toml")).read(Cart)


class Checked(Table, frozen=True):
    """A table that programs make, too."""

    share: Annotated[Annotated[float, Meta(ge=0, le=1)], key("Share.")] = 0.0
    name: Annotated[str, key("Name.")] = ""
    wheels: Annotated[tuple[Wheel, ...], key("Wheels.")] = ()

    def __post_init__(self):
        validate(self, DeviceError)


def test_tables_that_a_program_makes_can_be_checked():
    assert Checked(0.5, wheels=(Wheel(1.0),)).share == 0.5
    assert Checked().name == ""  # a default may be what a file cannot have
    with raises(DeviceError, "out-of-range", key="share"):
        Checked(2.0)
    with raises(DeviceError, "out-of-range", key="share", line=1):
        parse_document("share = 2", Path("x.toml")).read(Checked)


@pytest.mark.parametrize(("value", "digits"), [(-5, "-5"), (-0.000012345678, "-0.000012345678")])
def test_one_value_is_checked_and_named_with_all_its_digits(value, digits):
    load = field(Cart, "load")
    check_value(load, 1.5, DeviceError, "cart.toml: load", "load")
    with raises(DeviceError, "out-of-range", key="load", value=value) as caught:
        check_value(load, value, DeviceError, "cart.toml: load", "load")
    assert caught.value.where == "cart.toml: load"
    assert caught.value.problem.endswith(digits)
    with raises(StudyError, "out-of-range", key="load") as caught:
        read(f'name = "x"\nload = {value!r}')
    assert caught.value.problem.endswith(digits)


def test_one_value_of_another_type_or_choice_is_refused():
    for name, value, code in (("color", "blue", "value-choice"), ("count", 2.5, "value-type")):
        with raises(DeviceError, code, key=name):
            check_value(field(Cart, name), value, DeviceError, name, name)
