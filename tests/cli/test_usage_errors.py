"""Errors in the words of a command line have a code, and one line that names the place."""

import pytest

from defsense_fab.cli.main import main, parse
from defsense_fab.core.errors import DefsenseError
from tests.support.errors import raises

WRONG_WORDS = [
    ("bild", "unknown-command", ("build",)),
    ("capture bord", "unknown-command", ("board",)),
    ("--versoin", "unknown-option", ("--version",)),
    ("build x --bde 1", "unknown-option", ("--bed",)),
    ("build x --no-json", "unknown-option", ("--json",)),
    ("new --cord rubber-2mm", "argument-missing", ("FOLDER",)),
    ("modes x", "argument-missing", ("--fixed",)),
    ("build x --copies", "argument-missing", ("--copies",)),
    ("build x --bed 220 220", "argument-missing", ("--bed", "3", "2")),
    ("build x --bed 220,220", "argument-invalid", ("--bed", "3", "2")),
    ("build x --bed 220,220,250,1", "argument-invalid", ("--bed", "3", "4")),
    ("build x --bed 220,220,z", "argument-invalid", ("--bed", "'z'")),
    ("build x --copies many", "argument-invalid", ("--copies", "'many'")),
    ("build x --copies 1.5", "argument-invalid", ("--copies", "'1.5'")),
    ("completion bahs", "argument-invalid", ("SHELL", "bash")),
    ("build x --copies 1 --copies 2", "argument-repeated", ("--copies",)),
    ("build x y", "argument-unexpected", ("'y'",)),
    ("build x --copies 0", "out-of-range", ("--copies",)),
    ("new x --cord rope", "unknown-cord", ("rope", "rubber-2mm")),
    ("new x --poses fly", "unknown-pose", ("fly", "bend")),
]


@pytest.mark.parametrize(("line", "code"), [(line, code) for line, code, _ in WRONG_WORDS])
def test_wrong_words_have_a_code(line, code):
    with raises(DefsenseError, code):
        parse(line.split())


@pytest.mark.parametrize(("line", "facts"), [(line, facts) for line, _, facts in WRONG_WORDS])
def test_error_is_one_line_that_names_the_place_and_an_action(line, facts, capsys):
    assert main(line.split()) == 2
    out, err = capsys.readouterr()
    assert not out
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert err.endswith(".\n")
    for fact in facts:
        assert fact in err


def test_flag_of_an_option_is_named_instead_of_its_field(capsys):
    assert main(["new", "x", "--edge-length", "-1"]) == 2
    assert capsys.readouterr().err.startswith("error: --edge-length: ")


@pytest.mark.parametrize(
    ("line", "bed"),
    [
        ("build x --bed 220,220,250", (220, 220, 250)),
        ("build x --bed=220,220,250", (220, 220, 250)),
        ("build x --bed 220 220 250", (220, 220, 250)),
        ("build --bed 220,220,250 x", (220, 220, 250)),
    ],
)
def test_items_of_a_list_are_separated_by_commas_or_spaces(line, bed):
    _, bound = parse(line.split())
    assert bound.arguments["options"].bed == bed


@pytest.mark.parametrize("line", ["new x --poses bend,twist", "new x --poses bend --poses twist"])
def test_list_of_any_length_may_be_repeated(line):
    _, bound = parse(line.split())
    assert bound.arguments["options"].poses == ("bend", "twist")


def test_text_with_commas_is_not_separated():
    _, bound = parse(["mesh", "x", "--set", "points=[1,2]", "--set", 'name="a,b"'])
    assert bound.arguments["overrides"] == ("points=[1,2]", 'name="a,b"')
