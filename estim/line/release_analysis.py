"""Trials of release analysed: gamma from all trials, from each end alone, and without the release;
what they distinguish.

`analyse_trials` is the front door.  The headline is a chain with a second computation beside it;
the others are importance sampling.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from estim.arrays import FloatArray
from estim.checks import PRIOR_DOMINATED, headline, posterior_table, sampling_findings
from estim.common import (
    QUANTILES,
    Finding,
    Kind,
    Notation,
    PhraseTable,
    Quantity,
    Stream,
    decide,
    e_n,
    later,
    phrase,
    stream,
    wrong,
)
from estim.line.findings import Judged
from estim.line.release_likelihood import (
    FACTOR,
    ReleasePosterior,
    effective_start,
    outcomes,
    release_posterior,
    rough_gamma,
    start_angle,
)
from estim.line.trial_data import HIGH, LOW, Trials
from estim.problem import Prior
from estim.sampling import (
    MAX_PARAMETERS,
    Agreement,
    Certificate,
    Chain,
    Optima,
    Progress,
    Summary,
    Target,
    adapt_proposal,
    certified_chain,
    certify,
    parameter_cells,
    summarise,
)
from estim.words import advice_for, describe

WAYS: Mapping[str, str] = PhraseTable(
    {
        "both": "all trials",
        LOW: "θ_min alone",
        HIGH: "θ_max alone",
        "free": "all trials, neglecting the effect of the release",
    }
)
DEGREE = Notation("", unit="°", factor=math.degrees(1.0))
UNKNOWNS = {
    "gamma": ("1", later("position of the centre of mass, in radii"), Notation("γ")),
    "rolling_resistance": ("1", later("coefficient of rolling resistance"), Notation("c_rr")),
    "release": (
        "rad",
        later("angle lost in the release by hand"),
        Notation("δ", "°", DEGREE.factor),
    ),
    "scatter": (
        "rad",
        later("standard deviation from trial to trial"),
        Notation("σ", "°", DEGREE.factor),
    ),
    "zero_phi": ("rad", later("zero error of the tilt"), Notation("z_φ", "°", DEGREE.factor)),
    "zero_theta": ("rad", later("zero error of the angle"), Notation("z_θ", "°", DEGREE.factor)),
}


@dataclass(frozen=True, eq=False)
class GammaEstimate:
    """gamma by one way.  e_n : against the stated value, nan without one.  reliable : False where
    its importance weights cannot be trusted.
    """

    gamma: Summary
    e_n: float
    reliable: bool

    @property
    def quantity(self) -> Quantity:
        """Mean and standard deviation."""
        return Quantity(self.gamma.mean or math.nan, self.gamma.sd or math.nan)


@dataclass(frozen=True, eq=False)
class TrialsAnalysis(Judged):
    """The trials of one body.

    chain : draws of the unknowns.
    agreement : with the second computation.  ways : gamma by each of WAYS that there is.
    ends_apart : gamma from theta_min less gamma from theta_max, both from one posterior that shares
        all else (tilts, zeros, c_rr, release, scatter); None without trials at both ends, or where
        its importance weights cannot be trusted.
    thresholds : at each tilt by itself.
    offset : rad, how far ascents begin above asin(sin phi/gamma) at the mean tilt `phi_mean` (rad):
        release and resistance together.
    told : unknown -> posterior over prior standard deviation, what the trials tell about it.
    correlation : of c_rr and release, nan where one of them is not free.
    findings : what is wrong; empty means ok.
    """

    trials: Trials
    posterior: ReleasePosterior
    chain: Chain
    agreement: Agreement
    ways: Mapping[str, GammaEstimate]
    ends_apart: Quantity | None
    thresholds: tuple[Threshold, ...]
    offset: Quantity
    phi_mean: float
    told: Mapping[str, float]
    correlation: float
    gamma_masses: Quantity | None
    findings: tuple[Finding, ...]
    seed: int

    @property
    def disagreements(self) -> tuple[str, ...]:
        """Where gamma of the trials and gamma as stated differ at k = 2, or gamma of the two ends;
        no fault of the trials by themselves.
        """
        if not self.status.ok:
            return ()
        both, findings = self.ways["both"], []
        if self.gamma_masses is not None and abs(both.e_n) > 1.0:
            gammas = (("trials", both.quantity), ("stated", self.gamma_masses))
            findings.append(Finding(Kind.TRIALS_DISAGREE, size=both.e_n, numbers=_numbers(gammas)))
        difference = self.ends_apart
        if difference is not None and abs(sds := difference.value / difference.u) > 2.0:
            numbers = _numbers((("apart", difference),)) | {"sds": sds}
            findings.append(Finding(Kind.ENDS_DISAGREE, size=0.5 * sds, numbers=numbers))
        return tuple(map(describe, findings))

    def summary(self, name: str) -> Summary:
        unit, meaning, _ = UNKNOWNS[name]
        return summarise(self.chain.column(name), unit=unit, meaning=phrase(meaning))

    def starts(self, end: str, phi: FloatArray) -> FloatArray:
        """(n_draw, n_phi) rad: where ascents begin at true tilts `phi`, of up to 2000 draws,
        release included.
        """
        draws = self.chain.thinned(2000)
        inside = effective_start(
            {n: draws[:, i] for i, n in enumerate(self.chain.names)},
            end,
            phi,
            self.posterior.resistance,
        )
        return inside if end == LOW else np.pi - inside

    def _repr_markdown_(self) -> str:
        """What a notebook shows: the values, or why there are none."""
        rows = [
            parameter_cells(self.summary(name), UNKNOWNS[name][2].label(UNKNOWNS[name][0]))
            for name in self.chain.names
        ]
        title = phrase("Trials of release of {body}", body=self.trials.body)
        advice = advice_for(self.findings)
        return headline(
            title,
            kind="",
            status=self.status,
            reasons=self.reasons,
            advice=advice,
            shown=posterior_table(rows),
        )


def _numbers(quantities: tuple[tuple[str, Quantity], ...]) -> dict[str, float]:
    return {name: q.value for name, q in quantities} | {f"u_{name}": q.u for name, q in quantities}


def analyse_trials(
    trials: Trials,
    resistance: Prior | float,
    *,
    gamma_masses: Quantity | None,
    seed: int,
    target: Target | None = None,
    progress: Progress | None = None,
) -> TrialsAnalysis:
    """Every result of trials of release; the same seed gives the same numbers.

    resistance : prior of c_rr, or its exact value.
    gamma_masses : gamma as stated, to compare with; it does not enter.
    """
    posterior = release_posterior(trials, resistance)
    certified = certified_chain(
        posterior,
        Optima(*rough_start(posterior)),
        target=target or Target(),
        seed=seed,
        most=MAX_PARAMETERS,
        support=posterior.support,
        progress=progress,
    )
    chain, agreement = certified.chain, certified.comparison
    values = {name: chain.flat[:, i] for i, name in enumerate(chain.names)}
    findings = _findings(trials, posterior, values, chain, agreement)
    results = {"both": _result_of(values["gamma"], gamma_masses, True)}
    difference = None
    if decide(findings).draws_count:
        variants = {end: trials.end(end) for end in trials.ends if len(trials.ends) > 1}
        variants |= {"free": replace(trials, release=0.0)} if trials.release > 0.0 else {}
        for i, (name, variant) in enumerate(variants.items()):
            weighted = weigh(
                release_posterior(variant, resistance), rng=stream(seed, Stream.RELEASE_DRAWS, i)
            )
            results[name] = _result_of(weighted.draws[:, 0], gamma_masses, weighted.reliable)
        difference = (
            _difference_of_ends(
                trials, resistance, rng=stream(seed, Stream.RELEASE_DRAWS, len(variants))
            )
            if len(trials.ends) > 1
            else None
        )
    phi_mean = float(np.mean([tilt.phi for tilt in trials.tilts]))
    begins = effective_start(values, LOW, np.array([phi_mean]), posterior.resistance)[:, 0]
    above = begins - start_angle(math.sin(phi_mean) / values["gamma"])
    shares: dict[str, float] = {
        name: float(values[name].std() / posterior.priors[name].sd)
        for name in ("rolling_resistance", "release", "scatter")
        if name in values
    }
    both = "rolling_resistance" in values and "release" in values
    correlation = (
        float(np.corrcoef(values["rolling_resistance"], values["release"])[0, 1])
        if both
        else math.nan
    )
    return TrialsAnalysis(
        trials,
        posterior,
        chain,
        agreement,
        results,
        difference,
        thresholds(trials, values["scatter"]),
        Quantity.of(above),
        phi_mean,
        shares,
        correlation,
        gamma_masses,
        findings,
        seed,
    )


def rough_start(posterior: ReleasePosterior) -> tuple[FloatArray, FloatArray]:
    """Mean (n_par,) and covariance (n_par, n_par) to start from: those of the priors, of gamma
    about a rough value.
    """
    rough = rough_gamma(posterior.trials)
    pairs = [
        (rough, 0.5 * rough) if name.startswith("gamma") else (prior.expectation, prior.sd)
        for name, prior in posterior.priors.items()
    ]
    mean, sd = np.array(pairs).T
    return mean, np.diag(sd**2)


def weigh(posterior: ReleasePosterior, *, rng: np.random.Generator) -> Certificate:
    """The posterior by importance sampling alone: some tenths of a second; `reliable` tells whether
    to believe it.
    """
    proposal = adapt_proposal(posterior, *rough_start(posterior), rng=rng)
    return certify(posterior, proposal, rng=rng)


def _result_of(gamma: FloatArray, gamma_masses: Quantity | None, reliable: bool) -> GammaEstimate:
    summary = summarise(gamma, unit="1", meaning=phrase(UNKNOWNS["gamma"][1]))
    estimate = Quantity.of(gamma)
    return GammaEstimate(
        summary, math.nan if gamma_masses is None else e_n(estimate, gamma_masses), reliable
    )


def _difference_of_ends(
    trials: Trials, resistance: Prior | float, *, rng: np.random.Generator
) -> Quantity | None:
    weighted = weigh(release_posterior(trials, resistance, split=True), rng=rng)
    difference = weighted.draws[:, 0] - weighted.draws[:, 1]
    return Quantity.of(difference) if weighted.reliable else None


def _findings(
    trials: Trials,
    posterior: ReleasePosterior,
    values: Mapping[str, FloatArray],
    chain: Chain,
    agreement: Agreement,
) -> tuple[Finding, ...]:
    findings = sampling_findings(chain)
    if agreement.verdict == "disagree":
        findings.append(Finding(Kind.METHODS_DIFFER, parts=agreement.findings))
    share = float(values["gamma"].std() / posterior.priors["gamma"].sd)
    if trials.n_climbed in (0, trials.n_trial) or share > PRIOR_DOMINATED:
        findings.append(
            Finding(
                Kind.TRIALS_SILENT,
                size=trials.n_climbed,
                numbers={"n_trial": trials.n_trial, "share": share},
            )
        )
    typical = float(np.median(values["scatter"]))
    if typical > FACTOR * trials.u_theta:
        numbers = {"stated": math.degrees(trials.u_theta), "factor": FACTOR}
        findings.append(Finding(Kind.TRIALS_SCATTER, size=math.degrees(typical), numbers=numbers))
    return wrong(findings)


_N_SCATTER = 40  # values of the scatter, equally probable
# of the grid of angles: this, or this share of u_theta where that is smaller
_STEP, _SHARE = math.radians(0.1), 0.1


@dataclass(frozen=True, eq=False)
class Threshold:
    """Where ascents begin at one tilt.

    end : "min" or "max".
    phi : rad.  n_trial, n_climbed : trials at that end.
    quantiles : (5,) rad, at 2.5, 16, 50, 84, 97.5 %, angles from the vertical.  Where all trials
        climbed or none did, the prior is one of the ends.
    """

    end: str
    phi: float
    n_trial: int
    n_climbed: int
    quantiles: FloatArray


def thresholds(trials: Trials, scatter: FloatArray) -> tuple[Threshold, ...]:
    """The threshold at each end of each tilt where there are trials, by end and tilt.

    scatter : (n_draw,) rad, draws of the standard deviation from trial to trial.
    """
    n_angle = min(
        math.ceil(0.5 * np.pi / min(_STEP, _SHARE * float(np.quantile(scatter, 0.01)))) + 1, 9001
    )
    angles = np.linspace(0.0, 0.5 * np.pi, n_angle)
    spread = np.quantile(scatter, (np.arange(_N_SCATTER) + 0.5) / _N_SCATTER)[:, None]
    starts = np.broadcast_to(angles, (_N_SCATTER, n_angle))
    results = []
    for end in (LOW, HIGH):
        for part in trials.end(end).tilts:
            logs = outcomes(part, end, starts, spread, None)
            shapes = np.exp(logs - logs.max(axis=1, keepdims=True))
            density = np.mean(shapes / shapes.sum(axis=1, keepdims=True), axis=0)
            below = np.cumsum(density) - 0.5 * density
            at = np.interp(QUANTILES, below / below[-1], angles)
            at = at if end == LOW else np.pi - at[::-1]
            results.append(
                Threshold(end, part.phi, part.theta.size, int(np.count_nonzero(part.climbed)), at)
            )
    return tuple(results)
