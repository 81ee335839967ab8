"""Data sets with curves of their own that have parameters in common, beside likelihoods written by
hand.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares, minimize
from scipy.special import gammaln, ndtr
from scipy.stats import t as student_t

from estim import AxisNames, DataSet, EventTimes, Poisson, fit_curve, fit_curves, sample_curve
from estim.common import InputError
from estim.fitting import error_sizes

EXACT = {"xatol": 1e-8, "fatol": 1e-10, "maxiter": 40000, "maxfev": 40000}
# SYNTHETIC: current and temperature of a wire that its current heats
U = np.linspace(0.5, 10.0, 20)
TRUE = {"p2": 0.65, "p1": 1.1, "p0": 19.0, "r0": 1.02, "alpha": 0.0038}
HEAT, OHM = "p2*x**2 + p1*x + p0", "x/(r0*(1 + alpha*(p2*x**2 + p1*x + p0)))"
RNG = np.random.default_rng(11)
NOISE_T, NOISE_I = 0.5 * RNG.standard_normal(20), 0.1 * RNG.standard_normal(20)


def temperature(x: Any, p2: Any = 1.0, p1: Any = 1.0, p0: Any = 0.0) -> Any:
    return p2 * x**2 + p1 * x + p0


def current(
    x: Any, r0: Any = 1.0, alpha: Any = 0.004, p2: Any = 2.0, p1: Any = 2.0, p0: Any = 1.0
) -> Any:
    return x / (r0 * (1.0 + alpha * temperature(x, p2, p1, p0)))


HOT = temperature(U, **{name: TRUE[name] for name in ("p2", "p1", "p0")}) + NOISE_T
FLOWS = current(U, **TRUE) + NOISE_I
WIRE = {"heat": DataSet(U, HOT, u_y=0.5, curve=HEAT), "flow": DataSet(U, FLOWS, u_y=0.1, curve=OHM)}


def curvature_sds(minus: Callable[[np.ndarray], float], at: Any, steps: Any) -> Any:
    """Standard deviations by the second differences of a negative log-likelihood."""
    moves = np.diag(steps)
    hessian = [
        [
            sum(a * b * minus(at + a * one + b * other) for a in (-1, 1) for b in (-1, 1))
            / (4.0 * np.max(one) * np.max(other))
            for other in moves
        ]
        for one in moves
    ]
    return np.sqrt(np.diag(np.linalg.inv(np.array(hessian))))


def by_hand() -> tuple[np.ndarray, np.ndarray, float]:
    """Values, standard deviations and chi-squared of the wire, in the order of TRUE."""

    def residuals(p: np.ndarray) -> np.ndarray:
        p2, p1, p0, r0, alpha = p
        warm = p2 * U**2 + p1 * U + p0
        return np.concatenate([(HOT - warm) / 0.5, (FLOWS - U / (r0 * (1 + alpha * warm))) / 0.1])

    best = least_squares(residuals, list(TRUE.values()), x_scale="jac", xtol=1e-15, ftol=1e-15)
    return best.x, np.sqrt(np.diag(np.linalg.inv(best.jac.T @ best.jac))), 2.0 * best.cost


@pytest.mark.parametrize("turned", [False, True])
def test_curves_that_share_parameters_are_least_squares_of_everything_at_once(turned: bool) -> None:
    sets = dict(reversed(WIRE.items())) if turned else WIRE
    fit = fit_curves(None, sets, derived={"R20": "r0*(1 + 20*alpha)"})
    values, sds, chi2 = by_hand()
    assert [fit.values[name] for name in TRUE] == pytest.approx(values, rel=1e-5)
    assert [fit.sds[name] for name in TRUE] == pytest.approx(sds, rel=1e-3)
    assert (fit.chi2, fit.dof, str(fit.status)) == (pytest.approx(chi2), 35, "ok")
    assert set(fit.names) == set(TRUE)
    assert [run.name for run in fit.problem.runs] == list(sets)
    assert fit.derived["R20"].value == pytest.approx(values[3] * (1 + 20 * values[4]), rel=1e-5)
    assert fit.predict(5.0, data="heat").value[0] == pytest.approx(
        temperature(5.0, *values[:3]), rel=1e-5
    )


def test_a_function_s_argument_that_another_curve_fits_is_fit() -> None:
    sets = {
        "flow": DataSet(U, FLOWS, u_y=0.1, curve=current),
        "heat": DataSet(U, HOT, u_y=0.5, curve=temperature),
    }
    values, sds, _ = by_hand()
    fit = fit_curves(None, sets)
    assert [fit.values[name] for name in TRUE] == pytest.approx(values, rel=1e-5)
    # beside a start an argument with a number by default keeps that, but not what the other fits
    held = fit_curves(None, sets, start={"r0": 1.0})
    assert set(held.names) == {"r0", "p2", "p1", "p0"}
    one = fit_curves(None, sets, start={"r0": 1.0, "alpha": 0.004})
    assert [one.values[name] for name in TRUE] == pytest.approx(values, rel=1e-5)
    assert [one.sds[name] for name in TRUE] == pytest.approx(sds, rel=1e-3)


def test_a_start_that_one_curve_finds_is_that_of_the_next() -> None:
    """What a tie follows has a start from the other curve's points."""
    sets = {
        "square": DataSet(U, 6.0 * U**2 + 1.0 + NOISE_I, u_y=0.1, curve="d*x**2 + c"),
        "line": DataSet(U, 2.0 * U + NOISE_I, u_y=0.1, curve="a*x"),
    }
    fit = fit_curves(None, sets, tied={"d": "3*a"}, start={"c": 0.0})
    weights = np.concatenate([3.0 * U**2, U]), np.concatenate([np.ones(20), np.zeros(20)])
    y = np.concatenate([6.0 * U**2 + 1.0 + NOISE_I, 2.0 * U + NOISE_I])
    best = np.linalg.lstsq(np.column_stack(weights), y, rcond=None)[0]
    assert [fit.values["a"], fit.values["c"]] == pytest.approx(best, rel=1e-6)
    assert fit.derived["d"].value == pytest.approx(3.0 * best[0])


