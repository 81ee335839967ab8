"""Report of a reanalysis: one `report.md`, its figures and `result.json`."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import msgspec
import numpy as np

from estim.campaign import gamma_origin
from estim.checks import Estimate, not_measured, result_table, screen_lines
from estim.common import (
    FigureChoice,
    Files,
    Json,
    Quantity,
    format_rounded,
    later,
    listed,
    percentage,
    phrase,
    signed,
    significant,
    split_level,
    with_unit,
)
from estim.drawing import BLUE, INK, ORANGE, Figure, grid, legend_below, name_ticks
from estim.pipeline import Analysis
from estim.reports.analysis import complete_runs, prior_cell
from estim.reports.copying import copies_of
from estim.reports.corner_figures import corner_figure, corner_words
from estim.reports.curve_figures import phase_plane_figure, residual_figure
from estim.reports.energy import (
    average_words,
    drift_words,
    energy_figure,
    energy_words,
    percent,
    summarise_drift,
    summarise_energy,
)
from estim.reports.pages import Drawers, page
from estim.reports.rendering import shown
from estim.reports.result import MOST_CAUTIONS, Screen, first_screen, provenance, result_of
from estim.reports.theta_min_line import (
    LINE_WORDS,
    line_estimate,
    line_figure,
    line_lines,
    line_result,
)
from estim.studies.limits import Narrowing
from estim.studies.reanalysis import BodyAnalysis, Reanalysis


def reanalysis_result(r: Reanalysis) -> Json:
    """Everything of a reanalysis, as `result.json` has it; the report prints from it."""
    return {
        "schema": "estim-reanalysis/1",
        "title": r.campaign.title,
        "kind": r.campaign.kind,
        "statuses": r.statuses,
        "line": None if r.line is None else line_result(r.campaign, r.line),
        "runs": {name: result_of(r.campaign, analysis) for name, analysis in r.single_runs.items()},
        "bodies": {body.body: _body(r, body) for body in r.bodies},
        "paper": r.paper.paper,
        "claims": r.paper.claim,
        "published": [
            {
                "name": c.published.name,
                "section": c.published.section,
                "published": Quantity(
                    c.published.value, math.nan if c.published.u is None else c.published.u
                ),
                "reanalysed": c.value,
                "how": c.how,
                "e_n": c.e_n,
            }
            for c in r.published
        ],
        "provenance": provenance(r.campaign, r.campaign.run_names, r.seed),
    }


def _body(r: Reanalysis, body: BodyAnalysis) -> Json:
    table, ok = body.narrowing, body.joint.diagnosis.ok
    return {
        "gamma_masses": body.gamma_masses and body.gamma_masses.of_unit(),
        "gamma_origin": gamma_origin(r.campaign.source, body.body),
        "joint": result_of(r.campaign, body.joint),
        "energies": {e.run: summarise_energy(e) for e in body.energies if ok},
        "drift": summarise_drift(body.drift),
        # what the propagated bands hold at a published value, and at the fitted one
        "band_published": {
            name: value for b in body.propagated for name, value in b.published.items()
        },
        "band_held": list(dict.fromkeys(name for b in body.propagated for name in b.fitted)),
        # posterior band against the propagated band of the stated inputs
        "bands": {
            b.run: {
                "median_ratio": np.nanmedian(b.ratio),
                "largest_ratio": np.nanmax(b.ratio),
                "inside_68": b.inside[0.68],
                "inside_95": b.inside[0.95],
                "linear_off": np.nanmax(b.linear_off),
                "dominating": [(part.start, part.stop, part.name) for part in b.budget.stretches],
            }
            for b in body.propagated
            if ok
        },
        "runs_in_order": table.runs,
        "u_with_runs": {name: table.u[:, i] for i, name in enumerate(table.names) if ok},
        "u_single": {name: table.u_single[:, i] for i, name in enumerate(table.names) if ok},
        "limits": {
            name: [
                {"group": x.group, "u": x.u, "u_known": x.u_known}
                for x in body.limits
                if x.parameter == name
            ]
            for name in table.names
            if ok
        },
    }


def reanalysis_report(r: Reanalysis, *, figures: FigureChoice) -> Files:
    """`report.md`, `result.json` and `figures/*.png`."""
    result = reanalysis_result(r)
    drawn: Drawers = {}
    further: Drawers = {}
    trusted = [body for body in r.bodies if body.joint.diagnosis.ok]
    if trusted:
        drawn["figures/narrowing.png"] = partial(
            narrowing_figure, [body.narrowing for body in trusted]
        )
    if r.line is not None:
        drawn["figures/line.png"] = partial(line_figure, r.line)
    for body in r.bodies:
        drawn[f"figures/phase-{body.body}.png"] = partial(
            phase_plane_figure, body.joint, body.propagated, _tilted(body.joint)
        )
        if body in trusted:
            drawn[f"figures/energy-{body.body}.png"] = partial(
                energy_figure, body.energies, title=body.body
            )
        further[f"figures/residuals-{body.body}.png"] = partial(
            residual_figure, body.joint.problem.runs, body.joint.goodness
        )
        further[f"figures/corner-{body.body}.png"] = partial(
            corner_figure, body.joint, r.campaign.truth
        )
    corner_legends = {
        body.body: corner_words(body.joint.problem, truth=bool(r.campaign.truth))
        for body in r.bodies
    }
    good = {name: body for name, body in result["bodies"].items() if body["joint"].status == "ok"}
    screens = {name: first_screen(body["joint"]) for name, body in good.items()}
    estimates = [
        replace(
            estimate,
            summary=msgspec.structs.replace(estimate.summary, meaning=_how_many(good[name])),
        )
        for name, screen in screens.items()
        for estimate in screen.estimates
    ]
    if result["line"] is not None and result["line"]["status"] == "ok":
        # its points are other data than the runs
        estimates.append(line_estimate(result["line"], r.campaign.truth))
    estimate_table = result_table(estimates, found=phrase("runs + stated values"))
    return page(
        drawn,
        "reanalysis.md.j2",
        {"result.json": result},
        figure_choice=figures,
        further=further,
        kind=r.campaign.kind,
        opened={"methods"},
        result=result,
        **LINE_WORDS,
        prior=prior_cell,
        limit_words=_limit_words,
        corner_words=corner_legends,
        percent=percent,
        drift_words=drift_words,
        forces=[
            force
            for body in result["bodies"].values()
            for force in (body["joint"].deviation or {}).values()
        ],
        complete=complete_runs(result["runs"].values()),
        notes=list(
            dict.fromkeys(
                note for body in result["bodies"].values() for note in body["joint"].notes
            )
        ),
        troubles=_troubles(result),
        narrowing=_narrowing(result),
        remarks=_remarks(result, good),
        screens=screens,
        estimate_table=estimate_table,
        copies=copies_of(
            [estimate for estimate in estimates if estimate.measured], kind=result["kind"]
        )
        if estimate_table
        else None,
        cautions=[
            (name, words)
            for i in range(MOST_CAUTIONS)
            for name, screen in screens.items()
            for words in screen.cautions[i : i + 1]
        ],
        most_cautions=MOST_CAUTIONS,
        band_words=partial(_band_words, result),
        energy_words=energy_words,
        called=called,
        unmeasured=_unmeasured(screens),
        all_ok=_all_ok(result),
        true_values=any(estimate.truth for estimate in estimates),
        symbols_of=_symbols,
        correlated=_correlated,
        energies=_gathered((name, _energies(body)) for name, body in good.items()),
    )


def _tilted(joint: Analysis) -> dict[str, str]:
    """Run -> its name with its tilt, the mean of the draws where they count."""
    ok, problem = joint.diagnosis.ok, joint.problem
    values = problem.named(joint.chain.flat.mean(axis=0) if ok else joint.fit.values)
    return {
        run.name: f"{run.name}, φ = {math.degrees(np.ravel(run.bind(values)['phi'])[0]):.1f}°"
        for run in problem.runs
    }


def reanalysis_lines(r: Reanalysis) -> dict[str, list[str]]:
    """What was analysed -> its lines for a terminal, for results that are ok: what the runs of a
    body share, and the line.
    """
    lines = {
        f"joint fit of {body.body}": screen_lines(_shared(body.joint, r.campaign.truth))
        for body in r.bodies
        if body.joint.diagnosis.ok
    }
    return lines | (
        {"line": line_lines(r.campaign, r.line)} if r.line is not None and r.line.status.ok else {}
    )


def _shared(joint: Analysis, truth: Mapping[str, float]) -> list[Estimate]:
    runs = {*joint.problem.run_names}
    named = zip(joint.problem.names, joint.estimates, strict=True)
    return [
        replace(estimate, true=truth.get(name))
        for name, estimate in named
        if len(runs) == 1 or split_level(name)[1].strip("[]") not in runs
    ]


def _band_words(result: Json, names: Collection[str]) -> str:
    """Whose band the propagated one of these bodies is, and what it is made of beside the inputs
    that the campaign states.
    """
    bodies = [result["bodies"][name] for name in names]
    published, fitted = [], []
    for body in bodies:
        labels = body["joint"].labels.bare
        published += [
            with_unit(f"{labels[n].symbol} = {value * labels[n].factor:g}", labels[n].unit)
            for n, value in body["band_published"].items()
        ]
        fitted += [labels[name].symbol for name in body["band_held"]]
    of_paper = phrase("{values} as published", values=listed(list(dict.fromkeys(published))))
    of_fit = phrase("{symbols} as fitted", symbols=listed(list(dict.fromkeys(fitted))))
    if published and not fitted:
        return phrase("the paper's band, 68 %: stated inputs, {others}", others=of_paper)
    others = [words for words, items in ((of_paper, published), (of_fit, fitted)) if items]
    return "; ".join([phrase("stated inputs, 68 %"), *others])


def _how_many(body: Json) -> str:
    runs = body["runs_in_order"]
    return phrase("{n} runs" if len(runs) > 1 else "the run {name}", n=len(runs), name=runs[0])


def _energies(body: Json) -> str:
    """What the runs of a body show of a loss of energy."""
    averages = (
        f". {average_words(body['energies'])}".rstrip(".") if body["drift"]["determined"] else ""
    )
    return energy_words(body["drift"]) + averages


def _narrowing(result: Json) -> str:
    """How wide the bands of the curves are beside those of the stated inputs, as part of a
    caption.
    """
    ratios = [
        band["median_ratio"]
        for body in result["bodies"].values()
        for band in body["bands"].values()
    ]
    if not ratios:
        return ""
    least, most = significant(100.0 * min(ratios), 2), percentage(max(ratios))
    return phrase(", {shares} as wide", shares=f"{least}–{most}")


def _remarks(result: Json, bodies: Mapping[str, Json]) -> list[str]:
    """What to know about the comparison with the paper and with the truth.  bodies : those whose
    status is ok.
    """
    sentences = []
    known = {n: v for body in bodies.values() for n, v in body["band_published"].items()}
    if computed := {v for n, v in known.items() if split_level(n)[0] == "kappa"}:
        true = {
            p.true
            for body in bodies.values()
            for n, p in body["joint"].parameters.items()
            if split_level(n)[0] == "kappa"
        }
        sentences.append(
            phrase(
                "the inertia κ is inferred from the motion; the paper computes {values} from the "
                "shape of the disk, without an uncertainty",
                values=listed([f"{value:g}" for value in sorted(computed)]),
            )
            + phrase(
                "; these data were generated with that value, so the comparison shows whether "
                "the method recovers it"
                if true == computed
                else ", and this is a test of that value"
            )
        )
    comparisons = {
        "energy": _energy_beside(bodies.values()),
        "theta_min": _line_beside(result["line"]),
    }
    sentences += [
        phrase(
            "the paper: “{words}” ({section}). Here {found}",
            words=claim.words,
            section=claim.section,
            found=comparison,
        )
        for claim in result["claims"]
        if (comparison := comparisons[claim.about])
    ]
    pulls = {name: pull for name, body in bodies.items() if (pull := _pull_of_gamma(name, body))}
    if pulls:
        each = [f"{pull} ({name})" for name, pull in pulls.items()]
        sentences.append(
            phrase(
                "the true values are known here: γ and κ of a body are strongly correlated, so "
                "that their differences from the truth are one deviation and not two; both follow "
                "the stated γ, which lies {pulls} standard uncertainties from the true one",
                pulls=listed(each),
            )
        )
    return sentences


def _energy_beside(bodies: Collection[Json]) -> str:
    """How far the energy changes relative to that at release; "" where that may be 0 in all
    runs.
    """
    runs = {
        run: e
        for body in bodies
        for run, e in body["energies"].items()
        if percent(e["extreme_relative"]) != "n/a"
    }
    if not runs:
        return ""
    means = sorted((e["mean_relative"] for e in runs.values()), key=lambda mean: mean.value)
    run = max(runs, key=lambda run: abs(runs[run]["extreme_relative"].value))
    words = phrase(
        "(E − E₀)/E₀, averaged over a run, lies between {least} and {most}; the largest change in "
        "one frame is {extreme} ({run})",
        least=percent(means[0]),
        most=percent(means[-1]),
        extreme=percent(runs[run]["extreme_relative"]),
        run=run,
    )
    if all(body["drift"]["determined"] for body in bodies):
        return words
    return words + phrase(
        "; these values depend on the rolling resistance that was assumed, because the data do not "
        "determine how much energy is lost: they cannot test what the paper says"
    )


def _line_beside(line: Json | None) -> str:
    """How the measured theta_min lie to the theory; "" where there is no comparison."""
    if line is None or (above := line["above_theory"]) is None:
        return ""
    excess = above["excess"]
    return phrase(
        "{points} of {n} points lie above the theory with γ as stated; at their mean tilt of "
        "{tilt:.1f}° the fitted line is {excess} above it, {verdict}",
        points=above["points"],
        n=line["n_obs"],
        tilt=math.degrees(above["tilt"]),
        excess=with_unit(shown(excess, math.degrees(1.0)), "°"),
        verdict=phrase(
            "which is more than its expanded uncertainty (k = 2)"
            if abs(excess.value) > 2.0 * excess.u
            else "which is less than its expanded uncertainty (k = 2): they agree"
        ),
    )


def _pull_of_gamma(name: str, body: Json) -> str:
    """How far the stated gamma is from the true one, where that is known and kappa follows it."""
    together = _correlated(name, body)
    # two parameters that are one unknown in effect
    if body["gamma_masses"] is None or together is None or abs(together) < 0.9:
        return ""
    true = body["joint"].parameters[f"gamma[{name}]"].true
    if true is None:
        return ""
    return signed(f"{(body['gamma_masses'].value - true) / body['gamma_masses'].u:+.1f}")


def _all_ok(result: Json) -> str:
    """'ok (8 runs, 2 joint fits, line)': what all the results are."""
    counted = (
        (len(result["runs"]), later("{n} run"), later("{n} runs")),
        (len(result["bodies"]), later("{n} joint fit"), later("{n} joint fits")),
    )
    parts = [phrase(singular if n == 1 else plural, n=n) for n, singular, plural in counted]
    return f"ok ({', '.join(parts + [phrase('line')] * (result['line'] is not None))})"


def _unmeasured(screens: Mapping[str, Screen]) -> str:
    """What the joint fits do not measure: first what is the same for all bodies, then what is left
    of each, after its name.
    """
    names = _gathered(
        (name, entry)
        for name, screen in screens.items()
        for estimate in screen.estimates
        if (entry := not_measured([estimate]))
    )
    entries = _gathered((entry, ", ".join(of)) for entry, of in names.items())
    everyone = ", ".join(screens)
    return "; ".join(
        [*entries.pop(everyone, []), *(f"{of}: {', '.join(own)}" for of, own in entries.items())]
    )


def _symbols(body: Json) -> str:
    """'c_rr: coefficient of rolling resistance; R: radius of the disk': each symbol once."""
    labels = body["joint"].labels.bare
    meanings = {
        labels[name].symbol: p.meaning for name, p in body["joint"].parameters.items() if p.meaning
    }
    return "; ".join(f"{symbol}: {meaning}" for symbol, meaning in meanings.items())


def _correlated(name: str, body: Json) -> float | None:
    """Correlation of gamma and kappa of a body; None where one of them is not free."""
    correlation, pair = body["joint"].correlation, (f"gamma[{name}]", f"kappa[{name}]")
    if not {*pair} <= {*correlation.names}:
        return None
    i, j = map(correlation.names.index, pair)
    return correlation.matrix[i][j]


def _gathered(words: Iterable[tuple[str, str]]) -> dict[str, list[str]]:
    """Sentence -> the bodies that it is about."""
    names: dict[str, list[str]] = {}
    for name, sentence in words:
        names.setdefault(sentence, []).append(name)
    return names


def _troubles(result: Json) -> list[tuple[str, str]]:
    """What is not ok, and why."""
    reasons = {f"run {name}": run.reasons for name, run in result["runs"].items()}
    reasons |= {
        f"joint fit of {name}": body["joint"].reasons for name, body in result["bodies"].items()
    }
    reasons |= {} if result["line"] is None else {"line": result["line"]["reasons"]}
    return [
        (f"{called(what)}, {status}", "; ".join(reasons.get(what, [])))
        for what, status in result["statuses"].items()
        if status != "ok"
    ]


def called(what: str) -> str:
    """A key of the statuses as a reader calls it."""
    for key in (later("run {name}"), later("joint fit of {name}")):
        before = key.removesuffix("{name}")
        if what.startswith(before):
            return phrase(key, name=what.removeprefix(before))
    return phrase("line")


def _limit_words(body: Json) -> list[str]:
    """What limits each shared parameter, in words."""
    sentences = []
    for name, limits in ((name, limits) for name, limits in body["limits"].items() if limits):
        symbol = body["joint"].labels.symbol(name)
        clauses = [
            phrase(
                "{u} if {symbol} were known exactly",
                u=format_rounded(limit["u_known"], limit["u_known"]),
                symbol=body["joint"].labels.symbol(limit["group"]),
            )
            for limit in limits
            if limit["u_known"] < 0.9 * limit["u"]
        ]
        sentences.append(
            phrase(
                "u({symbol}) = {u} (least squares) would fall to {ways}."
                if clauses
                else "u({symbol}) = {u} (least squares) is not limited by any other single "
                "quantity.",
                symbol=symbol,
                u=format_rounded(limits[0]["u"], limits[0]["u"]),
                ways=phrase("; to ").join(clauses),
            )
        )
    return sentences


def narrowing_figure(tables: Sequence[Narrowing]) -> Figure:
    """Uncertainty of gamma and kappa against the number of runs fit together, beside single
    runs.
    """
    pairs = [(narrowing, i) for narrowing in tables for i in range(len(narrowing.names))]
    figure, axes = grid(len(pairs), height=2.9, columns=2)
    for ax, (narrowing, i) in zip(axes, pairs, strict=True):
        count = np.arange(1, len(narrowing.runs) + 1)
        ax.plot(
            count,
            narrowing.u[:, i],
            "o-",
            color=BLUE,
            label=phrase("joint fit of runs up to this one"),
        )
        ax.plot(
            count,
            narrowing.u_single[:, i],
            "s",
            color=INK,
            label=phrase("this run alone"),
            zorder=3,
            mfc="none",
            mew=1.6,
            ms=8,
        )
        if np.isfinite(narrowing.u_prior[i]):
            ax.axhline(
                narrowing.u_prior[i],
                ls=":",
                color=ORANGE,
                label=phrase("uncertainty of the stated value"),
            )
        uncertainties = np.array(
            [*narrowing.u[:, i], *narrowing.u_single[:, i], narrowing.u_prior[i]]
        )
        top = 1.1 * float(np.max(uncertainties[np.isfinite(uncertainties)]))
        ax.set(
            ylabel=f"u({narrowing.labels[i].tex})", ylim=(0.0, top), xlim=(0.6, len(count) + 0.4)
        )
        upright = len("".join(narrowing.runs)) > 36
        name_ticks(ax.xaxis, count, narrowing.runs, rotation=90 if upright else 0)
    legend_below(figure)
    return figure
