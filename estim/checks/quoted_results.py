"""What a person sees of a result at a glance: what the data are, the status, and either the values
or why there are none.

Reports print their cells from here, and so does a notebook: a record's `_repr_markdown_` returns
`headline(...)`.  It draws nothing and takes milliseconds.

A quantity that the data leave nearly as uncertain as it was (posterior sd above 0.8 of the prior's)
and where it was (within that sd) was not measured here: its number is the one that was put in.  One
that may be zero has an upper limit.  Neither stands among the results.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray
from estim.checks.identifiability import PRIOR_DOMINATED
from estim.common import (
    KINDS,
    Label,
    Markdown,
    Status,
    format_p,
    format_rounded,
    kind_words,
    later,
    markdown,
    phrase,
    signed,
    significant,
    table,
    with_unit,
)
from estim.fitting import Fit, Start, limit_cell, minima, search_of
from estim.problem import Prior
from estim.sampling import Summary, value_cell
from estim.words import status_words

# lower halves of the 68 % interval from zero, below which a quantity that cannot be negative may be
# zero
_CLEAR = 2.0
_EVEN = 0.05  # standard deviations: what is nearer to the truth is "0.0"
_FAR = 2.0  # standard deviations from which the farthest point is stated


@dataclass(frozen=True)
class Estimate:
    """One quantity.

    stated : its value before the data, with its unit; "" for nothing.
    measured : whether the data constrain it.
    inferred : what was taken of it where nobody had stated it; else "".
    upper : 95 % limit of what may be zero, in its own unit; None for all others.
    true : of synthetic data, None where it is not known.
    """

    label: Label
    summary: Summary
    stated: str
    measured: bool
    upper: float | None = None
    true: float | None = None
    inferred: str = ""

    @property
    def told(self) -> bool:
        """Whether there is anything to say of it: not of a default that the data leave as it
        was.
        """
        return self.measured or bool(self.stated) or self.upper is not None or not self.inferred

    @property
    def before(self) -> str:
        """'stated (3.7 ± 0.4)°', or what was taken where nothing was stated."""
        return phrase("stated {value}", value=self.stated) if self.stated else self.inferred

    @property
    def value(self) -> str:
        """'(3.86 ± 0.26)°', or '< 0.0101 (95 %)'."""
        label, p = self.label, self.summary
        if p.limit is not None:
            return limit_cell(p.limit, label.factor, label.unit)
        if self.upper is not None:
            limit = self.upper * label.factor
            return f"< {with_unit(format_rounded(limit, 0.25 * limit), label.unit)} (95 %)"
        return with_unit(value_cell(p, label), label.unit)

    @property
    def relation(self) -> str:
        """'κ = 0.55 ± 0.12', or 'c_rr < 0.0101 (95 %)'."""
        return f"{self.label.symbol}{' ' if self.value[:1] in '<>' else ' = '}{self.value}"

    @property
    def truth(self) -> str:
        """The true value, and how far the result is from it; "" where it is not known."""
        if self.true is None:
            return ""
        label, p = self.label, self.summary
        text = with_unit(signed(f"{self.true * label.factor:.6g}"), label.unit)
        if p.mean is None or not p.sd or self.upper is not None:
            return text
        pull = (p.mean - self.true) / p.sd
        return phrase(
            "{value} ({pull} sd)",
            value=text,
            pull=signed(f"{pull:+.1f}") if abs(pull) >= _EVEN else "0.0",
        )


def is_measured(summary: Summary, prior: Prior, upper: float | None) -> bool:
    """Whether the data constrain it: neither a limit nor known hardly better than before, unless
    they disagree with what was stated.
    """
    if summary.limit is not None or upper is not None:
        return False
    if summary.sd is None or summary.mean is None or not np.isfinite(prior.sd):
        return True
    moved = abs(summary.mean - prior.expectation)
    return summary.sd <= PRIOR_DOMINATED * prior.sd or moved > prior.sd


def upper_limit(
    summary: Summary, prior: Prior, draws: FloatArray, *, zero: bool = False
) -> float | None:
    """The 95 % limit of a quantity that cannot be negative and may be zero, from its draws
    (n_draw,); None for any other.

    It may be zero where the median is within two lower halves of the 68 % interval of it: those of
    a standard deviation if the posterior is normal.  A long tail above makes a standard deviation
    large, and has nothing to do with zero.  zero : whether it may be zero for another reason.
    """
    if summary.mean is None or summary.median is None or summary.q16 is None:
        return None
    if not zero and (prior.low != 0.0 or summary.median > _CLEAR * (summary.median - summary.q16)):
        return None
    return float(np.quantile(draws, 0.95))


def zero_allowed(fit: Fit) -> frozenset[str]:
    """Parameters that may be zero and enter the curve without their sign, as w of cos(w*t): the
    likelihood at zero, the others as good as can be, is within two standard deviations of that at
    the fit.

    Their draws exclude zero whatever the data say, since Jeffreys' prior is 0 there.
    """
    unsigned = (
        ()
        if fit.symmetry is None
        else np.flatnonzero(fit.symmetry.flips & fit.problem.unstated & (fit.values > 0.0))
    )
    allowed = set[str]()
    for i in unsigned:
        search = search_of(fit.posterior, fit.values, fit.cov)
        point = search.coordinates.of(np.where(np.arange(fit.values.size) == i, 0.0, fit.values))
        (end,) = minima(search, [Start(point, held=(int(i),))])
        points = np.vstack([fit.values, search.coordinates.values(end.values)])
        with np.errstate(all="ignore"):
            height, at_zero = fit.posterior.log_likelihood(points)
        if height - at_zero < 0.5 * _CLEAR**2:
            allowed.add(fit.names[i])
    return frozenset(allowed)


def estimates_of(fit: Fit, summaries: Sequence[Summary], draws: FloatArray) -> tuple[Estimate, ...]:
    """Every parameter, with its summary and draws of its posterior (n_draw, n_par); symbols without
    levels where there is one run.
    """
    estimates, problem, allowed = [], fit.problem, zero_allowed(fit)
    for parameter, summary, column in zip(problem.parameters, summaries, draws.T, strict=True):
        label = parameter.bare_label if len(problem.runs) == 1 else parameter.label
        upper = upper_limit(summary, parameter.prior, column, zero=parameter.name in allowed)
        measured = is_measured(summary, parameter.prior, upper)
        stated = parameter.prior.stated_words(parameter.unit, label)
        inferred = parameter.prior.describe(parameter.unit) if parameter.prior.assumed else ""
        estimates.append(Estimate(label, summary, stated, measured, upper, inferred=inferred))
    return tuple(estimates)


def result_table(estimates: Iterable[Estimate], *, found: str = "") -> Markdown:
    """The quantities that the data measure, "" where there are none; columns that would be empty
    are left out.

    found : head of the values, where not all of them come from these data alone.
    """
    measured = [estimate for estimate in estimates if estimate.measured]
    columns = [
        (
            "",
            [
                f"{estimate.label.symbol}, {estimate.summary.meaning}"
                if estimate.summary.meaning
                else estimate.label.symbol
                for estimate in measured
            ],
        ),
        (found or phrase("from these data"), [estimate.value for estimate in measured]),
        (phrase("stated value"), [estimate.stated for estimate in measured]),
        (phrase("true"), [estimate.truth for estimate in measured]),
    ]
    filled = [(head, *cells) for head, cells in columns if any(cells)]
    head, *rows = zip(*filled, strict=True) if filled else [()]
    return table(head, rows) if rows else Markdown("")


def posterior_table(rows: Iterable[Sequence[str]]) -> Markdown:
    """Quantities by the cells of `parameter_cells`."""
    return table(("", "", phrase("posterior"), phrase("95 % interval"), phrase("unit")), rows)


def not_measured(estimates: Iterable[Estimate]) -> str:
    """'γ = 0.192 ± 0.009 (stated 0.193 ± 0.010); c_rr < 0.0101 (95 %)', or "" where the data
    measure everything.
    """
    entries = []
    for estimate in estimates:
        if not estimate.measured and estimate.told:
            limited = estimate.value[:1] in "<>"
            before = phrase("as stated") if estimate.stated == estimate.value else estimate.before
            entries.append(estimate.relation + (f" ({before})" if before and not limited else ""))
    return "; ".join(entries)


def p_sentence(p_curve: float | None, p_stated: float | None) -> str:
    """'goodness of fit: p = 0.91, agreement with the stated values: p = 0.068'; what was not tested
    is left out.
    """
    tests = (
        (later("goodness of fit: {p}"), p_curve),
        (later("agreement with the stated values: {p}"), p_stated),
    )
    return ", ".join(
        phrase(words, p=format_p(p)) for words, p in tests if p is not None and np.isfinite(p)
    )


def best_words(values: Sequence[str], sds: float, where: str) -> str:
    """The best values of a fit that is no result, and how far the farthest point lies from it.

    values : "m = 1.83 V/s"; none where they mean nothing.
    sds : its distance in standard deviations of the data.  where : "t = 3 s".
    """
    if not values:
        return ""
    words = phrase("best values, not a result: {values}", values=", ".join(values))
    if not sds > _FAR:  # what is wrong is no distance but a pattern
        return words
    return words + phrase(
        "; points lie up to {sds} standard deviations from the best curve, at {where}",
        sds=significant(sds, 2),
        where=where,
    )


def screen_lines(
    estimates: Sequence[Estimate], *, tests: str = "", minds: Sequence[str] = ()
) -> list[str]:
    """What a terminal shows of a trusted result, one line each."""
    width = max((len(estimate.relation) for estimate in estimates if estimate.measured), default=0)
    lines = [tests] if tests else []
    for estimate in estimates:
        if estimate.measured:
            notes = [
                estimate.before,
                phrase("true {value}", value=estimate.truth) if estimate.truth else "",
            ]
            note = "; ".join(part for part in notes if part)
            lines.append(f"{estimate.relation:<{width}}   {note}".rstrip())
    unmeasured = not_measured(estimates)
    return [
        *lines,
        *([phrase("not measured here: {left}", left=unmeasured)] if unmeasured else []),
        *minds,
    ]


def headline(
    title: str,
    *,
    kind: str,
    status: str,
    reasons: Sequence[str],
    advice: Sequence[str],
    shown: str,
    tests: str = "",
    left: str = "",
    minds: Sequence[str] = (),
) -> str:
    """Markdown: title, kind of data, status with its `tests`, and the table `shown`, or without it
    the reasons where the status is not ok.

    kind : "measured", "synthetic" or "published"; "" where nobody has said it.
    left : what was not measured (`not_measured`).
    minds : what to mind, a sentence each.
    """
    words = "" if status == Status.OK else f" — {status_words(status)}"
    suffix = words or (f"; {tests}" if tests else "")
    paragraphs = [
        f"**{markdown(title)}**" if title else "",
        kind_words(kind) if kind in KINDS else "",
    ]
    paragraphs.append(phrase("Status: **{status}**{behind}", status=status, behind=suffix))
    if status == Status.OK:
        paragraphs += [
            shown,
            phrase("Not measured here: {left}.", left=markdown(left)) if left else "",
        ]
        paragraphs.append("\n".join(f"- {markdown(item)}" for item in minds))
    else:
        items = [
            *reasons,
            *(phrase("What to do: {words}", words=words) for words in dict.fromkeys(advice)),
        ]
        paragraphs.append("\n".join(f"- {markdown(item)}" for item in items))
    return "\n\n".join(part for part in paragraphs if part)


def print_lines(
    title: str, *, status: str, reasons: Sequence[str], advice: Sequence[str], shown: Sequence[str]
) -> str:
    """What `print` shows: title and status, then the lines `shown` (`screen_lines`), or why there
    are no values.
    """
    lines = (
        shown
        if status == Status.OK
        else [
            *reasons,
            *(phrase("what to do: {words}", words=words) for words in dict.fromkeys(advice)),
        ]
    )
    return "\n".join([f"{title}: {status}", *(f"  {line}" for line in lines)])