def test_a_wrong_curve_of_one_set_is_refused_by_its_name() -> None:
    cold = {**WIRE, "flow": DataSet(U, FLOWS, u_y=0.1, curve="x/(r0*(1 + 0.1*p1))")}
    fit = fit_curves(None, cold)
    assert fit.status == "poor-fit"
    assert any("flow" in reason for reason in fit.reasons)
    assert "±" not in str(fit)


def test_what_is_not_shared_is_of_each_set() -> None:
    fit = fit_curves(None, WIRE, shared=["p2", "p1"], fixed={"p0[flow]": 19.0})
    assert set(fit.names) == {"p2", "p1", "p0[heat]", "r0[flow]", "alpha[flow]"}
    assert fit.fixed == {"p0[flow]": 19.0}
    values = fit_curves(None, WIRE, fixed={"p0": 19.0})
    assert values.fixed == {"p0": 19.0}
    assert set(values.names) == {"p2", "p1", "r0", "alpha"}


def test_one_curve_without_a_word_of_what_is_shared_is_one_curve_of_all_points() -> None:
    x, y = (
        np.concatenate([U, U + 0.1]),
        np.concatenate([HOT, temperature(U + 0.1, 0.65, 1.1, 19.0)]),
    )
    fit = fit_curves(
        HEAT, {"one": DataSet(U, HOT, u_y=0.5), "two": DataSet(U + 0.1, y[20:], u_y=0.5)}
    )
    whole = fit_curve(HEAT, x, y, u_y=0.5)
    assert fit.values == pytest.approx(whole.values, rel=1e-6)
    assert fit.sds == pytest.approx(whole.sds, rel=1e-4)


def test_a_set_may_have_fewer_points_than_parameters() -> None:
    """A single point of I(U) tells r0, where alpha is known."""
    few = {**WIRE, "flow": DataSet(U[:1], FLOWS[:1], u_y=0.1, curve=OHM)}
    fit = fit_curves(None, few, fixed={"alpha": 0.004})
    heat = fit_curve(HEAT, U, HOT, u_y=0.5)
    assert fit.values["p2"] == pytest.approx(heat.values["p2"], rel=1e-5)
    assert fit(U[:1], data="flow") == pytest.approx(FLOWS[:1], rel=1e-4)
    with pytest.raises(InputError, match="at least as many points as parameters"):
        fit_curves(None, {"flow": few["flow"]})


