"""Joint priors of several parameters: normal equations and a dense grid, which share no code with
the fit, and a fit by kafe2.
"""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats
from scipy.optimize import lsq_linear
from uncertainties import correlated_values, ufloat

from estim import DataSet, InputError, fit_curve, fit_curves
from estim.checks import check_stated_values
from estim.common import Kind
from estim.fitting import fit_least_squares, profile_intervals
from estim.pipeline import sample_curve

Array = NDArray[np.float64]

MEANS = np.array([1.25, 3.3])
COV = np.array([[0.010, -0.012], [-0.012, 0.020]])
X = np.linspace(0.0, 5.0, 12)
Y = 1.2 * X + 3.4 + 0.3 * np.random.default_rng(1).standard_normal(12)
ROWS = np.column_stack([X, np.ones(12)]) / 0.3


def _solved(rows: Array, z: Array, means: Array, cov: Array) -> tuple[Array, Array]:
    """Posterior mean and covariance of a linear model with a normal prior."""
    inverse = np.linalg.inv(rows.T @ rows + np.linalg.inv(cov))
    return inverse @ (rows.T @ z + np.linalg.solve(cov, means)), inverse


def _line(priors: Any, **said: Any) -> Any:
    return fit_curve("a*x + b", X, Y, u_y=0.3, priors=priors, **said)


@pytest.mark.parametrize(
    "priors",
    [
        {("a", "b"): (MEANS, COV)},
        {("b", "a"): (MEANS[::-1].tolist(), COV[::-1, ::-1].tolist())},
        {("a", "b"): stats.multivariate_normal(MEANS, COV)},
        dict(zip("ab", correlated_values(MEANS, COV), strict=True)),
    ],
    ids=["covariance", "other-order", "scipy", "ufloats"],
)
def test_a_joint_prior_is_that_of_the_normal_equations(priors: Any) -> None:
    expected, cov = _solved(ROWS, Y / 0.3, MEANS, COV)
    fit = _line(priors)
    assert fit.names == ("a", "b")
    assert [*fit.values.values()] == pytest.approx(expected, rel=1e-9)
    assert fit.cov == pytest.approx(cov, rel=1e-9)
    off, apart = (Y - ROWS @ expected * 0.3) / 0.3, expected - MEANS
    # it counts as two stated values: n + 2 - 2 degrees of freedom
    assert (fit.chi2, fit.dof) == (
        pytest.approx(off @ off + apart @ np.linalg.solve(COV, apart), rel=1e-9),
        12,
    )
    alone = _line(
        {"a": "1.25(10)", "b": ufloat(3.3, np.sqrt(0.02))}
    )  # what a lost correlation gives
    assert abs(alone.sds["a"] / fit.sds["a"] - 1.0) > 0.05


def test_ufloats_of_a_fit_carry_its_correlations_into_the_next() -> None:
    """Two halves of the points, one after the other, say what all of them do; an independent ufloat
    stays one.
    """
    half = fit_curve("a*x + b", X[::2], Y[::2], u_y=0.3)
    both = fit_curve("a*x + b", X[1::2], Y[1::2], u_y=0.3, priors=half.ufloats())
    whole = _line({})
    assert both.values == pytest.approx(whole.values, rel=1e-9)
    assert both.cov == pytest.approx(whole.cov, rel=1e-9)
    three = {**half.ufloats(), "c": ufloat(0.0, 0.1)}
    fit = fit_curve("a*x + b + c*x**2", X[1::2], Y[1::2], u_y=0.3, priors=three)
    assert [p.prior.describe() for p in fit.problem.parameters][2] == "normal"


