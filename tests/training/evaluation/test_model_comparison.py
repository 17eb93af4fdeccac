"""Tests between models' errors against hand-computed and library values, and by simulation."""

import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter

from defsense_fab.core.errors import TrainingError
from defsense_fab.training.evaluation.independent_blocks import (
    autocorrelation_time,
    block_length,
    block_means,
)
from defsense_fab.training.evaluation.model_comparison import (
    FrameErrors,
    analyze,
    analyze_welch,
    compare,
    compare_pairs,
)
from tests.support.errors import raises

NAMES = ("a", "b", "c")


def autoregressive(rng, count, memory, series=1):
    """Return stationary AR(1) series (series, count) with unit noise."""
    noise = rng.normal(size=(series, count + 500))
    return lfilter([1], [1, -memory], noise, axis=1)[:, 500:]


def frame_errors(name, errors, test="session", run=None):
    return FrameErrors(name, errors, np.zeros(len(errors), int) if run is None else run, test)


def test_hand_computed_values():
    """Means 2, 3 and 7 of three samples each: between 42, within 6, F = 21/1."""
    samples = [np.array([1.0, 2, 3]), np.array([2.0, 3, 4]), np.array([6.0, 7, 8])]
    result = analyze(NAMES, samples)
    assert result.anova.value == pytest.approx(21)
    assert (result.anova.between, result.anova.within) == (2, 6)
    assert result.anova.p == pytest.approx(stats.f.sf(21, 2, 6))
    assert result.eta_squared == pytest.approx(42 / 48)
    assert result.omega_squared == pytest.approx((42 - 2 * 1) / (48 + 1))
    after = compare_pairs(NAMES, samples, has_equal_variances=True)
    assert [p.difference for p in after] == pytest.approx([-1, -5, -4])
    q = 5 / np.sqrt(1 / 3)
    assert after[1].p == pytest.approx(stats.studentized_range.sf(q, 3, 6), rel=1e-6)
    assert not result.variances_differ
    assert result.valid_test is result.anova


def test_two_samples_give_the_t_test():
    rng = np.random.default_rng(0)
    a, b = rng.normal(0, 1, 12), rng.normal(1, 5, 30)
    result = analyze(NAMES[:2], [a, b])
    t = stats.ttest_ind(a, b)
    assert result.anova.value == pytest.approx(t.statistic**2)
    assert result.anova.p == pytest.approx(t.pvalue)
    uneven = stats.ttest_ind(a, b, equal_var=False)
    assert result.welch.value == pytest.approx(uneven.statistic**2)
    assert result.welch.p == pytest.approx(uneven.pvalue)
    assert result.welch.within == pytest.approx(uneven.df)
    assert result.variances_differ
    assert result.valid_test is result.welch


@pytest.mark.parametrize("alike", [True, False])
def test_pairs_agree_with_scipy(alike):
    rng = np.random.default_rng(9)
    samples = [rng.normal(m, s, n) for m, s, n in ((0, 1, 8), (1, 2, 11), (2, 4, 9))]
    library = stats.tukey_hsd(*samples, equal_var=alike)
    interval = library.confidence_interval(0.95)
    for result, at in zip(
        compare_pairs(NAMES, samples, alike), ((0, 1), (0, 2), (1, 2)), strict=True
    ):
        assert result.p == pytest.approx(library.pvalue[at], rel=1e-6)
        assert (result.low, result.high) == pytest.approx((interval.low[at], interval.high[at]))


def test_welch_agrees_with_scipy():
    """Compare Welch's test with scipy's."""
    rng = np.random.default_rng(1)
    samples = [rng.normal(0, s, n) for s, n in ((1, 10), (3, 20), (9, 15))]
    expected = stats.f_oneway(*samples, equal_var=False)
    assert analyze_welch(samples).value == pytest.approx(expected.statistic)
    assert analyze_welch(samples).p == pytest.approx(expected.pvalue)


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
    """Equal models differ significantly in nearly all tests by frame, and in 5 % by block."""
    rng = np.random.default_rng(3)
    trials = 250
    frames, blocks = 0, 0
    run = np.zeros(2000, int)
    for _ in range(trials):
        series = 2 + 0.1 * autoregressive(rng, 2000, 0.9, series=3)
        length = block_length(max(autocorrelation_time(x, run) for x in series))
        means = [block_means(x, run, length) for x in series]
        frames += stats.f_oneway(*series).pvalue < 0.05
        blocks += len(means[0]) >= 4 and analyze(NAMES, means).anova.p < 0.05
    assert 0.03 <= blocks / trials <= 0.08
    assert frames / trials > 0.7


def test_a_real_difference_is_significant():
    """Use the errors of the paper's manual, visual and optimized layouts."""
    rng = np.random.default_rng(5)
    models = [
        frame_errors(name, mean + spread * 0.4 * autoregressive(rng, 2040, 0.9)[0], test=name)
        for name, mean, spread in (
            ("manual", 4.1, 1.76),
            ("visual", 3.4, 1.33),
            ("full", 0.94, 0.7),
        )
    ]
    result = compare(models)
    assert result.by_block.valid_test.p < 1e-3
    assert result.pairs_by_block[1].first == "manual"
    assert result.pairs_by_block[1].low > 1
    assert result.by_block.omega_squared > 0.5
    assert result.paired == ()


def test_models_on_the_same_frames_are_compared_in_pairs():
    """Errors that both models share do not hide their difference."""
    rng = np.random.default_rng(6)
    shared = 2 + 0.3 * autoregressive(rng, 2000, 0.95)[0]
    own = 0.02 * autoregressive(rng, 2000, 0.5, series=2)
    models = [frame_errors("a", shared + own[0]), frame_errors("b", shared + 0.05 + own[1])]
    result = compare(models)
    assert result.by_block.anova.p > 0.5
    [pair] = result.paired
    assert pair.p < 1e-4
    assert pair.low < -0.05 < pair.high
    assert pair.samples > 50


def test_p_values_are_corrected_for_the_number_of_pairs():
    """Holm: the smallest p counts three times, the next twice."""
    rng = np.random.default_rng(7)
    series = 1 + 0.1 * rng.random((3, 400)) + np.array([[0.0], [0.004], [0.01]])
    result = compare([frame_errors(n, s) for n, s in zip(NAMES, series, strict=True)])
    plain = []
    for i, j in ((0, 1), (0, 2), (1, 2)):
        apart, run = series[i] - series[j], np.zeros(400, int)
        blocks = block_means(apart, run, block_length(autocorrelation_time(apart, run)))
        plain.append(stats.ttest_1samp(blocks, 0).pvalue)
    order = np.argsort(plain)
    expected = np.maximum.accumulate(np.array(plain)[order] * [3, 2, 1])
    assert [result.paired[k].p for k in order] == pytest.approx(np.minimum(expected, 1))


def test_too_few_blocks_give_no_test():
    rng = np.random.default_rng(8)
    models = [frame_errors(n, autoregressive(rng, 200, 0.97)[0]) for n in NAMES[:2]]
    assert compare(models).by_block is None


def test_invalid_input_is_refused():
    good = frame_errors("a", np.arange(5.0))
    with raises(TrainingError, "too-few-models"):
        compare([good])
    with raises(TrainingError, "duplicate-names"):
        compare([good, good])
    with raises(TrainingError, "not-a-number"):
        frame_errors("a", np.array([1.0, np.nan]))
    with raises(TrainingError, "errors-constant"):
        compare([frame_errors(n, np.full(50, 0.3)) for n in NAMES])