# --- two kinds of noise

T = np.linspace(0.25, 9.75, 20)
EDGES = np.linspace(0.0, 10.0, 21)
COUNTS = np.random.default_rng(5).poisson(400.0 * np.exp(-T / 3.0) + 10.0)
VOLTS = 2.0 * np.exp(-T / 3.0) + 0.05 * np.random.default_rng(6).standard_normal(20)
TIMES = np.random.default_rng(7).exponential(3.0, 400)
TIMES = TIMES[TIMES < 10.0]


def mixed(volts: np.ndarray, volts_curve: str = "V*exp(-x/tau)") -> Any:
    return fit_curves(
        None,
        {
            "read": DataSet(T, volts, u_y=0.05, curve=volts_curve),
            "counted": DataSet(T, COUNTS, noise=Poisson(), curve="N*exp(-x/tau) + B"),
            "times": DataSet(TIMES, None, noise=EventTimes(0, 10), curve="exp(-x/tau)"),
        },
        start={"V": 1.0, "tau": 2.0, "N": 300.0, "B": 5.0},
        bounds={"tau": (0.1, 50.0), "B": (0.0, None), "N": (0.0, None)},
    )


def test_readings_counts_and_times_share_a_lifetime() -> None:
    """Beside the sum of the three negative log-likelihoods, as iminuit's CostSum is."""

    def minus(p: np.ndarray) -> float:
        v, tau, n, b = p
        mean = n * np.exp(-T / tau) + b
        return float(
            0.5 * np.sum(((VOLTS - v * np.exp(-T / tau)) / 0.05) ** 2)
            + np.sum(mean - COUNTS * np.log(mean) + gammaln(COUNTS + 1.0))
            + np.sum(TIMES / tau + np.log(tau * (1.0 - np.exp(-10.0 / tau))))
        )

    best = minimize(minus, [2.0, 3.0, 400.0, 10.0], method="Nelder-Mead", options=EXACT)
    sds = curvature_sds(minus, best.x, 1e-3 * best.x)
    fit = mixed(VOLTS)
    assert fit.status == "ok"
    names = ("V", "tau", "N", "B")
    assert np.abs([fit.values[name] for name in names] - best.x) / sds == pytest.approx(0, abs=0.01)
    assert [fit.sds[name] for name in names] == pytest.approx(sds, rel=0.05)
    alone = fit_curve("N*exp(-x/tau) + B", T, COUNTS, noise="poisson")
    assert fit.sds["tau"] < 0.9 * alone.sds["tau"]


def test_a_wrong_curve_beside_other_noise_is_refused() -> None:
    fit = mixed(VOLTS, "V*exp(-(x/tau)**2)")
    assert fit.status == "poor-fit"
    assert any("read" in reason for reason in fit.reasons)


PEAK = "{0}*exp(-(x - mu)**2/(2*(w**2 + {1}**2)))/sqrt(2*pi*(w**2 + {1}**2)) + {2}/10"


def histograms(other: float) -> tuple[Any, list[tuple[np.ndarray, np.ndarray]]]:
    """The fit of two histograms, and their edges and counts; other : place of the second peak."""
    rng = np.random.default_rng(2)
    drawn = []
    sizes = ((30, 0.66, 160, 40, 6.66), (50, 0.11, 125, 375, other))
    for bins, blur, signal, flat, place in sizes:
        raw = (rng.normal(place, np.hypot(0.33, blur), signal), rng.uniform(0, 10, flat))
        counts, edges = np.histogram(np.concatenate(raw), bins=bins, range=(0, 10))
        drawn.append((edges, counts))
    fit = fit_curves(
        None,
        {
            name: DataSet(
                0.5 * (edges[1:] + edges[:-1]),
                counts,
                noise=Poisson(bins=edges),
                curve=PEAK.format(f"S{name}", f"r{name}", f"B{name}"),
            )
            for name, (edges, counts) in zip("12", drawn, strict=True)
        },
        start={"mu": 6.5, "w": 0.4, "S1": 150, "B1": 50, "S2": 100, "B2": 400}
        | {"r1": 0.66, "r2": 0.11},
        bounds={"w": (0.01, 3.0), **dict.fromkeys(("S1", "S2", "B1", "B2"), (0.0, None))},
        priors={"r1": "0.66(17)", "r2": "0.110(55)"},
        scan=False,
    )
    return fit, drawn