@pytest.mark.parametrize("r", [0.7, -0.999, 0.9999999])
def test_profiles_of_a_line_are_exact_however_strong_the_correlation(r: float) -> None:
    cov = np.array([[1.0, r], [r, 1.0]]) * np.outer([0.5, 3.0], [0.5, 3.0])
    expected, spread = _solved(ROWS, Y / 0.3, MEANS, cov)
    for i, found in enumerate(profile_intervals(_line({("a", "b"): (MEANS, cov)}).fit)):
        sd = np.sqrt(spread[i, i])
        for p, end in found.high.items():
            half = stats.norm.ppf(0.5 + 0.5 * p) * sd
            assert end - expected[i] == pytest.approx(half, rel=1e-6)
            assert expected[i] - found.low[p] == pytest.approx(half, rel=1e-6)


def test_a_diagonal_matrix_says_what_independent_priors_say() -> None:
    sds = np.array([0.05, 0.2])
    joint = _line({("a", "b"): (MEANS, np.diag(sds**2))})
    alone = _line({"a": stats.norm(MEANS[0], sds[0]), "b": stats.norm(MEANS[1], sds[1])})
    assert joint.values == pytest.approx(alone.values, rel=1e-9)
    assert joint.cov == pytest.approx(alone.cov, rel=1e-9)
    assert (joint.chi2, joint.p_value) == pytest.approx((alone.chi2, alone.p_value), rel=1e-9)
    one, other = check_stated_values(joint.fit), check_stated_values(alone.fit)
    assert (one.chi2, one.dof) == (pytest.approx(other.chi2, rel=1e-9), other.dof)
    assert one.pulls == pytest.approx(other.pulls, rel=1e-9)


def test_the_size_of_the_errors_may_be_unknown() -> None:
    """Without u_y it is that of the residuals, over n - (parameters without a prior)."""
    fit = fit_curve("a*x + b", X, Y, priors={("a", "b"): (MEANS, COV)})
    rows = ROWS * 0.3 / fit.sigma
    expected, cov = _solved(rows, Y / fit.sigma, MEANS, COV)
    assert [*fit.values.values()] == pytest.approx(expected, rel=1e-7)
    assert fit.cov == pytest.approx(cov, rel=1e-6)
    assert fit.sigma == pytest.approx(np.sqrt(np.sum((Y - rows @ expected * fit.sigma) ** 2) / 12))


@pytest.mark.parametrize(
    "said",
    [
        {"noise": "poisson"},
        {"u_y": 2.0, "jitter": True},
        {"u_y": 2.0, "robust": "mixture"},
        {"u_y": 2.0, "deviation": 3.0},
        {"u_y": 2.0, "u_x": 0.1},
        {"u_y": "20%"},
    ],
    ids=lambda said: "-".join(said),
)
def test_every_kind_of_errors_takes_it_as_independent_parameters_do(said: dict[str, Any]) -> None:
    """With p = means + L z and the z independent of variance 1."""
    root = np.linalg.cholesky(COV)
    a = f"({MEANS[0]} + {root[0, 0]}*z1)"
    b = f"({MEANS[1]} + {root[1, 0]}*z1 + {root[1, 1]}*z2)"
    counts = np.random.default_rng(5).poisson(3.0 * (1.2 * X + 3.4)).astype(float)
    alone = fit_curve(f"3*({a}*x + {b})", X, counts, priors={"z1": "0(1)", "z2": "0(1)"}, **said)
    fit = fit_curve("3*(a*x + b)", X, counts, priors={("a", "b"): (MEANS, COV)}, **said)
    ours, theirs = (
        [one.names.index(name) for name in names]
        for one, names in ((fit, "ab"), (alone, ("z1", "z2")))
    )
    expected = MEANS + root @ [alone.values["z1"], alone.values["z2"]]
    assert [fit.values[name] for name in "ab"] == pytest.approx(expected, rel=1e-7)
    cov = root @ alone.fit.cov[np.ix_(theirs, theirs)] @ root.T
    assert fit.fit.cov[np.ix_(ours, ours)] == pytest.approx(cov, rel=1e-5)
    if "robust" not in said:  # there profiles of single parameters widen it
        cov = root @ alone.cov[np.ix_(theirs, theirs)] @ root.T
        assert fit.cov[np.ix_(ours, ours)] == pytest.approx(cov, rel=1e-5)
    assert (fit.chi2, fit.dof) == (pytest.approx(alone.chi2, rel=1e-7), alone.dof)
    of_fit, of_alone = check_stated_values(fit.fit), check_stated_values(alone.fit)
    assert (of_fit.chi2, of_fit.dof) == (pytest.approx(of_alone.chi2, rel=1e-5), of_alone.dof)


