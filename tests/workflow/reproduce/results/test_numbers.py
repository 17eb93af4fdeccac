"""Comparison of the paper's numbers with ours, and kept results."""

import pytest

from defsense_fab.workflow.reproduce.experiments.experiment import PaperNumber
from defsense_fab.workflow.reproduce.results.numbers import as_row, compare_number
from defsense_fab.workflow.reproduce.results.page import format_number
from defsense_fab.workflow.reproduce.results.result_files import compute_once, load_kept


def make_results(*rmse, predicted=1.0, recognized=None):
    units = [
        {"chosen": {"rmse": r}, "affine": {"rmse": 2 * r},
         "told_apart": None if recognized is None else {"share": recognized}}
        for r in rmse
    ]  # fmt: skip
    design = {"predicted": predicted, "predicted_by_decoder": {"affine": 3 * predicted}}
    return {"design": design, "units": units}


LAYOUTS = {
    "manual": make_results(4.0, 8.0, predicted=6.0),
    "full": make_results(1.0, 2.0, recognized=0.995),
}


@pytest.mark.parametrize(
    ("number", "mean", "met", "ratio"),
    [
        (PaperNumber("full", "rmse", paper=1.2, at_most=1.5), 1.5, True, 1.25),
        (PaperNumber("full", "rmse", paper=1.2, at_most=1.17), 1.5, False, 1.25),
        (PaperNumber("full", "rmse", decoder="affine"), 3.0, None, None),
        (PaperNumber("manual", "rmse", over="full", at_least=3.8), 4.0, True, None),
        (PaperNumber("manual", "predicted", over="full", at_least=6.5), 6.0, False, None),
        (PaperNumber("full", "predicted", decoder="affine"), 3.0, None, None),
        (PaperNumber("full", "told_apart", at_least=0.99), 0.995, True, None),
        (PaperNumber("manual", "told_apart", at_least=0.99), None, None, None),
        (PaperNumber("visual", "rmse", at_most=1.0), None, None, None),
    ],
)
def test_means_ratios_and_expectations(number, mean, met, ratio):
    compared = compare_number(number, LAYOUTS)
    assert compared.mean == (mean if mean is None else pytest.approx(mean))
    assert compared.met is met
    assert compared.ratio == (ratio if ratio is None else pytest.approx(ratio))
    texts = format_number(as_row(compared))
    assert (texts["ours"] == format_number({**as_row(compared), "ours": None})["ours"]) == (
        mean is None
    )


def test_results_are_kept_until_their_inputs_change(tmp_path):
    path, calls = tmp_path / "unit.json", []

    def make():
        calls.append(1)
        return {"rmse": len(calls)}

    assert compute_once(path, "a", make) == compute_once(path, "a", make) == {"rmse": 1}
    assert compute_once(path, "b", make) == {"rmse": 2}
    assert load_kept(path, "a") is None
    path.write_text(path.read_text("utf-8")[:10])
    assert compute_once(path, "b", make) == {"rmse": 3}
