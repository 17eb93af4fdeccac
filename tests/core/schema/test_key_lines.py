"""Lines of keys: against the lines on which generated texts have them, and against tomllib."""

import tomllib
from pathlib import Path

from hypothesis import given, settings
from hypothesis import strategies as st

from defsense_fab.core.schema.key_lines import key_lines
from tests.support.places import ROOT

TEXT = '''# a comment with [brackets] = and "quotes"
name = "a # b"        # one more
a.b."c d" = 1
'x.y' = 2
[table]
long = """
[not.a.header]
key = 1 \\""" """
points = [
    [1, 2],  # [3]
    [3,
     4],
]
inline = { one = 1, two = { three = [ { four = 4 } ] } }
[[list]]
k = 1
[list.sub]
m = 1
[[list.rows]]
[[list.rows]]
n = ''\'
a = 1''\'
[[list]]
k = [{ a = 1 },
     { b.c = 2 }]
'''


def test_every_form_of_toml():
    assert tomllib.loads(TEXT)
    assert dict(key_lines(TEXT)) == {
        ("name",): 2, ("a",): 3, ("a", "b"): 3, ("a", "b", "c d"): 3, ("x.y",): 4,
        ("table",): 5, ("table", "long"): 6, ("table", "points"): 9,
        ("table", "points", 0): 10, ("table", "points", 0, 0): 10, ("table", "points", 0, 1): 10,
        ("table", "points", 1): 11, ("table", "points", 1, 0): 11, ("table", "points", 1, 1): 12,
        ("table", "inline"): 14, ("table", "inline", "one"): 14, ("table", "inline", "two"): 14,
        ("table", "inline", "two", "three"): 14, ("table", "inline", "two", "three", 0): 14,
        ("table", "inline", "two", "three", 0, "four"): 14,
        ("list",): 15, ("list", 0): 15, ("list", 0, "k"): 16,
        ("list", 0, "sub"): 17, ("list", 0, "sub", "m"): 18,
        ("list", 0, "rows"): 19, ("list", 0, "rows", 0): 19, ("list", 0, "rows", 1): 20,
        ("list", 0, "rows", 1, "n"): 21,
        ("list", 1): 23, ("list", 1, "k"): 24, ("list", 1, "k", 0): 24,
        ("list", 1, "k", 0, "a"): 24, ("list", 1, "k", 1): 25, ("list", 1, "k", 1, "b"): 25,
        ("list", 1, "k", 1, "b", "c"): 25,
    }  # fmt: skip


def paths(values, at=()):
    """All paths of parsed values."""
    items = values.items() if isinstance(values, dict) else enumerate(values)
    for key, value in items:
        yield (*at, key)
        if isinstance(value, dict | list):
            yield from paths(value, (*at, key))


NAMES = st.sampled_from(["a", "b-c", "d_1", '"e f"', "'g.h'", '"i\\"j"'])
SCALARS = st.sampled_from(
    ["1", "-2.5e3", "true", "nan", "1979-05-27 07:32:00Z", '"#]}"', "'=['", '"\\"x\\\\"',
     '"""\n[h]\nk = 1\n"""', "'''\n\"\"\"\n'''", '""""q"""']
)  # fmt: skip
GAPS = st.sampled_from(["", " ", "\n", "  # [x] = '\n"])


@st.composite
def values(draw, depth=2):
    """A value as it is written, on one line or several."""
    kind = draw(st.integers(0, 3)) if depth else 0
    if kind < 2:
        return draw(SCALARS)
    if kind == 2:
        items = [draw(values(depth - 1)) + draw(GAPS) for _ in range(draw(st.integers(0, 3)))]
        return f"[{draw(GAPS)}{','.join(items)}]"
    names = draw(st.lists(NAMES, unique=True, max_size=3))
    return "{" + ", ".join(f"{n} = {draw(values(depth - 1))}" for n in names) + "}"


@st.composite
def documents(draw):
    """A text, with the line of each key that starts a line, by its path."""
    lines, expected, count = [], {}, {}
    for _ in range(draw(st.integers(0, 5))):
        lines += draw(st.sampled_from([[], [""], ["# [c] d = 1"]]))
        line = sum(part.count("\n") + 1 for part in lines) + 1
        name = draw(NAMES)
        table = (next(iter(tomllib.loads(f"{name} = 1"))),)
        is_list = table in count or draw(st.booleans())
        if not is_list and table in expected:
            continue
        if is_list and table in expected and table not in count:
            continue
        lines.append(f"[[{name}]]" if is_list else f"[ {name} ]  # x")
        expected.setdefault(table, line)
        if is_list:
            count[table] = count.get(table, -1) + 1
            table = (*table, count[table])
            expected[table] = line
        for key in draw(st.lists(NAMES, unique=True, max_size=3)):
            line = sum(part.count("\n") + 1 for part in lines) + 1
            lines.append(f"{key}\t=  {draw(values())}")
            expected[*table, next(iter(tomllib.loads(f"{key} = 1")))] = line
    return "\n".join(lines) + "\n", expected


@settings(max_examples=300, deadline=None)
@given(documents())
def test_lines_are_those_of_the_text_and_paths_those_of_tomllib(case):
    text, expected = case
    found = key_lines(text)
    assert set(found) == set(paths(tomllib.loads(text)))
    assert {path: found[path] for path in expected} == expected
    assert dict(key_lines(text.replace("\n", "\r\n"))) == dict(found)


def test_files_of_the_repository():
    files = [*Path(ROOT, "fixtures").rglob("*.toml"), *Path(ROOT, "examples").rglob("*.toml")]
    files.append(Path(ROOT, "pyproject.toml"))
    for path in files:
        text = path.read_text(encoding="utf-8")
        lines = text.splitlines()
        found = key_lines(text)
        assert set(found) == set(paths(tomllib.loads(text))), path
        for key, line in found.items():
            assert not isinstance(key[-1], str) or key[-1] in lines[line - 1], (path, key)
    assert len(files) > 10