def test_mode_profiles_and_draws_of_a_curve_are_those_of_a_grid() -> None:
    rng = np.random.default_rng(3)
    x = np.linspace(0.0, 4.0, 15)
    y = 2.0 * np.exp(-x / 1.3) + 0.1 * rng.standard_normal(15)
    means, cov = np.array([2.2, 1.1]), np.array([[0.04, 0.035], [0.035, 0.04]])
    priors = {("a", "tau"): (means, cov)}
    fit = fit_curve("a*exp(-x/tau)", x, y, u_y=0.1, start={"a": 1.0, "tau": 1.0}, priors=priors)
    a, tau = np.meshgrid(np.linspace(1.6, 2.6, 401), np.linspace(0.8, 1.7, 401), indexing="ij")
    off = np.stack([a - means[0], tau - means[1]], axis=-1)
    rises = np.sum((y - a[..., None] * np.exp(-x / tau[..., None])) ** 2, axis=-1) / 0.01
    rises += np.einsum("...i,ij,...j", off, np.linalg.inv(cov), off)
    assert fit.chi2 == pytest.approx(rises.min(), abs=1e-3)
    rises -= fit.chi2
    for i, found in enumerate(profile_intervals(fit.fit)):
        along, grid = rises.min(axis=1 - i), (a[:, 0], tau[0])[i]
        best = int(np.argmin(along))
        rise = stats.chi2.ppf(0.95, 1)
        ends = (
            np.interp(rise, along[: best + 1][::-1], grid[: best + 1][::-1]),
            np.interp(rise, along[best:], grid[best:]),
        )
        assert (found.low[0.95], found.high[0.95]) == pytest.approx(ends, abs=2e-4)
    weight = np.exp(-0.5 * rises)
    weight /= weight.sum()
    mean = np.array([np.sum(weight * a), np.sum(weight * tau)])
    centred = np.stack([a - mean[0], tau - mean[1]], axis=-1)
    spread = np.einsum("kl,kli,klj->ij", weight, centred, centred)
    draws = sample_curve(fit, seed=1).chain.draws.reshape(-1, 2)
    sds = np.sqrt(np.diag(spread))
    assert np.all(np.abs(draws.mean(axis=0) - mean) < 0.1 * sds)
    assert np.cov(draws.T) / np.outer(sds, sds) == pytest.approx(
        spread / np.outer(sds, sds), abs=0.1
    )
    # a density without the correlation is far from that
    wrong = weight * np.exp(
        0.5 * np.einsum("...i,ij,...j", off, np.linalg.inv(cov), off)
        - 0.5 * np.sum(off**2 / np.diag(cov), axis=-1)
    )
    wrong /= wrong.sum()
    assert abs(np.sum(wrong * a) - mean[0]) > 0.2 * sds[0]


