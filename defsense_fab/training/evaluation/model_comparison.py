"""Whether one model's errors are smaller than another's, or only happened to be.

One-way analysis of variance of the frames' errors, as DefSense has it, and what it leaves out:
frames are not independent. Both are given: `by_frame` takes each frame for a sample of its own,
`by_block` the means of blocks that are long beside the errors' autocorrelation time. The second
is the one to believe.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from ...core.arrays import Float, Int
from ...core.errors import TrainingError
from .independent_blocks import autocorrelation_time, block_length, block_means

#: Below this probability of chance something counts as different.
LEVEL = 0.05
_FEWEST = 4  # blocks of each model


@dataclass(frozen=True)
class FrameErrors:
    """Errors (t,) mm of a model's or layout's test frames, and the run (t,) each belongs to.
    `test` names the frames: models with the same were tested on the same."""

    name: str
    errors: Float
    run: Int
    test: str

    def __post_init__(self) -> None:
        if self.errors.shape != self.run.shape or not len(self.errors):
            raise TrainingError(
                f"{self.name}: there are no errors of frames to compare", code="no-frames"
            )
        if not np.isfinite(self.errors).all():
            raise TrainingError(
                f"{self.name}: errors of frames must be numbers", code="not-a-number"
            )


@dataclass(frozen=True)
class Statistic:
    """The value of a test with its degrees of freedom (between, within; NaN where it has none), and
    the probability `p` of one as large by chance."""

    value: float
    between: float
    within: float
    p: float


@dataclass(frozen=True)
class Pair:
    """The mean error of `first` less that of `second`, mm, with its 95 % interval and the
    probability of chance, for all pairs together: Tukey's HSD, or Games and Howell's where
    variances differ."""

    first: str
    second: str
    difference: float
    low: float
    high: float
    p: float


@dataclass(frozen=True)
class PairedTest:
    """As a `Pair`, from the differences block by block of models that were tested on the same
    frames, `samples` of them: paired t tests, p corrected for their number (Holm)."""

    first: str
    second: str
    difference: float
    low: float
    high: float
    p: float
    samples: int


@dataclass(frozen=True)
class Analysis:
    """Of `samples` (k,) of each of k models: analysis of variance, whether their variances differ
    (`levene`), what does not mind (`welch`) and what does not even mind how they are spread
    (`kruskal`). Effect sizes: `eta_squared`, the share of the variance that is
    between models, and `omega_squared`, the same without what chance puts there."""

    samples: tuple[int, ...]
    anova: Statistic
    levene: Statistic
    welch: Statistic
    kruskal: Statistic
    eta_squared: float
    omega_squared: float

    @property
    def variances_differ(self) -> bool:
        """So that Welch's test and Games and Howell's pairs hold, and the others do not."""
        return self.levene.p < LEVEL

    @property
    def told(self) -> Statistic:
        """The test that holds."""
        return self.welch if self.variances_differ else self.anova


@dataclass(frozen=True)
class Comparison:
    """Of models by name with their mean errors (k,) mm; `times` (k,) are the autocorrelation
    times and `length` that of the blocks, in frames. `by_block` is None, and its pairs empty, where
    there are too few blocks for any test; `paired` is empty where test frames differ."""

    names: tuple[str, ...]
    means: Float
    times: Float
    length: int
    by_frame: Analysis
    pairs_by_frame: tuple[Pair, ...]
    by_block: Analysis | None
    pairs_by_block: tuple[Pair, ...]
    paired: tuple[PairedTest, ...]


def compare(models: Sequence[FrameErrors]) -> Comparison:
    """Two models or more. Raises TrainingError for fewer, or for names that repeat."""
    names = tuple(m.name for m in models)
    if len(models) < 2:
        raise TrainingError(
            f"comparing {', '.join(names) or 'nothing'}: give two models or more",
            code="too-few-models",
        )
    if len(set(names)) < len(names):
        raise TrainingError(
            f"comparing {', '.join(names)}: give models of different names",
            code="duplicate-names",
        )
    times = np.array([autocorrelation_time(m.errors, m.run) for m in models])
    length = block_length(float(times.max()))
    frames = [m.errors for m in models]
    blocks = [block_means(m.errors, m.run, length) for m in models]
    by_frame = analyse(names, frames)
    by_block = analyse(names, blocks) if min(map(len, blocks)) >= _FEWEST else None
    same = len({m.test for m in models}) == 1 and len({len(m.errors) for m in models}) == 1
    return Comparison(
        names=names,
        means=np.array([m.errors.mean() for m in models]),
        times=times,
        length=length,
        by_frame=by_frame,
        pairs_by_frame=pairs(names, frames, not by_frame.variances_differ),
        by_block=by_block,
        pairs_by_block=pairs(names, blocks, not by_block.variances_differ) if by_block else (),
        paired=paired_tests(models) if same else (),
    )


def analyse(names: Sequence[str], samples: Sequence[Float]) -> Analysis:
    """Of independent samples (n_k,) of each of k models."""
    from scipy import stats

    k, counts = len(samples), np.array([len(x) for x in samples])
    total = int(counts.sum())
    grand = np.concatenate(list(samples)).mean()
    between = float(sum(n * (x.mean() - grand) ** 2 for n, x in zip(counts, samples, strict=True)))
    within = float(sum(((x - x.mean()) ** 2).sum() for x in samples))
    if within <= 1e-24 * (between + total * grand**2):
        raise TrainingError(
            f"comparing {', '.join(names)}: the errors of each do not vary at all, which leaves"
            " nothing to test; were they measured?",
            code="errors-constant",
        )
    anova = stats.f_oneway(*samples)
    levene = stats.levene(*samples)  # about medians (Brown and Forsythe)
    kruskal = stats.kruskal(*samples)
    error = within / (total - k)
    tests = (
        Statistic(float(anova.statistic), k - 1, total - k, float(anova.pvalue)),
        Statistic(float(levene.statistic), k - 1, total - k, float(levene.pvalue)),
        welch(samples),
        Statistic(float(kruskal.statistic), k - 1, np.nan, float(kruskal.pvalue)),
    )
    return Analysis(
        tuple(int(n) for n in counts), *tests,
        eta_squared=between / (between + within),
        omega_squared=max((between - (k - 1) * error) / (between + within + error), 0.0),
    )  # fmt: skip


def welch(samples: Sequence[Float]) -> Statistic:
    """Analysis of variance of samples whose variances differ (Welch 1951)."""
    from scipy import stats

    n, k = np.array([len(x) for x in samples]), len(samples)
    mean = np.array([x.mean() for x in samples])
    with np.errstate(divide="ignore"):
        w = n / np.array([x.var(ddof=1) for x in samples])
    if not np.isfinite(w).all():  # one does not vary
        return Statistic(np.nan, k - 1, np.nan, np.nan)
    grand = (w * mean).sum() / w.sum()
    doubt = ((1 - w / w.sum()) ** 2 / (n - 1)).sum()
    statistic = (w * (mean - grand) ** 2).sum() / (k - 1)
    statistic /= 1 + 2 * (k - 2) / (k**2 - 1) * doubt
    freedom = (k**2 - 1) / (3 * doubt)
    return Statistic(
        float(statistic), k - 1, float(freedom), float(stats.f.sf(statistic, k - 1, freedom))
    )


def paired_tests(models: Sequence[FrameErrors]) -> tuple[PairedTest, ...]:
    """Of models with the same test frames, pair by pair, on means of blocks of their differences;
    pairs of too few blocks are left out."""
    from scipy import stats

    found = []
    for first, second in combinations(models, 2):
        apart = first.errors - second.errors
        blocks = block_means(apart, first.run, block_length(autocorrelation_time(apart, first.run)))
        if len(blocks) < _FEWEST:
            continue
        n, mean = len(blocks), float(blocks.mean())
        error = float(blocks.std(ddof=1) / np.sqrt(n))
        reach = float(stats.t.ppf(1 - LEVEL / 2, n - 1)) * error
        if error > 0:
            p = float(2 * stats.t.sf(abs(mean) / error, n - 1))
        else:
            p = 1.0 if mean == 0 else 0.0
        found.append(PairedTest(first.name, second.name, mean, mean - reach, mean + reach, p, n))
    return _holm(found)


def _holm(found: Sequence[PairedTest]) -> tuple[PairedTest, ...]:
    """p corrected for the number of tests (Holm 1979)."""
    corrected, largest = list(found), 0.0
    for rank, at in enumerate(np.argsort([test.p for test in found])):
        largest = max(largest, min((len(found) - rank) * found[at].p, 1.0))
        corrected[at] = replace(found[at], p=largest)
    return tuple(corrected)


def pairs(names: Sequence[str], samples: Sequence[Float], alike: bool) -> tuple[Pair, ...]:
    """Of independent samples, after their analysis; `alike` says whether their variances are. In
    place of scipy's, which takes nine times as long for three."""
    from scipy.stats import studentized_range

    k, n = len(samples), np.array([len(x) for x in samples])
    variance = np.array([x.var(ddof=1) for x in samples])
    pooled = float(((n - 1) * variance).sum() / (n.sum() - k))
    of_mean = (np.full(k, pooled) if alike else variance) / n
    reach: dict[float, float] = {}
    out = []
    for i, j in combinations(range(k), 2):
        a, b = of_mean[i], of_mean[j]
        freedom = float(n.sum() - k)
        if not alike:
            freedom = float((a + b) ** 2 / (a**2 / (n[i] - 1) + b**2 / (n[j] - 1)))
        if freedom not in reach:
            reach[freedom] = float(studentized_range.ppf(1 - LEVEL, k, freedom))
        error = float(np.sqrt((a + b) / 2))
        apart = float(samples[i].mean() - samples[j].mean())
        p = float(studentized_range.sf(abs(apart) / error, k, freedom))
        half = reach[freedom] * error
        out.append(Pair(names[i], names[j], apart, apart - half, apart + half, p))
    return tuple(out)