def test_two_histograms_share_place_and_width() -> None:
    """Beside the brute-force maximum of the Poisson likelihood of both."""
    fit, drawn = histograms(6.66)
    names = ("mu", "w", "S1", "B1", "S2", "B2", "r1", "r2")

    def minus(p: np.ndarray) -> float:
        mu, w, s1, b1, s2, b2, r1, r2 = p
        total = 0.5 * ((r1 - 0.66) / 0.17) ** 2 + 0.5 * ((r2 - 0.11) / 0.055) ** 2
        for (e, c), s, b, r in zip(drawn, (s1, s2), (b1, b2), (r1, r2), strict=True):
            shares = np.diff(ndtr((e - mu) / np.hypot(w, r)))
            mean = s * shares + b * np.diff(e) / 10
            total += np.sum(mean - c * np.log(mean))
        return float(total)

    at = np.array([fit.values[name] for name in names])
    assert fit.status == "ok"
    best = minimize(minus, at, method="Nelder-Mead", options=EXACT)
    sds = np.array([fit.sds[name] for name in names])
    assert np.abs(at - best.x) / sds == pytest.approx(0, abs=0.05)


@pytest.mark.slow
def test_a_place_that_is_not_shared_is_refused() -> None:
    fit, _ = histograms(5.2)
    assert fit.status == "poor-fit"


# --- what is unknown of the errors, of each data set

DAYS = {
    name: np.sort(np.random.default_rng(seed).uniform(0.0, 60.0, n))
    for seed, (name, n) in enumerate({"k": 60, "j": 40, "a": 50}.items())
}
JITTERS = {"k": 3.0, "j": 0.0, "a": 1.5}
SPEEDS = {
    name: 5.0 * np.sin(2 * np.pi * x / 11.0 + 0.4)
    + {"k": 1.0, "j": -2.0, "a": 0.5}[name]
    + np.hypot(1.0, JITTERS[name]) * np.random.default_rng(10 + i).standard_normal(x.size)
    for i, (name, x) in enumerate(DAYS.items())
}
STAR = "K*sin(2*pi*x/P + phi) + gamma"
STAR_START = {"K": 4.0, "P": 11.0, "phi": 0.3, "gamma": 0.0}


def star(curve: str = STAR, **choices: Any) -> Any:
    data = {name: DataSet(x, SPEEDS[name], u_y=1.0) for name, x in DAYS.items()}
    start = {name: value for name, value in STAR_START.items() if name in curve}
    shared = [name for name in ("K", "P", "phi") if name in start]
    return fit_curves(curve, data, shared=shared, start=start, **choices)