def test_density_gradient_and_information_are_those_of_the_law() -> None:
    """Of three parameters of which two have a joint prior, and one has one of its own."""
    priors = {("c", "a"): ([0.5, 1.25], [[0.04, 0.015], [0.015, 0.01]]), "b": "3.3(2)"}
    problem = fit_curve("a*x + b + c*x**2", X, Y, u_y=0.3, priors=priors).problem
    cov = np.array([[0.01, 0.0, 0.015], [0.0, 0.04, 0.0], [0.015, 0.0, 0.04]])
    law = stats.multivariate_normal([1.25, 3.3, 0.5], cov)
    assert problem.names == ("a", "b", "c")
    draws = law.rvs(7, random_state=np.random.default_rng(2))
    assert problem.log_prior(draws) == pytest.approx(law.logpdf(draws), rel=1e-9)
    assert problem.prior_information(draws[0]) == pytest.approx(np.linalg.inv(cov), abs=1e-9)
    expected = (draws - law.mean) @ np.linalg.inv(cov)
    assert problem.prior_gradient(draws) == pytest.approx(expected, rel=1e-9)
    residuals = problem.prior_residuals(draws)
    assert np.sum(residuals**2, axis=1) == pytest.approx(np.sum(expected * (draws - law.mean), 1))
    again = pickle.loads(pickle.dumps(problem))  # as it goes to another process
    assert np.array_equal(again.log_prior(draws), problem.log_prior(draws))
    # where one is held, what remains is the marginal law
    held = problem.with_priors({"c": problem.parameters[1].prior})
    assert held.log_prior(draws) == pytest.approx(
        stats.norm(1.25, 0.1).logpdf(draws[:, 0])
        + stats.norm(3.3, 0.2).logpdf(draws[:, 1:]).sum(axis=1)
    )


@pytest.mark.parametrize("shift", [0.0, 1.0])
def test_a_conflict_with_the_data_is_that_of_leaving_out(shift: float) -> None:
    """The whole as the distance of both measurements; the pull of each stated value as what chi^2
    falls by without it, the other one keeping what it says alone.
    """
    means = MEANS + shift * np.array([0.4, 0.2])
    fit = _line({("a", "b"): (means, COV)})
    conflict = check_stated_values(fit.fit)
    data = np.linalg.inv(ROWS.T @ ROWS)
    off = data @ ROWS.T @ Y / 0.3 - means
    assert (conflict.chi2, conflict.dof) == (
        pytest.approx(off @ np.linalg.solve(COV + data, off), rel=1e-6),
        2,
    )
    for i in range(2):
        one = off[1 - i] ** 2 / (COV + data)[1 - i, 1 - i]
        assert conflict.pulls["ab"[i]] ** 2 == pytest.approx(conflict.chi2 - one, rel=1e-6)
    kinds = [finding.kind for finding in fit.findings]
    assert (Kind.STATED_DISAGREE in kinds) == bool(shift)


def test_a_conflict_beside_an_edge_is_that_of_leaving_out_within_it() -> None:
    """Without the one stated value the free parameter would go beyond its limit."""
    bent = Y - 0.05 * X**2
    means = MEANS + np.array([-0.3, 0.3])
    fit = fit_curve(
        "a*x + b + c*x**2",
        X,
        bent,
        u_y=0.3,
        bounds={"c": (-0.02, None)},
        priors={("a", "b"): (means, COV)},
    )
    rows = np.column_stack([ROWS, X**2 / 0.3])
    low = np.array([-np.inf, -np.inf, -0.02])

    def least(prior: Array, aim: Array) -> float:
        both, z = np.vstack([rows, prior]), np.append(bent / 0.3, aim)
        return 2.0 * float(lsq_linear(both, z, (low, np.full(3, np.inf)), tol=1e-14).cost)

    root = np.linalg.inv(np.linalg.cholesky(COV))
    whole = least(np.column_stack([root, np.zeros(2)]), root @ means)
    pulls = check_stated_values(fit.fit).pulls
    assert fit.chi2 == pytest.approx(whole, rel=1e-9)
    for i in range(2):
        sd = np.sqrt(COV[1 - i, 1 - i])
        without = least(np.eye(1, 3, 1 - i) / sd, means[1 - i : 2 - i] / sd)
        assert pulls["ab"[i]] ** 2 == pytest.approx(whole - without, rel=1e-5)


