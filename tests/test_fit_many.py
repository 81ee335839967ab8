"""One curve fit to many data sets at once: `fit_many` against `fit_curve`, which shares only the
descent with it.  All data are synthetic.
"""

from __future__ import annotations

import numpy as np
import pytest

from estim import InputError, fit_curve, fit_many

X = np.linspace(0.0, 10.0, 30)
DECAY, START = "a*exp(-x/tau) + c", {"a": 4.0, "tau": 2.0, "c": 0.5}


def decays(n: int, *, u: float = 0.1, seed: int = 5) -> np.ndarray:
    noise = np.random.default_rng(seed).standard_normal((n, X.size))
    return 5.0 * np.exp(-X / 2.5) + 1.0 + u * noise


@pytest.mark.slow
@pytest.mark.parametrize("u_y", [0.1, None])
def test_each_fit_is_that_of_fit_curve(u_y: float | None) -> None:
    y = decays(12)
    fits = fit_many(DECAY, X, y, start=START, u_y=u_y)
    for k, row in enumerate(y):
        fit = fit_curve(DECAY, X, row, start=START, u_y=u_y)
        sds = np.array([fit.sds[name] for name in fits.names])
        values = np.array([fit.values[name] for name in fits.names])
        np.testing.assert_allclose(fits.values[k] / sds, values / sds, atol=1e-4)
        np.testing.assert_allclose(fits.sds[k], sds, rtol=1e-3)
        np.testing.assert_allclose(fits.cov[k], fit.cov, rtol=5e-3)
        if u_y is None:
            assert fits.sigma[k] == pytest.approx(fit.sigma, rel=1e-6)
            assert np.isnan(fits.p_value[k])
        else:
            assert fits.chi2[k] == pytest.approx(fit.chi2, rel=1e-6)
            assert fits.p_value[k] == pytest.approx(fit.p_value, rel=1e-4)


def test_intervals_of_many_fits_hold_the_truth_as_often_as_they_say() -> None:
    fits = fit_many(DECAY, X, decays(4000), u_y=0.1)
    truth = np.array([{"a": 5.0, "tau": 2.5, "c": 1.0}[name] for name in fits.names])
    pulls = (fits.values - truth) / fits.sds
    inside = np.mean(np.abs(pulls) < 1.0, axis=0)
    np.testing.assert_allclose(inside, 0.683, atol=4.0 * np.sqrt(0.683 * 0.317 / 4000))
    assert np.mean(fits.p_value < 0.5) == pytest.approx(0.5, abs=4.0 * np.sqrt(0.25 / 4000))
    assert np.mean(fits.status == "ok") > 0.995
    wrong = fit_many("a + b*x", X, decays(50), u_y=0.1)
    assert set(wrong.status.tolist()) == {"poor-fit"}
    assert str(wrong) == "50 fits: 50 poor-fit"


def test_what_a_set_does_not_determine_has_no_standard_deviation() -> None:
    y = 2.0 * X + 0.1 * np.random.default_rng(1).standard_normal((3, X.size))
    fits = fit_many("a*b*x", X, y, start={"a": 1.0, "b": 1.0}, u_y=0.1)
    assert set(fits.status.tolist()) == {"not-identified"}
    assert np.all(np.isnan(fits.sds))


def test_a_parameter_on_its_limit_has_no_standard_deviation() -> None:
    """Of the data sets whose decay is steeper than the limit allows; the others stay free."""
    within = {"tau": (2.5, None)}
    fits = fit_many(DECAY, X, decays(40), start=START | {"tau": 3.0}, u_y=0.1, bounds=within)
    tau = fits.names.index("tau")
    on_limit = fits.values[:, tau] < 2.5 + 1e-5
    assert 5 < np.sum(on_limit) < 35
    np.testing.assert_array_equal(np.isnan(fits.sds[:, tau]), on_limit)
    np.testing.assert_array_equal(fits.dof, np.where(on_limit, 28, 27))
    free = fit_many(DECAY, X, decays(40), start=START, u_y=0.1)
    np.testing.assert_array_equal(free.values[:, tau] < 2.5, on_limit)
    held = fit_many(DECAY, X, decays(40), start={"a": 4.0, "c": 0.5}, u_y=0.1, fixed={"tau": 2.5})
    a = fits.names.index("a")
    np.testing.assert_allclose(
        fits.values[on_limit, a], held.values[on_limit, held.names.index("a")], rtol=1e-5
    )
    np.testing.assert_allclose(
        fits.sds[on_limit, a], held.sds[on_limit, held.names.index("a")], rtol=1e-4
    )
    np.testing.assert_allclose(fits.p_value[on_limit], held.p_value[on_limit], rtol=1e-4)