def test_each_instrument_has_its_jitter() -> None:
    """Beside the normal likelihood whose variance is u_y^2 + jitter^2, of each instrument."""
    order = ("K", "P", "phi", "gamma[k]", "gamma[j]", "gamma[a]", "jitter[k]", "jitter[a]")

    def minus(p: np.ndarray, last: float = 0.0) -> float:
        k, period, phi = p[:3]
        total = 0.0
        for name, zero, scatter in zip("kja", p[3:6], (p[6], last, p[7]), strict=True):
            size = 1.0 + scatter**2
            mean = k * np.sin(2 * np.pi * DAYS[name] / period + phi) + zero
            total += 0.5 * np.sum((SPEEDS[name] - mean) ** 2 / size + np.log(size))
        return float(total)

    fit = star(jitter=True)
    assert fit.status == "ok"
    assert {"jitter[k]", "jitter[j]", "jitter[a]"} < set(fit.names)
    begin = [5.0, 11.0, 0.4, 1.0, -2.0, 0.5, 3.0, 1.5]
    best = minimize(lambda p: minus(p, fit.values["jitter[j]"]), begin, method="Nelder-Mead",
                    options={**EXACT, "adaptive": True})  # fmt: skip
    sds = curvature_sds(lambda p: minus(p, fit.values["jitter[j]"]), best.x, np.full(8, 1e-3))
    values = np.array([fit.values[name] for name in order])
    assert np.abs(values - best.x) / sds == pytest.approx(0, abs=0.01)
    names = list(fit.fit.names)
    assert [fit.fit.sds[names.index(name)] for name in order] == pytest.approx(sds, rel=0.02)
    # a little wider than the curvature: the sizes of the errors are from the same residuals
    wider = np.array([fit.sds[name] for name in order[:6]]) / sds[:6]
    assert np.all((wider > 1.005) & (wider < 1.1))
    # the one without any is found small, by the profile of the same likelihood
    low, high = fit.intervals["jitter[j]"][0.95]
    assert low == 0.0
    rise = [
        minimize(lambda p, at=at: minus(p, at), best.x, method="BFGS").fun
        for at in (fit.values["jitter[j]"], high)
    ]
    sizes = error_sizes(fit.held)
    shares = sizes.shares(np.eye(len(names))[[names.index("jitter[j]")]])
    dof = sizes.degrees_of_freedom(shares)
    n = DAYS["j"].size
    assert n - 6 < float(dof[0]) < n
    assert 2.0 * (rise[1] - rise[0]) == pytest.approx(
        n * math.log1p(student_t.ppf(0.975, float(dof[0])) ** 2 / float(dof[0])), abs=0.2
    )


@pytest.mark.slow
def test_a_fit_with_jitter_is_sampled_of_one_set_and_of_several() -> None:
    """A flat prior of the jitter says nothing of it; means and widths are those of the fit."""
    one = fit_curve(STAR, DAYS["k"], SPEEDS["k"], u_y=1.0, jitter=True, start=STAR_START)
    for fit in (one, star(jitter=True)):
        analysis = sample_curve(fit, seed=1)
        assert analysis.diagnosis.status == "ok"
        draws = analysis.chain.flat[:, analysis.problem.names.index("K")]
        assert abs(draws.mean() - fit.values["K"]) < 0.2 * fit.sds["K"]
        assert draws.std() == pytest.approx(fit.sds["K"], rel=0.15)


def test_jitter_of_one_set_is_not_that_of_the_others() -> None:
    data = {
        name: DataSet(x, SPEEDS[name], u_y=1.0, jitter=True if name == "k" else None)
        for name, x in DAYS.items()
    }
    fit = fit_curves(STAR, data, shared=["K", "P", "phi"], start=STAR_START)
    assert [name for name in fit.names if "jitter" in name] == ["jitter[k]"]
    assert fit.status == "poor-fit"
    assert all("run a" in reason for reason in fit.reasons)
    known = {**data, "a": DataSet(DAYS["a"], SPEEDS["a"], u_y=1.0, jitter="1.5(2)")}
    assert fit_curves(STAR, known, shared=["K", "P", "phi"], start=STAR_START).status == "ok"


def test_jitter_does_not_hide_a_wrong_curve() -> None:
    wrong = star("K*x + gamma", jitter=True)
    assert wrong.status == "poor-fit"
    assert star(jitter=False).status == "poor-fit"


def test_robust_errors_of_one_set_beside_normal_ones_of_another() -> None:
    """Beside Student's t with 4 degrees of freedom of the first, the normal law of the second."""
    volts = VOLTS + np.where(np.arange(20) == 7, 1.5, 0.0)
    sets = {
        "bad": DataSet(T, volts, u_y=0.05, robust="student-t"),
        "good": DataSet(T, VOLTS - 0.01, u_y=0.05),
    }

    def minus(p: np.ndarray) -> float:
        curve = p[0] * np.exp(-T / p[1])
        return float(
            -student_t.logpdf((volts - curve) / 0.05, 4).sum()
            + 0.5 * np.sum(((VOLTS - 0.01 - curve) / 0.05) ** 2)
        )

    fit = fit_curves("V*exp(-x/tau)", sets)
    best = minimize(minus, [2.0, 3.0], method="Nelder-Mead", options=EXACT)
    sds = np.array([fit.sds["V"], fit.sds["tau"]])
    assert fit.status == "ok"
    assert np.abs(np.array([fit.values["V"], fit.values["tau"]]) - best.x) / sds == pytest.approx(
        0, abs=0.01
    )
    # expected information, not that of these data
    assert sds == pytest.approx(curvature_sds(minus, best.x, np.full(2, 1e-3)), rel=0.15)
    assert fit_curves("V*exp(-x/tau)", sets, robust="student-t").status == "ok"
    plain = {**sets, "bad": DataSet(T, volts, u_y=0.05)}
    assert fit_curves("V*exp(-x/tau)", plain).status == "poor-fit"