def test_values_are_those_of_kafe2() -> None:
    """kafe2 2.11.0, examples/011_multifit/01_fit_with_parameter_constraints.py: a matrix constraint
    by the result of another fit, here with its errors of y alone.  Its minimum is shallow to 1e-6
    of chi^2; its standard deviations are from the second derivatives, ours from the first.
    """
    u = np.arange(0.5, 10.01, 0.5)
    current = [0.50, 0.89, 1.41, 1.67, 2.30, 2.59, 2.77, 3.57, 3.94, 4.24]
    current += [4.73, 4.87, 5.35, 5.74, 5.77, 6.17, 6.32, 6.83, 6.87, 7.17]
    kelvin = [293.5, 293.8, 295.4, 296.8, 299.4, 301.0, 303.0, 307.4, 310.9, 315.1]
    kelvin += [318.0, 323.2, 327.4, 333.7, 338.2, 343.1, 350.0, 354.7, 358.6, 367.9]
    before = fit_curve("p2*x**2 + p1*x + p0", u, np.array(kelvin) - 273.15, u_y=0.5)
    fit = fit_curve(
        "x/(R0*(1 + alpha*(p2*x**2 + p1*x + p0)))",
        u,
        current,
        u_y=0.1,
        start={"R0": 1.0, "alpha": 0.004, "p2": 1.0, "p1": 1.0, "p0": 1.0},
        priors={before.names: ([*before.values.values()], before.cov)},
    )
    assert [*fit.values] == ["R0", "alpha", "p2", "p1", "p0"]
    theirs = [1.0136100, 3.987781e-3, 0.5975858, 1.644591, 18.332450]
    sds = np.array([1.985902e-2, 3.692327e-4, 1.507802e-2, 0.1629909, 0.3717079])
    assert np.all(np.abs(np.array([*fit.values.values()]) - theirs) < 1e-3 * sds)
    assert [*fit.sds.values()] == pytest.approx(sds, rel=0.01)
    assert (fit.chi2, fit.dof) == (pytest.approx(24.134229, abs=2e-6), 18)
    two = {name: ufloat(fit.values[name], before.sds[name]) for name in before.names}
    lost = fit_curve(fit.text, u, current, u_y=0.1, start=fit.values, priors=two)
    assert lost.sds["alpha"] != pytest.approx(sds[1], rel=0.03)


def test_data_sets_share_a_joint_prior_across_their_curves() -> None:
    """Also where each of its parameters is one of another curve, and where it speaks of one data
    set.
    """
    t = np.linspace(1.0, 3.0, 6)
    data = {
        "first": DataSet(X, Y, u_y=0.3, curve="a*x + d"),
        "second": DataSet(t, 3.3 * t, u_y=0.1, curve="b*x"),
    }
    fit = fit_curves(None, data, priors={("a", "b"): (MEANS, COV)})
    rows = np.zeros((18, 3))
    rows[:12, 0], rows[:12, 1], rows[12:, 2] = X / 0.3, 1 / 0.3, t / 0.1
    z = np.append(Y / 0.3, 33.0 * t)
    information = rows.T @ rows
    information[np.ix_([0, 2], [0, 2])] += np.linalg.inv(COV)
    aim = rows.T @ z
    aim[[0, 2]] += np.linalg.solve(COV, MEANS)
    assert [fit.values[name] for name in "adb"] == pytest.approx(np.linalg.solve(information, aim))
    order = [fit.names.index(name) for name in "adb"]
    assert fit.cov[np.ix_(order, order)] == pytest.approx(np.linalg.inv(information), rel=1e-6)

    both = {"first": DataSet(X, Y, u_y=0.3), "second": DataSet(X, Y + 0.5, u_y=0.3)}
    of_one = {("a[second]", "b[second]"): (MEANS, COV)}
    single = fit_curves("a*x + b", both, shared=[], priors=of_one)
    expected, _ = _solved(ROWS, (Y + 0.5) / 0.3, MEANS, COV)
    found = [single.values[f"{name}[second]"] for name in "ab"]
    assert found == pytest.approx(expected, rel=1e-7)
    assert single.values["a[first]"] == pytest.approx(fit_curve("a*x + b", X, Y).values["a"])
    with pytest.raises(InputError, match=r"'priors' are joint for 'a'.*'a\[\.\.\.\]'"):
        fit_curves("a*x + b", both, shared=["b"], priors={("a", "b"): (MEANS, COV)})


