"""The mean of several values of one quantity, and which of its uncertainties to quote.

What to use when:

- values with standard uncertainties, `mean(values, u)`: where they are consistent (chi^2), the
  weighted mean.  Where they scatter more than these explain, the hierarchical mean: it
  has a dark uncertainty tau, which is inferred with the mean.  "Birge" (the scale factor of the
  Particle Data Group), "DerSimonian-Laird" and "Mandel-Paule" stand beside them.
- readings without uncertainties, in the order in which they were taken, `mean(values)`: s/sqrt(n),
  Student's t (GUM 4.2); `poor-fit` where one lies much farther from their mean than the others, or
  where they drift.
- readings in groups, days for instance, `mean(values, groups=days)`: the readings of one group
  share an error, and the means of the groups count (GUM H.5).

The weighted mean is quoted where chi^2 does not contradict it, so it relies on the stated
uncertainties: a dark uncertainty of the size of u is often not seen in a few values.  Where one is
plausible beforehand, quote the hierarchical mean, whose interval holds whatever tau is.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from estim.arrays import FloatArray, IntArray, all_finite
from estim.checks import P_FLOOR, check_linear
from estim.common import (
    InputError,
    Shown,
    Status,
    Stream,
    Tabled,
    format_p,
    format_rounded,
    interval,
    later,
    per_cent,
    phrase,
    read_quantity,
    significant,
    stream,
)
from estim.distributions import chi2_tail, student_quantile
from estim.given_numbers import check_probability, check_size, real_numbers
from estim.means.dark_uncertainty import der_simonian_laird, hierarchical, mandel_paule, weighted

CONSISTENT = 0.05  # least p of chi^2 (Cox 2002, Metrologia 39, 589)
_MOST = 1000


class Average(NamedTuple):
    """One mean.  tau : dark uncertainty, the median of its posterior for "hierarchical".  k : of
    value -/+ k u, by Student's t; nan where the ends are quantiles.
    """

    value: float
    u: float
    tau: float
    dof: float
    k: float
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Groups:
    """One-way analysis of variance (GUM H.5).

    names, means, sizes : (n_group,).
    s_within, s_between : standard deviations of readings in a group, and of groups beside that; 0
        where the groups scatter no more than their readings.
    F : mean square between over that within, with dof_between and dof_within.  p_value : P(F or
        more) without a scatter of groups.
    """

    names: tuple[str, ...]
    means: FloatArray
    sizes: IntArray
    s_within: float
    s_between: float
    F: float
    dof_between: int
    dof_within: int
    p_value: float


@dataclass(frozen=True, eq=False, repr=False)
class Mean(Tabled):
    """The mean of several values, by every method.

    data, u_data : (n,) values and their standard uncertainties, None for readings.
    averages : method -> its mean.  recommended : the one to quote.  reason : why, a sentence.
    probability : of the intervals.
    chi2, p_value : of the weighted mean; nan for readings.  birge : sqrt(chi2/dof).
    tau_interval : of the dark uncertainty; nan for readings.
    groups : None without groups.
    status : "ok", or "poor-fit" where one of the readings is not as the others, or where each
        depends on the one before.

    >>> from estim import mean
    >>> found = mean([9.81, 9.78, 9.80], 0.02)
    >>> found.recommended, round(found.chi2, 2), found.dof
    ('weighted', 1.17, 2)
    """

    data: FloatArray
    u_data: FloatArray | None
    averages: Mapping[str, Average]
    recommended: str
    reason: str
    probability: float
    chi2: float = math.nan
    p_value: float = math.nan
    tau_interval: tuple[float, float] = (math.nan, math.nan)
    groups: Groups | None = None
    status: Status = Status.OK

    @property
    def dof(self) -> int:
        """Degrees of freedom of the values about their mean."""
        return self.data.size - 1

    @property
    def best(self) -> Average:
        """The mean by the recommended method."""
        return self.averages[self.recommended]

    @property
    def birge(self) -> float:
        """Birge's ratio, sqrt(chi^2/dof), about 1 where the uncertainties explain the scatter.

        Source: Birge, Phys. Rev. 40 (1932) 207.
        """
        return math.sqrt(self.chi2 / self.dof)

    @property
    def consistent(self) -> bool:
        """Whether chi^2 does not contradict the stated uncertainties."""
        return not self.p_value < CONSISTENT

    def shown(self) -> Shown:
        percent = per_cent(self.probability)
        head = (phrase("method"), phrase("value"), "u", "tau", "dof", "k", percent)
        rows = [(phrase(name), *cells(average)) for name, average in self.averages.items()]
        title = phrase("Mean of {n} values", n=self.data.size)
        quoted = (
            phrase("Quote {name}: {reason}.", name=phrase(self.recommended), reason=self.reason)
            if self.status.ok
            else phrase("Quote none: {reason}.", reason=self.reason)
        )
        return Shown(title, head, rows, (quoted,), phrase(self.recommended))


def cells(average: Average) -> tuple[str, ...]:
    """An average for a table: value, u, tau, dof, k and the interval."""
    value, u, tau, dof, k, low, high = average
    size = u if math.isfinite(u) else 0.25 * (high - low)
    return (
        format_rounded(value, size),
        format_rounded(u, u, beside=value),
        significant(tau, 2),
        "" if math.isnan(k) else f"{dof:.3g}".replace("inf", "∞"),
        "" if math.isnan(k) else f"{k:.2f}",
        interval(low, high, size, 2),
    )


def mean(
    values: ArrayLike | Sequence[str],
    u: ArrayLike | None = None,
    *,
    groups: Sequence[object] | None = None,
    probability: float = 0.95,
) -> Mean:
    """The mean of values (n,), n >= 2, of one quantity.

    values : numbers, at most 1000, or quantities in text, ["9.81(2)", "9.78(1)"].
    u : (n,) or one standard uncertainty, > 0, of independent errors; None for readings.
    groups : (n,) the group of each reading, two groups or more.
    probability : of the intervals.

    "weighted": weights 1/u^2.  "Birge": the same, u times sqrt(chi^2/(n - 1)) where that exceeds 1
    (Birge 1932, Phys. Rev. 40, 207).  "DerSimonian-Laird", "Mandel-Paule": weights
    1/(u^2 + tau^2).  The intervals of these three have Student's t with n - 1 degrees of freedom
    (Follmann and Proschan 1999, Biometrics 55, 732).  "hierarchical": the posterior, see
    `estim.means.dark_uncertainty`.

    Raises InputError.

    >>> from estim import mean
    >>> found = mean(["9.81(2)", "9.78(1)", "9.80(2)"])
    >>> print(str(found).splitlines()[-1])
    Quote weighted: the values are consistent (chi2 = 2.21, dof = 2, p = 0.33).
    """
    check_probability(probability)
    if u is None and isinstance(values, Sequence) and any(isinstance(v, str) for v in values):
        quantities = [read_quantity(v, field="values") for v in values]
        values, u = [q.value for q in quantities], [q.u for q in quantities]
    x = real_numbers(values, "values")
    if x.ndim != 1 or not 2 <= x.size <= _MOST or not all_finite(x):
        raise InputError(f"must be 2 to {_MOST} finite numbers", field="values", value=values)
    check_size(x, "values")
    if u is not None and groups is not None:
        raise InputError("are for readings without uncertainties", field="groups")
    if u is not None:
        errors = real_numbers(u, "u")
        if errors.shape not in ((), x.shape) or not np.all((errors > 0.0) & np.isfinite(errors)):
            raise InputError("must be > 0, one or as many as values", field="u", value=u)
        check_size(errors, "u", each=True)
        return _of_values(x, np.broadcast_to(errors, x.shape), probability)
    if np.ptp(x) == 0.0:
        raise InputError(
            "are all the same, so that their scatter tells no uncertainty: state u",
            field="values",
            value=float(x[0]),
        )
    return _of_readings(x, probability) if groups is None else _of_groups(x, groups, probability)


def _average(value: float, u: float, tau: float, dof: float, probability: float) -> Average:
    k = float(student_quantile(0.5 * (1.0 + probability), dof))
    return Average(value, u, tau, dof, k, value - k * u, value + k * u)


def _of_values(x: FloatArray, u: FloatArray, probability: float) -> Mean:
    dof = x.size - 1
    value, u_value, chi2 = weighted(x, u)
    p_value = float(chi2_tail(chi2, dof))
    scale = max(1.0, math.sqrt(chi2 / dof))
    averages = {
        later("weighted"): _average(value, u_value, 0.0, math.inf, probability),
        "Birge": _average(value, scale * u_value, 0.0, dof, probability),
    }
    for name, dark in (("DerSimonian-Laird", der_simonian_laird), ("Mandel-Paule", mandel_paule)):
        tau = dark(x, u)
        averages[name] = _average(*weighted(x, u, tau)[:2], tau, dof, probability)
    posterior = hierarchical(x - value, u)
    middle = float(posterior.p @ posterior.mean)
    variance = float(posterior.p @ (posterior.sd**2 + (posterior.mean - middle) ** 2))
    tails = (0.5 * (1.0 - probability), 0.5 * (1.0 + probability))
    averages[later("hierarchical")] = Average(
        value + middle,
        math.sqrt(variance) if x.size >= 4 else math.nan,
        posterior.tau_quantile(0.5),
        math.nan,
        math.nan,
        *(value + posterior.quantile(p) for p in tails),
    )
    test = phrase("chi2 = {chi2:.3g}, dof = {dof}, {p}", chi2=chi2, dof=dof, p=format_p(p_value))
    needed = p_value < CONSISTENT
    reason = (
        phrase(
            "the values scatter more than their uncertainties say ({test}), so a dark uncertainty "
            "tau is needed",
            test=test,
        )
        if needed
        else phrase(
            "the values scatter less than their uncertainties say ({test}): either these are too "
            "large, or the values are not independent",
            test=test,
        )
        if p_value > 0.999 and x.size > 2  # two rounded values are often equal
        else phrase("the values are consistent ({test})", test=test)
    )
    low, high = map(posterior.tau_quantile, tails)
    best = "hierarchical" if needed else "weighted"
    return Mean(x, u, averages, best, reason, probability, chi2, p_value, (low, high))


def _of_readings(x: FloatArray, probability: float) -> Mean:
    readings = _as_readings(x, probability)
    reason = phrase("the scatter of the readings alone tells the uncertainty (GUM 4.2)")
    result = Mean(x, None, {"readings": readings}, "readings", reason, probability)
    s, middle = float(x.std(ddof=1)), readings.value
    z, places = (x - middle) / s, np.arange(x.size, dtype=float)
    goodness = check_linear(
        z,
        np.full((x.size, 1), -1.0 / s),
        x=places,
        y=x,
        f=np.full(x.size, middle),
        sd=np.full(x.size, s),
        stated=False,
        rng=stream(0, Stream.GOODNESS),
    )
    steps = np.diff(x)
    sorted_values = not (steps > 0.0).any() or not (steps < 0.0).any()
    in_order = [name for name in ("trend", "autocorrelation", "runs") if name in goodness.failed]
    if "largest" in goodness.failed:
        i = int(np.argmax(np.abs(z)))
        reason = phrase(
            "value number {n}, {value}, lies much farther from the mean than the others ({p}): "
            "check it",
            n=i + 1,
            value=f"{x[i]:.6g}",
            p=format_p(goodness.checks["largest"].p_value, P_FLOOR),
        )
    elif in_order and sorted_values:
        reason = phrase(
            "the scatter of the readings alone tells the uncertainty (GUM 4.2), if they are "
            "independent; as they stand, they only rise or only fall, so that they were sorted, "
            "or drift"
        )
        return replace(result, reason=reason)
    elif in_order:
        reason = phrase(
            "the readings drift, or each depends on the one before ({p}), so that their mean is "
            "less certain than their scatter says (GUM 4.2.7): take readings that are independent, "
            "or, where those of a day or a setting share an error, name these groups",
            p=format_p(goodness.checks[in_order[0]].p_value, P_FLOOR),
        )
    else:
        return result
    return replace(result, reason=reason, status=Status.POOR_FIT)


def _as_readings(x: FloatArray, probability: float) -> Average:
    """The mean of readings by their scatter alone."""
    u = float(x.std(ddof=1)) / math.sqrt(x.size)
    return _average(float(x.mean()), u, 0.0, x.size - 1, probability)


def _label(group: object) -> str:
    """The name of a group; 1 and 1.0 are one.  Raises InputError where there is none."""
    label = str(group).strip()
    if isinstance(group, int | float | np.number) and label.endswith(".0"):
        label = label[:-2]
    if group is None or label in ("", "nan", "NaT", "<NA>"):
        raise InputError("must name the group of every value", field="groups", value=label)
    return label


def _of_groups(x: FloatArray, groups: Sequence[object], probability: float) -> Mean:
    """u of the mean of the group means is s(means)/sqrt(n_group), with n_group - 1 degrees of
    freedom (GUM H.5.2.5); also for groups of different sizes its square has the right expectation.

    s_between^2 = (MS_between - MS_within)/n0, n0 = (n - sum n_j^2/n)/(n_group - 1), the size of
    equal groups (Searle, Casella and McCulloch 1992, Variance Components, 3.6).
    """
    labels = [_label(group) for group in groups]
    names = tuple(dict.fromkeys(labels))
    if len(labels) != x.size:
        raise InputError("must have one for each value", field="groups", value=len(labels))
    if not 2 <= len(names) < x.size:
        raise InputError(
            "must be two or more, with more readings than groups", field="groups", value=len(names)
        )
    at = np.array([names.index(label) for label in labels])
    sizes = np.bincount(at)
    means = np.bincount(at, x - x[0]) / sizes + x[0]
    between, within = len(names) - 1, x.size - len(names)
    square_between = float(sizes @ (means - x.mean()) ** 2) / between
    square_within = float(np.sum((x - means[at]) ** 2)) / within
    if not square_within > 0.0:
        rule = "must hold readings that scatter: those of each group are all the same"
        raise InputError(rule, field="groups", value=names[0])
    ratio = square_between / square_within
    n0 = (x.size - float(sizes @ sizes) / x.size) / between
    analysis_of_variance = Groups(
        names,
        means,
        sizes,
        math.sqrt(square_within),
        math.sqrt(max(square_between - square_within, 0.0) / n0),
        ratio,
        between,
        within,
        float(special.fdtrc(between, within, ratio)),
    )
    u = float(means.std(ddof=1)) / math.sqrt(len(names))
    averages = {
        later("groups"): _average(float(means.mean()), u, 0.0, between, probability),
        "readings": _as_readings(x, probability),
    }
    reason = phrase(
        "readings of one group may share an error (F = {ratio:.3g} with {between} and {within} "
        "degrees of freedom, {p}), so only the means of the {n} groups count",
        ratio=ratio,
        between=between,
        within=within,
        p=format_p(analysis_of_variance.p_value),
        n=len(names),
    )
    return Mean(x, None, averages, "groups", reason, probability, groups=analysis_of_variance)
