"""A deviation that is summed over: its likelihood by dense matrices, what is stated and kept, and
deviations of a user's own curve.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from scipy.special import softmax

from estim.common.errors import InputError
from estim.discrepancy import mixture_likelihood
from estim.discrepancy.curve_covariances import (
    correlated_shapes,
    deviation_shapes,
    equally_probable,
    relative_grid,
    stated_is_conservative,
)
from estim.discrepancy.force import force_kernel, speed_response, track
from estim.discrepancy.grid import prior_grid, track_lengths
from estim.discrepancy.kernels import (
    distances,
    exponential,
    matern32,
    root,
    sd_of_mean,
    turning,
    without_mean,
)
from estim.discrepancy.linearised import linearise, mixture_quantiles
from estim.discrepancy.mixture_likelihood import keep_probable
from estim.discrepancy.scale_mixture import Shape, diagonalise
from estim.problem.roots import covariance_of, root_of

SMALL = prior_grid(0.7, scales=(0.8, 1.0, 1.4), n_amplitude=5)


def _whole(mixture, residuals):
    """(n_obs, n_obs) the precision in the unit of the observations."""
    back = mixture.deviation.turned_back
    return back(back(mixture.pulls(np.eye(residuals.size), residuals)).T)


def two_shapes(n: int) -> tuple[Shape, ...]:
    x = np.linspace(0.0, 10.0, n)
    return tuple(
        Shape("deviation", length, root(matern32(distances(x), length)), np.log(0.5))
        for length in (1.0, 4.0)
    )


def correlated(n: int, rng: np.random.Generator) -> np.ndarray:
    root = np.eye(n) + 0.3 * rng.standard_normal((n, n)) / np.sqrt(n)
    return 0.04 * root @ root.T


def innovations(found):
    """What the most probable component leaves, white where it is right, in order."""
    left = found.residuals - found.jacobian @ found.steps[found.best]
    return found.best_root().whiten(left)


def dense(deviation, base, shapes):
    """Log prior and covariance of each component, from their definition."""
    covariance = {shape.length: shape.covariance for shape in shapes}
    for family in deviation.families:
        for a, s, log_prior in zip(family.amplitude, family.scale, family.log_prior, strict=True):
            yield log_prior, s**2 * base + a**2 * covariance[family.length]


def dense_parts(deviation, base, shapes, residuals, extra=0.0):
    return [
        w + stats.multivariate_normal(cov=c + extra).logpdf(residuals)
        for w, c in dense(deviation, base, shapes)
    ]


def dense_likelihood(*args):
    return np.logaddexp.reduce(dense_parts(*args), axis=0)


@pytest.mark.parametrize("diagonal", [True, False])
def test_what_is_asked_at_a_point_is_that_of_dense_matrices(rng, diagonal):
    n = 8
    shapes, variances = two_shapes(n), 0.04 * rng.uniform(0.5, 2.0, n)
    base = np.diag(variances) if diagonal else correlated(n, rng)
    residuals, columns = 0.4 * rng.standard_normal((3, n)), 0.2 * rng.standard_normal((n, 2))
    residuals[2] *= 300.0  # so far away that only logarithms know it
    found = linearise(
        diagonalise(root_of(variances if diagonal else base), shapes, SMALL),
        residuals[0],
        np.ones((n, 1)),
        precision=np.eye(1),
    )
    for extra in (np.zeros((n, 0)), columns):
        mixture = keep_probable(found, columns=extra, neglected=0.0)
        parts = [(w, c + extra @ extra.T) for w, c in dense(found.deviation, base, shapes)]
        truth = np.empty((3, n))
        for i in range(n):
            rest = np.delete(np.arange(n), i)
            less = [
                w + stats.multivariate_normal(cov=c[np.ix_(rest, rest)]).logpdf(residuals[:, rest])
                for w, c in parts
            ]
            truth[:, i] = mixture.log_likelihood(residuals) - np.logaddexp.reduce(less, axis=0)
        np.testing.assert_allclose(mixture.pointwise(residuals), truth, rtol=1e-8, atol=1e-5)
        logs = np.array(
            [w + stats.multivariate_normal(cov=c).logpdf(residuals[0]) for w, c in parts]
        )
        share = np.exp(logs - np.logaddexp.reduce(logs))
        together = covariance_of(mixture.likely(residuals[0]))
        np.testing.assert_allclose(
            together, np.einsum("k,kij->ij", share, [c for _, c in parts]), rtol=1e-5, atol=1e-9
        )
        precision = np.einsum("k,kij->ij", share, [np.linalg.inv(c) for _, c in parts])
        np.testing.assert_allclose(_whole(mixture, residuals[0]), precision, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("few", [True, False])
@pytest.mark.parametrize("diagonal", [True, False])
def test_the_likelihood_of_draws_is_that_of_dense_matrices(rng, diagonal, few):
    n = 14
    shapes = (
        tuple(replace(shape, factor=shape.factor[:, -5:]) for shape in two_shapes(n))
        if few
        else two_shapes(n)
    )
    variances = 0.04 * rng.uniform(0.5, 2.0, n)
    base = np.diag(variances) if diagonal else correlated(n, rng)
    deviation = diagonalise(root_of(variances if diagonal else base), shapes, SMALL)
    residuals = rng.standard_normal((7, n)) * 0.4
    jacobian = np.vander(np.linspace(-1.0, 1.0, n), 2)
    found = linearise(deviation, residuals[0], jacobian, precision=np.eye(2))
    everything = keep_probable(found, neglected=0.0)
    truth = dense_likelihood(found.deviation, base, shapes, residuals)
    np.testing.assert_allclose(everything.log_likelihood(residuals), truth, atol=1e-6)

    columns = 0.3 * jacobian
    tilted = keep_probable(found, columns=columns, neglected=0.0)
    truth = dense_likelihood(found.deviation, base, shapes, residuals, columns @ columns.T)
    np.testing.assert_allclose(tilted.log_likelihood(residuals), truth, atol=1e-6)


def test_the_precision_is_the_slope_of_the_likelihood(rng):
    n = 9
    deviation = diagonalise(root_of(correlated(n, rng)), two_shapes(n), SMALL)
    r = rng.standard_normal(n) * 0.5
    columns = rng.standard_normal((n, 1)) * 0.2
    mixture = keep_probable(
        linearise(deviation, r, np.ones((n, 1)), precision=np.eye(1)), columns=columns
    )
    step = 1e-5 * np.eye(n)
    slope = (mixture.log_likelihood(r + step) - mixture.log_likelihood(r - step)) / 2e-5
    np.testing.assert_allclose(-_whole(mixture, r) @ r, slope, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(mixture.pull(r), _whole(mixture, r) @ r, rtol=1e-9, atol=1e-11)


def test_what_is_left_out_is_no_more_than_stated(rng):
    n = 30
    deviation = diagonalise(root_of(np.full(n, 0.04)), two_shapes(n), prior_grid(2.0))
    r = rng.standard_normal(n) * 0.2 + 0.5 * np.sin(np.linspace(0.0, 6.0, n))
    found = linearise(deviation, r, np.ones((n, 1)), precision=np.eye(1))
    whole, part = keep_probable(found, neglected=0.0), keep_probable(found, neglected=1e-3)
    assert part.deviation.column("scale").size < 0.5 * whole.deviation.column("scale").size
    shifts = found.mean + 3.0 * np.sqrt(found.covariance[0]) * np.linspace(-1.0, 1.0, 41)[:, None]
    log_prior = -0.5 * np.square(shifts[:, 0])
    density = [np.exp(m.log_likelihood(r - shifts) + log_prior) for m in (whole, part)]
    dropped = np.sort(found.weights)
    lost = dropped[np.cumsum(dropped) <= 1e-3].sum()
    assert np.sum(density[0] - density[1]) / np.sum(density[0]) == pytest.approx(lost, rel=0.05)
    assert np.all(density[1] <= density[0] * (1.0 + 1e-9))


def _moved_by(found, r, monkeypatch, *, roughness, **choices):
    """Standard deviations by which the mean of a shift moves, and its standard deviation, where not
    all components and directions are kept.
    """
    shifts = found.mean + np.sqrt(found.covariance[0]) * np.linspace(-5.0, 5.0, 401)[:, None]
    moments = []
    for kept, left in (({"neglected": 0.0}, 0.0), (choices, roughness)):
        monkeypatch.setattr("estim.discrepancy.mixture_likelihood._ROUGHNESS", left)
        logs = keep_probable(found, **kept).log_likelihood(r - shifts)
        density = np.exp(logs - np.max(logs)) * np.exp(-0.5 * np.square(shifts[:, 0]))
        mean = np.average(shifts[:, 0], weights=density)
        moments.append((mean, np.sqrt(np.average((shifts[:, 0] - mean) ** 2, weights=density))))
    exact, short = np.array(moments)
    return np.abs(short - exact) / exact[1]


@pytest.mark.parametrize("missing", [0.0, 0.1, 0.5])
def test_what_is_left_out_moves_no_result(rng, monkeypatch, missing):
    """Components and directions that are left out move a mean and a standard deviation by less than
    the Monte-Carlo error of 4000 draws; leaving out half of it all does more.
    """
    n = 60
    deviation = diagonalise(root_of(np.full(n, 0.04)), two_shapes(n), prior_grid(2.0))
    r = rng.standard_normal(n) * 0.2 + missing * np.sin(np.linspace(0.0, 6.0, n))
    found = linearise(deviation, r, np.ones((n, 1)), precision=np.eye(1))
    usual = _moved_by(found, r, monkeypatch, roughness=mixture_likelihood._ROUGHNESS)
    assert np.all(usual < 4000.0**-0.5)
    assert np.any(_moved_by(found, r, monkeypatch, roughness=1e3, neglected=0.5) > 0.03)


def test_nothing_but_noise_may_be_left(rng):
    """Where all components with a deviation are dropped the likelihood is that of white noise, in
    as many draws as one likes.
    """
    n = 6
    deviation = diagonalise(
        root_of(np.full(n, 0.04)), two_shapes(n), prior_grid(1.0, scales=(1.0,))
    )
    found = linearise(deviation, np.zeros(n), np.ones((n, 1)), precision=np.eye(1))
    left = keep_probable(found, neglected=1.0 - 0.99 * found.weights.max())
    assert left.deviation.column("scale").size == 1
    residuals = 0.2 * rng.standard_normal((700, n))
    white = np.sum(stats.norm(scale=0.2).logpdf(residuals), axis=1)
    spike = np.log(0.5)
    np.testing.assert_allclose(left.log_likelihood(residuals), spike + white, atol=1e-11)


def test_the_linearised_posterior_is_that_of_a_straight_line(rng):
    n = 12
    shapes, base = two_shapes(n), correlated(n, rng)
    deviation = diagonalise(root_of(base), shapes, SMALL)
    jacobian, precision, pull = (
        np.vander(np.linspace(-1.0, 1.0, n), 2),
        np.diag([4.0, 0.5]),
        np.array([0.1, -0.2]),
    )
    r = rng.standard_normal(n) * 0.5
    found = linearise(deviation, r, jacobian, precision=precision, pull=pull)
    parts = dense_parts(
        deviation,
        base,
        shapes,
        r - jacobian @ pull,
        jacobian @ np.linalg.inv(precision) @ jacobian.T,
    )
    np.testing.assert_allclose(found.weights, softmax(parts), rtol=1e-8)
    k = found.best
    _, covariance = list(dense(found.deviation, base, shapes))[k]
    information = jacobian.T @ np.linalg.solve(covariance, jacobian) + precision
    step = np.linalg.solve(
        information, jacobian.T @ np.linalg.solve(covariance, r) + precision @ pull
    )
    np.testing.assert_allclose(found.steps[k], step, rtol=1e-8)
    left = r - jacobian @ step
    _, covariance = list(dense(deviation, base, shapes))[k]
    np.testing.assert_allclose(covariance_of(found.best_root()), covariance, rtol=1e-9)
    assert innovations(found) @ innovations(found) == pytest.approx(
        left @ np.linalg.solve(covariance, left)
    )
    q = found.quantiles([1.0, 0.0], [0.16, 0.5, 0.84])
    assert [found.probability_below([1.0, 0.0], value) for value in q] == pytest.approx(
        [0.16, 0.5, 0.84], abs=1e-9
    )


def test_quantiles_of_a_mixture_of_one_are_those_of_the_normal_distribution():
    p = [0.025, 0.5, 0.84]
    found = mixture_quantiles(np.ones(1), np.array([[3.0, -1.0]]), np.array([[2.0, 0.5]]), p)
    np.testing.assert_allclose(
        found, stats.norm([3.0, -1.0], [2.0, 0.5]).ppf(np.array(p)[:, None]), atol=1e-9
    )


def line_with(errors: np.ndarray, stated: float, shapes: tuple[Shape, ...], scale: float):
    """A straight line through errors (n,) whose standard deviation was stated, and the same with
    white errors of that size alone.
    """
    jacobian = np.vander(np.linspace(-1.0, 1.0, errors.size), 2)
    deviation = diagonalise(root_of(np.full(errors.size, stated**2)), shapes, prior_grid(scale))
    found = linearise(deviation, errors, jacobian, precision=np.zeros((2, 2)))
    return found, stated**2 * np.linalg.inv(jacobian.T @ jacobian)


def test_a_stated_error_is_never_narrowed(rng):
    for errors in (0.1 * rng.standard_normal(40), 0.1 * np.sin(np.linspace(0.0, 20.0, 40))):
        found, white = line_with(errors, 1.0, two_shapes(40), 2.0)
        assert np.linalg.eigvalsh(found.covariance - white).min() > -1e-9
        assert found.size("scale")[1] < 0.3
        assert stated_is_conservative(found)
    # residuals that are merely small show no deviation
    found, _ = line_with(0.1 * rng.standard_normal(40), 1.0, two_shapes(40), 2.0)
    assert found.p_deviation < 0.5
    found, _ = line_with(rng.standard_normal(40), 1.0, two_shapes(40), 2.0)
    assert not stated_is_conservative(found)


def test_red_errors_widen_though_little_of_them_is_white(rng):
    red = np.zeros(200)
    for i in range(1, 200):
        red[i] = 0.95 * red[i - 1] + np.sqrt(1.0 - 0.95**2) * rng.standard_normal()
    t = np.arange(200) * 0.1
    found, white = line_with(red, 1.0, correlated_shapes(t), 2.0)
    assert found.p_deviation > 0.99
    assert found.size("scale")[1] < 0.6
    assert found.covariance[1, 1] > 4.0 * white[1, 1]
    assert stats.kstest(innovations(found), "norm").pvalue > 0.01


def test_kernels_are_covariances_and_a_mean_can_be_removed():
    x = np.linspace(0.0, 15.0, 120)
    apart, even = distances(x), np.full(120, 1.0 / 120)
    for kernel in (matern32(apart, 2.0), exponential(apart, 2.0), turning(apart, 2.0, radius=1.0)):
        assert np.linalg.eigvalsh(kernel).min() > -1e-9
        np.testing.assert_allclose(without_mean(kernel, even).sum(axis=0), 0.0, atol=1e-10)
    assert turning(apart, 2.0, radius=1.0)[0, 0] == 3.0
    # a unit step and a straight line: removing the mean twice changes nothing, and the mean of
    # white noise falls with n
    centred = without_mean(matern32(apart, 2.0), even)
    np.testing.assert_allclose(without_mean(centred, even), centred, atol=1e-12)
    assert sd_of_mean(np.eye(25), np.full(25, 0.04)) == pytest.approx(0.2)


def test_a_constant_of_the_material_is_less_certain_than_the_mean_over_one_track():
    """The study's factors for a track of 15 rad: .36, .60, .86 of the amplitude at lengths .9, 2.8,
    9 rad.
    """
    along = track(15.0)
    found = [sd_of_mean(force_kernel(along, length), along.weights) for length in (0.9, 2.8, 9.0)]
    np.testing.assert_allclose(found, [0.36, 0.60, 0.86], atol=0.006)


def test_lengths_follow_the_track():
    lengths, log_prior = track_lengths(15.0)
    np.testing.assert_allclose(lengths, [0.5, 0.9, 1.6, 2.8, 5.0, 9.0], rtol=0.05)
    assert lengths[np.argmax(log_prior)] == pytest.approx(2.8, rel=0.05)
    assert np.exp(log_prior).sum() == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: track(1.0, start=2.0), "end"),
        (
            lambda: speed_response(
                track(1.0), np.array([0.5]), np.array([0.0]), np.array([1.0]), acceleration=9.81
            ),
            "speed",
        ),
    ],
)
def test_what_breaks_a_rule_is_named(call, said):
    with pytest.raises(InputError, match=said):
        call()


# --- a user's own curve
# --------------------------------------------------------------------------------------------------


def test_an_error_stated_for_what_no_residual_shows_is_kept_and_called_conservative(rng):
    """A parabola, 5 cm stated, residuals of a pattern of 3.5 mm: sound, and the standard deviations
    are those stated and a little more.
    """
    x = np.linspace(0.0, 1.0, 40)
    pattern = 0.0035 * np.sin(19.0 * x) + 0.001 * rng.standard_normal(40)
    jacobian, stated = np.vander(x, 3), np.full(40, 0.05**2)
    deviation = diagonalise(
        root_of(stated),
        tuple(shape.times(0.01) for shape in deviation_shapes(x)),
        relative_grid(stated=True),
    )
    found = linearise(deviation, pattern, jacobian, precision=np.zeros((3, 3)))
    white = np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian / 0.05**2)))
    assert stated_is_conservative(found)
    sds = np.sqrt(np.diag(found.covariance))
    assert np.all(sds >= white * (1.0 - 1e-9))
    assert sds[0] < 1.25 * white[0]
    left = innovations(found)
    assert abs(left[1:] @ left[:-1]) / (left @ left) < 0.4
    assert 0.4 < left @ left / 40 < 1.6


def test_groups_of_shapes_share_the_prior(rng):
    x = np.linspace(0.0, 3.0, 15)
    both = equally_probable(deviation_shapes(x), correlated_shapes(x))
    assert np.logaddexp.reduce([shape.log_prior for shape in both]) == pytest.approx(0.0, abs=1e-12)
    deviation = diagonalise(root_of(np.ones(15)), both, relative_grid(stated=True))
    assert np.logaddexp.reduce(deviation.column("log_prior")) == pytest.approx(0.0, abs=1e-9)
    with pytest.raises(InputError, match="all the same"):
        deviation_shapes(np.ones(4))


@pytest.mark.statistics
@pytest.mark.parametrize(("size", "white_covers"), [(0.0, (0.6, 0.76)), (3.0, (0.0, 0.4))])
def test_a_smooth_deviation_of_a_parabola_is_covered(rng, size, white_covers):
    n, n_run = 30, 300
    x = np.linspace(-1.0, 1.0, n)
    jacobian = np.vander(x, 3)
    smooth = np.linalg.cholesky(np.exp(-0.5 * np.square(distances(x) / 0.3)) + 1e-9 * np.eye(n))
    deviation = diagonalise(
        root_of(np.ones(n)),
        tuple(shape.times(5.0) for shape in deviation_shapes(x)),
        relative_grid(stated=True),
    )
    inside, plain = [], []
    slope = np.array([0.0, 1.0, 0.0])
    white = np.linalg.inv(jacobian.T @ jacobian)
    for _ in range(n_run):
        errors = size * smooth @ rng.standard_normal(n) + rng.standard_normal(n)
        found = linearise(deviation, errors, jacobian, precision=np.zeros((3, 3)))
        inside.append(
            [abs(found.probability_below(slope, 0.0) - 0.5) < 0.5 * p for p in (0.68, 0.95)]
        )
        plain.append(abs((white @ jacobian.T @ errors)[1]) < np.sqrt(white[1, 1]))
    covered = np.mean(inside, axis=0)
    tolerance = 3.0 * np.sqrt(0.68 * 0.32 / n_run)
    assert 0.68 - tolerance < covered[0] < 0.88
    assert covered[1] > 0.95 - 3.0 * np.sqrt(0.95 * 0.05 / n_run)
    assert white_covers[0] < np.mean(plain) < white_covers[1]