def test_of_many_data_sets_too() -> None:
    """More than settle together: run by run."""
    rng = np.random.default_rng(4)
    zeros = 0.2 * rng.standard_normal(18)
    x = np.array([0.0, 1.0, 2.0])
    seen = {
        f"r{k}": (x, 1.2 * x + 0.3 * x**2 + zero + 0.1 * rng.standard_normal(3))
        for k, zero in enumerate(zeros)
    }
    means, cov = np.array([1.0, 0.4]), np.array([[0.01, -0.009], [-0.009, 0.01]])
    fit = fit_curves(
        "z + a*x + b*x**2",
        {name: DataSet(*points, u_y=0.1) for name, points in seen.items()},
        shared=["a", "b"],
        priors={("a", "b"): (means, cov)},
    )
    rows = np.zeros((54, 20))
    for k in range(18):
        rows[3 * k : 3 * k + 3, [0, 1, 2 + k]] = np.column_stack([x, x**2, np.ones(3)]) / 0.1
    information, aim = rows.T @ rows, rows.T @ np.concatenate([y for _, y in seen.values()]) / 0.1
    information[:2, :2] += np.linalg.inv(cov)
    aim[:2] += np.linalg.solve(cov, means)
    spread = np.linalg.inv(information)
    for problem_fit in (fit.fit, fit_least_squares(fit.problem, rng=rng, n_start=1)):
        values = dict(zip(problem_fit.names, problem_fit.values, strict=True))
        assert [values[name] for name in "ab"] == pytest.approx((spread @ aim)[:2], rel=1e-6)
        at = [problem_fit.names.index(name) for name in "ab"]
        assert problem_fit.cov[np.ix_(at, at)] == pytest.approx(spread[:2, :2], rel=1e-6)


@pytest.mark.parametrize(
    ("priors", "words"),
    [
        ({("a", "b"): (MEANS, [[1.0, 1.0], [1.0, 1.0]])}, r"\[a, b\]' must be positive definite"),
        ({("a", "b"): (MEANS, [[1.0, 0.2], [0.1, 1.0]])}, r"\[a, b\]' must be symmetric"),
        ({("a", "b"): (MEANS, np.eye(3))}, r"must have the shape \(2, 2\)"),
        ({("a", "b"): (MEANS, 0.1)}, r"must have the shape \(2, 2\)"),
        ({("a", "b"): ([1.0, 2.0, 3.0], COV)}, "must have as many means as names: 3"),
        ({("a", "b"): ([1.0, np.nan], COV)}, "must be finite"),
        ({("a", "b"): "1.0(2)"}, r"must be \(means, cov\) of these"),
        ({("a", "b"): None}, r"must be \(means, cov\) of these"),
        ({("a", "b"): (MEANS, COV), "a": "1.0(1)"}, "states 'a' again"),
        ({("a", "a"): (MEANS, COV)}, "states 'a' again"),
        ({("a", "c"): (MEANS, COV)}, "'c', which is not a parameter"),
        ({("a", 3): (MEANS, COV)}, "'3', which is not a parameter"),
    ],
)
def test_a_joint_prior_that_is_none_is_refused_in_a_line(priors: Any, words: str) -> None:
    with pytest.raises(InputError, match=words) as told:
        _line(priors)
    assert "\n" not in str(told.value)


def test_a_joint_prior_of_a_parameter_that_is_held_or_bounded_is_refused() -> None:
    priors = {("a", "b"): (MEANS, COV)}
    with pytest.raises(InputError, match="'b', which is fixed"):
        _line(priors, fixed={"b": 3.3}, start={"a": 1.0})
    with pytest.raises(InputError, match="cannot be combined with a prior for 'b'"):
        _line(priors, bounds={"b": (0.0, None)})
