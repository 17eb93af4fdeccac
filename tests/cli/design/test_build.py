"""Notes that `build` prints below the table of predicted errors."""

from types import SimpleNamespace

import pytest

from defsense_fab.cli.design.build import note_better_decoder, note_worse_than_start
from defsense_fab.cli.main import run_command
from defsense_fab.core.errors import DeviceError, TrainingError
from tests.support.errors import raises
from tests.support.places import BAR


def layout(decoder="affine", how="held out", initial=1.0, final=0.9):
    """Return the fields of a layout's record that the notes read."""
    return SimpleNamespace(
        unseen={"affine": final, "quadratic": 0.4, "kernel": 0.6},
        prediction=SimpleNamespace(decoder=decoder, how=how, unseen=final),
        initial=SimpleNamespace(unseen=initial),
    )


def test_note_on_a_better_decoder_only_for_the_affine_map():
    (note,) = note_better_decoder(layout())
    assert all(word in note for word in ("affine", "0.90", "quadratic", "0.40"))
    assert note_better_decoder(layout("kernel")) == []
    assert note_better_decoder(layout(how="none")) == []
    assert note_better_decoder(layout(final=0.3)) == []


@pytest.mark.parametrize(("initial", "count"), [(1.0, 0), (0.9, 0), (0.8996, 0), (0.89, 1)])
def test_note_on_a_search_that_ends_worse_than_its_start(initial, count):
    assert len(note_worse_than_start(layout(initial=initial))) == count


@pytest.mark.parametrize(("bed", "value"), [("10,220,250", 10), ("220,220,9000", 9000)])
def test_bed_size_is_checked(bed, value):
    with raises(DeviceError, "out-of-range", value=value) as caught:
        run_command(["build", str(BAR), "--bed", bed])
    assert caught.value.where == "--bed"


def test_copies_are_checked():
    with raises(DeviceError, "out-of-range", value=0) as caught:
        run_command(["build", str(BAR), "--copies", "0"])
    assert caught.value.where == "--copies"


@pytest.mark.parametrize(
    ("command", "option", "value"),
    [
        ("mesh", "--scheduler", "tcp://x:1"),
        ("mesh", "--copies", "2"),
        ("optimize", "--copies", "2"),
    ],
)
def test_options_that_a_stage_does_not_use_are_refused(command, option, value):
    with raises(DeviceError, "options-conflict") as caught:
        run_command([command, str(BAR), option, value])
    assert caught.value.where == option


def test_missing_option_is_named_by_its_flag():
    with raises(TrainingError, "file-not-found", missing="tracks") as caught:
        run_command(["train", "--signals", "a.csv"])
    assert caught.value.where == "--tracks"