def test_jitter_beside_counts() -> None:
    counted = DataSet(T, COUNTS, noise=Poisson(), curve="N*exp(-x/tau) + B")
    start = {"V": 2.0, "tau": 3.0, "N": 400.0, "B": 10.0}
    read = DataSet(T, VOLTS, u_y=0.02, jitter=True, curve="V*exp(-x/tau)")
    fit = fit_curves(None, {"read": read, "counted": counted}, start=start)
    alone = fit_curve("V*exp(-x/tau)", T, VOLTS, u_y=0.02, jitter=True)
    assert fit.status == "ok"
    assert fit.values["jitter[read]"] == pytest.approx(alone.values["jitter"], rel=0.1)
    assert fit.sds["tau"] < alone.sds["tau"]
    with pytest.raises(InputError, match="'jitter' of data set 'counted'"):
        fit_curves(None, {"read": read, "counted": counted}, start=start, jitter=True)


def test_errors_of_x_in_common_by_true_values_as_parameters() -> None:
    """Beside least squares over the true voltages; here one meter serves both instruments."""
    k, read = np.arange(20), U + 0.2 * np.random.default_rng(3).standard_normal(20)

    def voltage(k: Any, **true: Any) -> Any:
        return sum(value * (k == i) for i, value in enumerate(true.values()))

    def warm(k: Any, p2: Any, p1: Any, p0: Any, **true: Any) -> Any:
        return temperature(voltage(k, **true), p2, p1, p0)

    def flow(k: Any, r0: Any, alpha: Any, p2: Any, p1: Any, p0: Any, **true: Any) -> Any:
        return current(voltage(k, **true), r0, alpha, p2, p1, p0)

    fit = fit_curves(
        None,
        {
            "U": DataSet(k, read, u_y=0.2, curve=voltage),
            "T": DataSet(k, HOT, u_y=0.5, curve=warm),
            "I": DataSet(k, FLOWS, u_y=0.1, curve=flow),
        },
        start={**TRUE, **{f"U{i}": u for i, u in enumerate(read)}},
        scan=False,
    )

    def residuals(p: np.ndarray) -> np.ndarray:
        hot = p[0] * p[5:] ** 2 + p[1] * p[5:] + p[2]
        flows = p[5:] / (p[3] * (1 + p[4] * hot))
        return np.concatenate([(HOT - hot) / 0.5, (FLOWS - flows) / 0.1, (read - p[5:]) / 0.2])

    best = least_squares(
        residuals, [*TRUE.values(), *read], x_scale="jac", xtol=1e-15, ftol=1e-15, gtol=1e-15
    )
    sds = np.sqrt(np.diag(np.linalg.inv(best.jac.T @ best.jac)))[:5]
    assert fit.status == "ok"
    assert fit.dof == 35
    assert fit.chi2 == pytest.approx(2.0 * best.cost, rel=1e-5)
    assert np.abs([fit.values[name] for name in TRUE] - best.x[:5]) / sds == pytest.approx(
        0, abs=0.01
    )
    assert [fit.sds[name] for name in TRUE] == pytest.approx(sds, rel=0.01)


# --- words


