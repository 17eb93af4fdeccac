"""The paper's numbers beside ours."""

import pytest

from defsense_fab.workflow.reproduce.experiments.experiment import PaperNumber
from defsense_fab.workflow.reproduce.results.result_files import load_kept, compute_once
from defsense_fab.workflow.reproduce.results.numbers import as_row, compare_number
from defsense_fab.workflow.reproduce.results.page import number_words


def layout(*rmse, predicted=1.0, apart=None):
    units = [
        {"chosen": {"rmse": r}, "affine": {"rmse": 2 * r},
         "told_apart": None if apart is None else {"share": apart}}
        for r in rmse
    ]  # fmt: skip
    design = {"predicted": predicted, "predicted_by_decoder": {"affine": 3 * predicted}}
    return {"design": design, "units": units}


LAYOUTS = {"manual": layout(4.0, 8.0, predicted=6.0), "full": layout(1.0, 2.0, apart=0.995)}


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
def test_means_ratios_and_what_is_expected(number, mean, met, ratio):
    found = compare_number(number, LAYOUTS)
    assert found.mean == (mean if mean is None else pytest.approx(mean))
    assert found.met is met
    assert found.ratio == (ratio if ratio is None else pytest.approx(ratio))
    words = number_words(as_row(found))
    assert (words["ours"] == "not measured") == (mean is None)


def test_results_are_kept_until_what_they_were_made_from_changes(tmp_path):
    path, made = tmp_path / "unit.json", []

    def make():
        made.append(1)
        return {"rmse": len(made)}

    assert compute_once(path, "a", make) == compute_once(path, "a", make) == {"rmse": 1}
    assert compute_once(path, "b", make) == {"rmse": 2}
    assert load_kept(path, "a") is None
    path.write_text(path.read_text("utf-8")[:10])
    assert compute_once(path, "b", make) == {"rmse": 3}
