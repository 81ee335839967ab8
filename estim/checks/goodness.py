"""Does the curve explain the data?  Tests on whitened residuals, for each run.

A residual vector with covariance C = L L^T is whitened in the order of the observations, z = L^-1 (y - f): if model and
noise are right, z is nearly unit white noise.  Nearly, because the fit has pulled the residuals towards zero; the null
distribution of each statistic is therefore simulated with that projection in it:

    z = e - J (J^T J + J_p^T J_p)^-1 (J^T e + J_p^T e_p)        J, J_p: whitened Jacobians of data and priors

Where x has errors, z is the normal score of y under its density given x, F^-1(P(Y < y | x)), for any curve a standard normal variable at the
true parameters; the score J^T e and the slope -J are then functions of e, tabulated point by point.

What each test sees: `chi2` the size of the residuals (only where the size of the noise was stated); `runs` too few
changes of sign; `autocorrelation` neighbours alike; `trend` a slow drift along the run; `largest` a single outlier.
Residuals that are all zero have no pattern to test: they fail as such (`zero`).
An inferred scatter swallows chi2, so the scatter itself is compared with what the instrument explains.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from estim.arrays import FloatArray
from estim.fitting import Fit, no_scatter
from estim.problem import LatentRun, Observations, covariance, noise_parameters, reading_sd
from estim.words import TESTS

BoolArray = NDArray[np.bool_]

P_POOR_FIT = 1e-3
SCATTER_LIMIT = 10.0
_NO_ERRORS = 1e-9  # standard deviations; residuals that are all smaller are rounding errors
_N_SIMULATED = 20_000
P_FLOOR = 1.0 / (1.0 + _N_SIMULATED)  # a p-value of the tests below cannot come out smaller


@dataclass(frozen=True)
class Check:
    """One test: its statistic, the probability of a value at least as extreme under the model, and what failing it means."""

    statistic: float
    p_value: float
    meaning: str


@dataclass(frozen=True, eq=False)
class Goodness:
    """How well one run is explained.

    whitened : (n_obs,) residuals with unit covariance, in order; heavy tails are mapped to normal scores.
    raw : (n_obs,) residuals in units of the ordinate.
    sd : (n_obs,) their standard deviations.
    checks : name -> Check.  scatter_ratio : inferred scatter / instrument's share of the noise; nan where not inferred.
    """

    run: str
    whitened: FloatArray
    raw: FloatArray
    sd: FloatArray
    checks: Mapping[str, Check]
    scatter_ratio: float

    @property
    def only_too_large(self) -> bool:
        """Whether the residuals are as random as they should be, and only larger than stated."""
        return self.failed == ("chi2",)

    @property
    def failed(self) -> tuple[str, ...]:
        """Names of the tests that the run fails."""
        return tuple(name for name, check in self.checks.items() if check.p_value < P_POOR_FIT)


def check_goodness(fit: Fit, *, rng: np.random.Generator) -> tuple[Goodness, ...]:
    """One `Goodness` for each run of a fit; `rng` draws the simulated null distributions."""
    problem, posterior = fit.problem, fit.posterior
    named = problem.named(fit.values)
    noise = np.array([name in problem.noise_names for name in problem.names])
    factors, responses, raws = [], [], []
    for run, whitening in zip(problem.runs, posterior.whitenings, strict=True):
        factors.append(np.asarray(np.linalg.cholesky(covariance(run.noise, whitening, named))))
        responses.append(_response(fit, run, factors[-1], noise))
        curve = np.broadcast_to(run.curve.value(run.x, run.bind(named)), (1, run.n_obs))[0]
        raws.append(run.y - whitening.offset - curve)
    pulls = np.diag([p.prior.residual_slope(float(v)) for p, v in zip(problem.parameters, fit.values, strict=True)])
    pulls[noise] = 0.0
    design = np.vstack([*(response.root for response in responses), pulls])
    scale = np.linalg.norm(design, axis=0)
    scale[scale == 0.0] = 1.0
    n_error = problem.n_obs + problem.n_par
    errors = rng.standard_normal((n_error, min(_N_SIMULATED, int(4e7 / n_error))))
    by_run = np.split(errors, np.cumsum([run.n_obs for run in problem.runs]))
    felt = [response.felt(error) for response, error in zip(responses, by_run, strict=False)]
    shifts = (np.linalg.pinv(design / scale, rcond=1e-13) / scale[:, None]) @ np.vstack([*felt, by_run[-1]])
    checked = []
    for run, factor, response, raw, error in zip(problem.runs, factors, responses, raws, by_run, strict=False):
        simulated = response.moved(error, shifts).T
        whitened = run.noise.tails.normal_score(np.linalg.solve(factor, raw), named)
        if run.latent is not None:
            whitened = run.latent.normal_score(named)[0]
        stated = not noise_parameters(run.noise)
        sd = np.sqrt(np.sum(factor**2, axis=1))
        empty = no_scatter(run, fit) or float(np.max(np.abs(whitened))) < _NO_ERRORS
        checks = {"zero": Check(0.0, P_FLOOR, TESTS["zero"])} if empty else _checks(whitened, simulated, stated=stated)
        checked.append(Goodness(run.name, whitened, raw, sd, checks, _scatter_ratio(run, named)))
    return tuple(checked)


class _Response(Protocol):
    """How the fit pulls the residuals of a run; root : (n, n_par) J with J^T J the information that it gives about the curve."""

    root: FloatArray

    def felt(self, errors: FloatArray) -> FloatArray:
        """(n, n_sim) r with J^T r the derivative of the log likelihood, for standard normal errors (n_obs, n_sim)."""

    def moved(self, errors: FloatArray, shifts: FloatArray) -> FloatArray:
        """(n_obs, n_sim) the residuals when the parameters are moved by shifts (n_par, n_sim)."""


class _Linear:
    """Whitened residuals that are linear in the parameters."""

    def __init__(self, jacobian: FloatArray) -> None:
        self.root = jacobian

    def felt(self, errors: FloatArray) -> FloatArray:
        return errors

    def moved(self, errors: FloatArray, shifts: FloatArray) -> FloatArray:
        return errors - self.root @ shifts


class _Tabled:
    """Normal scores of points with errors of x: what they tell of the parameters is not linear in them, a table says what it is."""

    def __init__(self, run: LatentRun, root: FloatArray, named: Mapping[str, ArrayLike], names: tuple[str, ...], noise: BoolArray) -> None:
        self.root = root
        self.at, scores, slopes = run.score_table(named, names)
        self.scores, self.slopes = np.where(noise, 0.0, scores), np.where(noise, 0.0, slopes)

    def felt(self, errors: FloatArray) -> FloatArray:
        score = np.zeros((self.scores.shape[2], errors.shape[1]))
        for error, table in zip(errors, self.scores, strict=True):
            for row, column in zip(score, table.T, strict=True):
                row += np.interp(error, self.at, column)
        scale = np.linalg.norm(self.root, axis=0)
        scale[scale == 0.0] = 1.0
        return np.asarray(np.linalg.pinv((self.root / scale).T, rcond=1e-9) @ (score / scale[:, None]))

    def moved(self, errors: FloatArray, shifts: FloatArray) -> FloatArray:
        moved = errors.copy()
        for one, error, table in zip(moved, errors, self.slopes, strict=True):
            for column, shift in zip(table.T, shifts, strict=True):
                one += np.interp(error, self.at, column) * shift
        return moved


def _response(fit: Fit, run: Observations, factor: FloatArray, noise: BoolArray) -> _Response:
    if run.latent is not None:
        root = fit.posterior.information_roots(fit.values)[fit.problem.runs.index(run)]
        return _Tabled(run.latent, root, fit.problem.named(fit.values), fit.names, noise)
    return _Linear(np.asarray(np.linalg.solve(factor, np.where(noise, 0.0, fit.posterior.curve_jacobian(run, fit.values)))))


def untested(fit: Fit) -> tuple[Goodness, ...]:
    """Residuals of which no test can be made: as many parameters as points, or rounding errors only."""
    records = []
    for run, whitening, z in zip(fit.problem.runs, fit.posterior.whitenings, fit.posterior.standardised(fit.values), strict=True):
        curve = np.broadcast_to(run.curve.value(run.x, run.bind(fit.problem.named(fit.values))), (1, run.n_obs))[0]
        raw = run.y - whitening.offset - curve
        sd = np.sqrt(np.diag(covariance(run.noise, whitening, fit.problem.named(fit.values))))
        records.append(Goodness(run.name, z, raw, sd, {}, float("nan")))
    return tuple(records)


def _scatter_ratio(run: Observations, named: Mapping[str, FloatArray]) -> float:
    instrument = float(np.sqrt(np.mean(np.square(reading_sd(run.noise, named)))))
    if run.noise.scatter.parameter is None or run.noise.sigma.parameter is not None or instrument == 0.0:
        return float("nan")
    return float(named[run.noise.scatter.parameter]) / instrument


def _checks(z: FloatArray, simulated: FloatArray, *, stated: bool) -> dict[str, Check]:
    """Statistics of z (n_obs,) against simulated ones (n_sim, n_obs); every statistic is large when the model is wrong."""
    observed, null = _statistics(z[None, :]), _statistics(simulated)
    checks = {}
    for name in observed:
        if name == "chi2" and not stated:
            continue
        statistic = float(observed[name][0])
        p = (1.0 + float(np.sum(null[name] >= statistic - 1e-12))) / (1.0 + null[name].size)
        checks[name] = Check(statistic, p, TESTS[name])
    return checks


def _statistics(z: FloatArray) -> dict[str, FloatArray]:
    """Name -> (n,) statistic of each row of z (n, n_obs)."""
    n = z.shape[1]
    square = np.sum(z**2, axis=1)
    size = np.where(square > 0.0, square, 1.0)  # residuals that are all exactly zero have no shape
    place = np.linspace(-1.0, 1.0, n)
    shapes, _ = np.linalg.qr(np.vander(place, 4, increasing=True))
    return {
        "chi2": square,
        "runs": -np.sum(np.signbit(z[:, 1:]) != np.signbit(z[:, :-1]), axis=1).astype(float),
        "autocorrelation": np.sum(z[:, 1:] * z[:, :-1], axis=1) / size,
        "trend": np.max(np.abs(z @ shapes), axis=1) / np.sqrt(size / n),
        "largest": np.max(np.abs(z), axis=1) / np.sqrt(size / n),
    }
