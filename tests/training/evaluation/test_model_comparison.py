"""Tests between models' errors against library values and by simulation."""

import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter

from defsense_fab.training.evaluation.decoded_frames import DecodedFrames, OmittedFrames
from defsense_fab.training.evaluation.independent_blocks import (
    autocorrelation_time,
    block_length,
    block_means,
)
from defsense_fab.training.evaluation.model_comparison import compare

NAMES = ("a", "b", "c")


def autoregressive(rng, count, memory, series=1):
    """Return stationary AR(1) series (series, count) with unit noise."""
    noise = rng.normal(size=(series, count + 500))
    return lfilter([1], [1, -memory], noise, axis=1)[:, 500:]


def decoded(errors, start=0):
    """Return frames of one marker with these errors (t,), the first of them at `start` s."""
    count = len(errors)
    one, none = np.zeros((count, 1)), np.zeros(count, int)
    time = start + np.arange(float(count))
    measured = np.zeros((count, 1, 3))
    predicted = measured + errors[:, None, None] * [1.0, 0, 0]
    return DecodedFrames(
        ("run-1",),
        ("all",),
        none,
        none,
        time,
        time,
        predicted,
        measured,
        measured,
        one,
        one[:, 0],
        OmittedFrames(0, 0),
    )


def paired_p(difference):
    run = np.zeros(len(difference), int)
    length = block_length(autocorrelation_time(difference, run))
    return stats.ttest_1samp(block_means(difference, run, length), 0).pvalue


@pytest.mark.parametrize("memory", [0.0, 0.5, 0.9])
def test_autocorrelation_time(memory):
    """(1 + phi)/(1 - phi) of an AR(1) series, in one run or many."""
    rng = np.random.default_rng(2)
    errors = autoregressive(rng, 60_000, memory)[0]
    expected = (1 + memory) / (1 - memory)
    for runs in (1, 20):
        run = np.arange(60_000) * runs // 60_000
        assert autocorrelation_time(errors, run) == pytest.approx(expected, rel=0.1)


def test_constant_errors_count_as_independent():
    assert autocorrelation_time(np.full(100, 0.3), np.zeros(100, int)) == 1


def test_blocks_do_not_span_runs():
    run = np.repeat([0, 1, 2], [10, 3, 8])
    errors = run.astype(float)
    assert block_means(errors, run, 4).tolist() == [0, 0, 2, 2]
    assert block_means(np.arange(10.0), run[:10], 4).tolist() == [2, 7]


def test_correlated_frames_are_not_independent_samples():
    """Equal models differ significantly in most tests by frame, and in 5 % by block."""
    rng = np.random.default_rng(3)
    trials = 250
    by_frame = by_block = 0
    for _ in range(trials):
        first, second = 2 + 0.1 * autoregressive(rng, 2000, 0.9, series=2)
        by_frame += stats.ttest_1samp(first - second, 0).pvalue < 0.05
        [test] = compare([("a", decoded(first)), ("b", decoded(second))]).tests
        by_block += test.p < 0.05
    assert 0.03 <= by_block / trials <= 0.08
    assert by_frame / trials > 0.6


def test_shared_errors_do_not_hide_a_difference():
    rng = np.random.default_rng(6)
    shared = 9 + 0.3 * autoregressive(rng, 2000, 0.95)[0]
    first, second = shared + 0.02 * autoregressive(rng, 2000, 0.5, series=2) + [[0], [0.05]]
    result = compare([("a", decoded(first)), ("b", decoded(second))])
    [test] = result.tests
    assert result.means == pytest.approx([first.mean(), second.mean()])
    assert (test.first, test.second) == result.names == ("a", "b")
    assert test.p == pytest.approx(paired_p(first - second))
    assert test.p < 1e-4
    assert test.low < -0.05 < test.high
    assert test.blocks > 50
    assert test.blocks * test.block_frames <= 2000


def test_p_values_are_corrected_for_the_number_of_pairs():
    """Holm: the smallest p counts three times, the next twice."""
    rng = np.random.default_rng(7)
    series = 1 + 0.1 * rng.random((3, 400)) + np.array([[0.0], [0.004], [0.01]])
    result = compare([(n, decoded(s)) for n, s in zip(NAMES, series, strict=True)])
    plain = [paired_p(series[i] - series[j]) for i, j in ((0, 1), (0, 2), (1, 2))]
    order = np.argsort(plain)
    expected = np.maximum.accumulate(np.array(plain)[order] * [3, 2, 1])
    assert [result.tests[k].p for k in order] == pytest.approx(np.minimum(expected, 1))


def test_only_common_frames_are_compared():
    """The second model has no frames in the first 50 s, and the first none in the last 50 s."""
    rng = np.random.default_rng(4)
    first, second = 1 + rng.random((2, 400))
    result = compare([("a", decoded(first)), ("b", decoded(second, start=50))])
    assert result.means == pytest.approx([first[50:].mean(), second[:-50].mean()])
    [test] = result.tests
    assert test.difference == pytest.approx((first[50:] - second[:-50]).mean(), abs=2e-3)
    nothing = compare([("a", decoded(first)), ("b", decoded(second, start=1e4))])
    assert nothing.tests == ()
    assert np.isnan(nothing.means).all()


def test_too_few_blocks_give_no_test():
    rng = np.random.default_rng(8)
    models = [(n, decoded(autoregressive(rng, 200, 0.97)[0])) for n in NAMES[:2]]
    assert compare(models).tests == ()


def test_equal_errors_do_not_differ():
    errors = np.full(50, 0.3)
    assert compare([("a", decoded(errors)), ("b", decoded(errors))]).tests[0].p == 1
    assert compare([("a", decoded(errors)), ("b", decoded(errors + 0.5))]).tests[0].p == 0