def test_models_by_name_functions_and_abscissas_of_each_set() -> None:
    y = decays(4)
    formula = fit_many(DECAY, X, y, start=START, u_y=0.1)
    named = fit_many("exponential + constant", X, y, u_y=0.1)
    np.testing.assert_allclose(
        named.values[:, named.names.index("decay")],
        formula.values[:, formula.names.index("tau")],
        rtol=1e-5,
    )

    def decay(x: np.ndarray, a: float, tau: float, c: float) -> np.ndarray:
        return a * np.exp(-x / tau) + c

    called = fit_many(decay, X, y, start=START, u_y=0.1)
    np.testing.assert_allclose(called.values, formula.values, rtol=1e-5)
    shifted = X + 0.1 * np.arange(4)[:, None]
    apart = fit_many(DECAY, shifted, y, start=START, u_y=0.1)
    alone = fit_curve(DECAY, shifted[3], y[3], start=START, u_y=0.1)
    assert apart.values[3, apart.names.index("a")] == pytest.approx(alone.values["a"], rel=1e-5)


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"y": decays(2)[0]}, "y"),
        ({"x": X[:-1]}, "x"),
        ({"u_y": 0.0}, "u_y"),
        ({"u_y": [0.1, 0.2]}, "u_y"),
        ({"y": np.where(X < 1.0, np.nan, decays(2))}, "y"),
        ({"start": {"b": 1.0}}, "b"),
    ],
)
def test_what_is_wrong_is_named(changes: dict[str, object], field: str) -> None:
    arguments = {"x": X, "y": decays(2), "u_y": 0.1, "start": START, **changes}
    with pytest.raises(InputError, match=field):
        fit_many(DECAY, **arguments)


def test_a_curve_through_every_point_has_no_standard_deviation() -> None:
    fits = fit_many(DECAY, X, decays(3, u=0.0), start=START)
    np.testing.assert_allclose(np.sort(fits.values[0]), [1.0, 2.5, 5.0], rtol=1e-6)
    assert np.all(np.isnan(fits.sds))


def test_a_line_far_from_the_origin_is_refused_and_not_wrong() -> None:
    """Its intercept is tied to its slope closer than differences can tell; `fit_curve` tells it."""
    x, rng = np.linspace(0.0, 5.0, 30), np.random.default_rng(1)
    y = 2.0 + 0.3 * x + 0.1 * rng.standard_normal((2, 30))
    far = fit_many("a + b*x", x + 2459000.0, y, start={"a": 1.0, "b": 1.0}, u_y=0.1)
    assert set(far.status.tolist()) == {"not-identified"}
    near = fit_many("a + b*x", x, y, start={"a": 1.0, "b": 1.0}, u_y=0.1)
    assert set(near.status.tolist()) == {"ok"}
    alone = fit_curve("a + b*x", x + 2459000.0, y[0], u_y=0.1)
    assert near.values[0, near.names.index("b")] == pytest.approx(alone.values["b"], rel=1e-5)


def test_the_first_set_may_lie_on_a_limit_of_zero() -> None:
    """Its values said how large the steps of all sets are."""
    x = np.linspace(0.0, 5.0, 12)
    noise = 0.1 * np.random.default_rng(2).standard_normal((20, 12))
    y = 2.0 * x + 0.5 + noise
    y[0] -= 1.5
    fits = fit_many("a*x + b", x, y, u_y=0.1, start={"a": 1.0, "b": 0.1}, bounds={"b": (0.0, None)})
    assert fits.values[0, 1] == pytest.approx(0.0, abs=1e-6)
    assert np.all(fits.status[1:] == "ok")
    slope, intercept = np.polyfit(x, y[1:].T, 1)
    np.testing.assert_allclose(fits.values[1:], np.column_stack([slope, intercept]), rtol=1e-5)


@pytest.mark.parametrize("u_y", [0.1, None])
@pytest.mark.parametrize("offset", [1e7, 1e9, 1e12])
def test_a_large_constant_of_y_changes_nothing_but_that_constant(
    offset: float, u_y: float | None
) -> None:
    y = decays(40) + offset
    far = fit_many(DECAY, X, y, u_y=u_y)
    near = fit_many(DECAY, X, y - offset, u_y=u_y)
    assert far.status.tolist() == near.status.tolist()
    shift = far.values - near.values - np.array([name == "c" for name in far.names]) * offset
    # of 1e12 a double has 1e-4: two digits less than the noise
    np.testing.assert_array_less(np.abs(shift) / near.sds, 0.02)
    np.testing.assert_allclose(far.sds, near.sds, rtol=0.02)


@pytest.mark.parametrize("u_y", [1.0, None])
def test_the_scatter_of_large_numbers_is_not_their_rounding(u_y: float | None) -> None:
    y = 10.0 * (decays(1)[0]) + 1e12
    far, near = (fit_curve(DECAY, X, y - zero, u_y=u_y) for zero in (0.0, 1e12))
    assert (far.status, near.status) == ("ok", "ok")
    for name in ("a", "tau"):
        assert abs(far.values[name] - near.values[name]) < 0.1 * near.sds[name]