def test_what_follows_from_several_sets() -> None:
    fit = fit_curves(
        None,
        WIRE,
        shared=["p2", "p1"],
        fixed={"alpha": 0.0038},
        derived={"warm": "p0 - 20", "ratio": "p0[heat]/p0[flow]", "next": "ratio/2"},
    )
    assert fit.derived["ratio"].value == pytest.approx(
        fit.values["p0[heat]"] / fit.values["p0[flow]"]
    )
    assert {"warm[heat]", "warm[flow]", "ratio"} < set(fit.derived)
    apart = fit_curves(
        None,
        {
            "a": DataSet(U, 2.0 * U + NOISE_I, u_y=0.1, curve="a*x"),
            "b": DataSet(U, 3.0 * U + NOISE_I, u_y=0.1, curve="b*x"),
        },
        derived={"ratio": "a/b"},
    )
    a, b = apart.values["a"], apart.values["b"]
    assert apart.derived["ratio"].value == pytest.approx(a / b)
    assert apart.derived["ratio"].sd == pytest.approx(
        a / b * np.hypot(apart.sds["a"] / a, apart.sds["b"] / b), rel=1e-3
    )


def test_every_set_has_its_axes_and_what_is_shared_one_unit() -> None:
    volt, kelvin = AxisNames("U", "V", "I", "A"), AxisNames("U", "V", "T", "K")
    axes = {
        "heat": DataSet(U, HOT, u_y=0.5, curve=HEAT, axes=kelvin),
        "flow": DataSet(U, FLOWS, u_y=0.1, curve=OHM, axes=volt),
    }
    fit = fit_curves(None, axes)
    units = {p.name: p.unit for p in fit.problem.parameters}
    assert (units["p2"], units["p0"]) == ("K/V²", "K")
    assert [run.y_label for run in fit.problem.runs] == ["T (K)", "I (A)"]
    lines = {
        "s": DataSet(U, U, u_y=0.5, curve="a*x", axes=AxisNames("t", "s", "s", "m")),
        "v": DataSet(U, U, u_y=0.5, curve="a + b*x", axes=AxisNames("t", "s", "s", "m")),
    }
    with pytest.raises(InputError, match="'a' is shared, but in m/s for one data set and in m"):
        fit_curves(None, lines)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"data": {"heat": DataSet(U, HOT, u_y=0.5, curve="")}}, "'curve' of data set 'heat' must"),
        ({"data": {"heat": DataSet(U, HOT, u_y=0.5)}}, "'data\\[heat\\].curve' is missing: give"),
        ({"start": {"q": 1.0}}, "'start' of data set 'heat' names 'q', which is not in the form"),
        ({"priors": {"p9": "1.0(1)"}}, "names 'p9', which is not a parameter"),
        ({"shared": ["q"]}, "'shared' names 'q', which is not a fitted parameter"),
        ({"derived": {"g": "q + r0"}}, "'g' of data set 'flow' names 'q', which is neither"),
        ({"derived": {"g": "r0[cold]"}}, r"'g' names 'r0\[cold\]', which no data set has"),
        ({"tied": 1.0}, "'tied' must be a mapping"),
        ({"start": [1.0]}, "'start' must be a mapping"),
        ({"priors": {"r0[flow]": "1.0(1)"}}, "refers to one data set, but 'r0' is shared by all"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(change: dict[str, Any], said: str) -> None:
    arguments: dict[str, Any] = {"data": WIRE} | change
    with pytest.raises(InputError, match=said):
        fit_curves(None, **arguments)


def test_a_phase_turns_beside_a_curve_that_has_none() -> None:
    """Were its turn not seen, a phase of 2 pi more would be as good, and nothing would hold it."""
    x = np.linspace(0.0, 6.0, 20)
    for seed in range(3):
        rng = np.random.default_rng(seed)
        swing = np.cos(2.0 * np.pi * 0.6 * x + 0.4) + 0.2 + 0.4 * rng.standard_normal(20)
        line = 1.0 + 2.0 * x + 0.1 * rng.standard_normal(20)
        data = {
            "swing": DataSet(x, swing, 0.4, curve="A*cos(2*pi*f*x + p) + c"),
            "line": DataSet(x, line, 0.1, curve="s*x + d"),
        }
        fit = fit_curves(None, data)
        assert fit.status == "ok"
        alone = fit_curve("A*cos(2*pi*f*x + p) + c", x, swing, u_y=0.4)
        assert fit.values["p"] == pytest.approx(alone.values["p"], abs=1e-3)
