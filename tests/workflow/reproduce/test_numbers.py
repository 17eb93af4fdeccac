"""Comparison of the paper's numbers with ours, and kept results."""

import pytest

from defsense_fab.workflow.reproduce.experiment import PaperNumber
from defsense_fab.workflow.reproduce.page import compare_number, format_number
from defsense_fab.workflow.reproduce.result_files import compute_once, load_kept


def of(layout, quantity, **values):
    return PaperNumber(layout=layout, quantity=quantity, **values)


def make_results(*rmse, predicted=1.0, recognized=None):
    units = [
        {
            "chosen": {"rmse": r},
            "affine": {"rmse": 2 * r},
            "told_apart": None if recognized is None else {"share": recognized},
        }
        for r in rmse
    ]
    design = {"predicted": predicted, "predicted_by_decoder": {"affine": 3 * predicted}}
    return {"design": design, "units": units}


LAYOUTS = {
    "manual": make_results(4.0, 8.0, predicted=6.0),
    "full": make_results(1.0, 2.0, recognized=0.995),
}


@pytest.mark.parametrize(
    ("number", "mean", "met", "ratio"),
    [
        (of("full", "rmse", paper=1.2, at_most=1.5), 1.5, True, 1.25),
        (of("full", "rmse", paper=1.2, at_most=1.17), 1.5, False, 1.25),
        (of("full", "rmse", decoder="affine"), 3.0, None, None),
        (of("manual", "rmse", over="full", at_least=3.8), 4.0, True, None),
        (of("manual", "predicted", over="full", at_least=6.5), 6.0, False, None),
        (of("full", "predicted", decoder="affine"), 3.0, None, None),
        (of("full", "told_apart", at_least=0.99), 0.995, True, None),
        (of("manual", "told_apart", at_least=0.99), None, None, None),
        (of("visual", "rmse", at_most=1.0), None, None, None),
    ],
)
def test_means_ratios_and_expectations(number, mean, met, ratio):
    row = compare_number(number, LAYOUTS)
    assert row["ours"] == (mean if mean is None else pytest.approx(mean))
    assert row["met"] is met
    assert row["ratio"] == (ratio if ratio is None else pytest.approx(ratio))
    is_unknown = format_number(row)["ours"] == format_number({**row, "ours": None})["ours"]
    assert is_unknown == (mean is None)


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
