"""Complex y: the fit beside SciPy's least squares on both parts, what it gives back, coverage."""

from __future__ import annotations

import pickle
from functools import partial
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares

from estim import Component, InputError, Target, fit_curve, fit_curves, sample_curve

F = np.linspace(9.0, 11.0, 40)
TRUE = {"f_0": 10.1, "q": 12.0, "phase": 0.4}
START = {"f_0": 10.0, "q": 10.0, "phase": 0.0}


def resonance(f: Any, f_0: Any, q: Any, phase: Any) -> Any:
    return np.exp(1j * phase) / (1.0 + 2j * q * (f - f_0) / f_0)


def without_phase(f: Any, f_0: Any, q: Any) -> Any:
    return resonance(f, f_0, q, 0.0)


def readings(seed: int, re: float = 0.05, im: float = 0.05, n: int = 40) -> Any:
    rng = np.random.default_rng(seed)
    noise = re * rng.standard_normal(n) + 1j * im * rng.standard_normal(n)
    return resonance(np.linspace(9.0, 11.0, n), **TRUE) + noise


def both_parts(z: Any) -> Any:
    return np.concatenate([z.real, z.imag])


def by_scipy(y: Any, u: Any) -> tuple[Any, Any, float]:
    """Values, covariance as for errors of size `u`, and the sum of squares."""
    found = least_squares(
        lambda p: both_parts(y - resonance(F, *p)) / u, [10.05, 11.0, 0.3],
        x_scale=[0.01, 0.5, 0.1], xtol=1e-14, ftol=1e-14, gtol=1e-14, jac="3-point",
    )  # fmt: skip
    return found.x, np.linalg.inv(found.jac.T @ found.jac), 2.0 * float(found.cost)


@pytest.mark.parametrize(("u_y", "re", "im"), [(0.05, 0.05, 0.05), (0.02 + 0.2j, 0.02, 0.2)])
def test_stated_errors_give_the_least_squares_of_both_parts(u_y: Any, re: float, im: float) -> None:
    y = readings(3, re, im)
    values, cov, chi2 = by_scipy(y, np.repeat([re, im], 40))
    fit = fit_curve(resonance, F, y, u_y=u_y, start=START)
    assert (fit.status, fit.dof) == ("ok", 77)
    assert fit.chi2 == pytest.approx(chi2, rel=1e-9)
    np.testing.assert_allclose(list(fit.values.values()), values, rtol=1e-6)
    np.testing.assert_allclose(fit.cov, cov, rtol=1e-4, atol=1e-4 * np.min(np.diag(cov)))


def test_errors_that_are_not_stated_are_of_one_size_in_both_parts() -> None:
    y = readings(4)
    values, cov, squares = by_scipy(y, 1.0)
    fit = fit_curve(resonance, F, y, start=START)
    assert fit.sigma == pytest.approx(np.sqrt(squares / 77.0), rel=1e-9)
    np.testing.assert_allclose(list(fit.values.values()), values, rtol=1e-6)
    np.testing.assert_allclose(list(fit.sds.values()), fit.sigma * np.sqrt(np.diag(cov)), rtol=1e-4)
    draws = sample_curve(fit, seed=1, target=Target(ess=400.0))
    assert draws.chain.names == (*TRUE, "sigma_y")
    np.testing.assert_allclose(
        np.std(draws.chain.flat[:, :3], axis=0), [*fit.sds.values()], rtol=0.15
    )


@pytest.mark.parametrize("u_y", [0.05, None])
def test_a_complex_curve_that_lacks_something_is_no_ok(u_y: float | None) -> None:
    y = readings(5)
    assert fit_curve(resonance, F, y, u_y=u_y, start=START).status == "ok"
    start = {name: START[name] for name in ("f_0", "q")}
    assert fit_curve(without_phase, F, y, u_y=u_y, start=start).status == "poor-fit"
    upward = {"bounds": {"q": (0.0, None)}, "start": START}  # -q would draw the conjugate
    assert fit_curve(resonance, F, y.conj(), u_y=u_y, **upward).status != "ok"


def test_a_fit_of_complex_values_gives_complex_ones_in_the_order_of_the_points() -> None:
    y, order = readings(6), np.random.default_rng(1).permutation(40)
    fit = fit_curve(resonance, F[order], list(y[order]), u_y=0.05, start=START)
    curve = resonance(F, **fit.values)
    np.testing.assert_allclose(fit.residuals, (y - curve)[order], atol=1e-12)
    np.testing.assert_allclose(fit(F.reshape(5, 8)), curve.reshape(5, 8), atol=1e-12)
    np.testing.assert_allclose(fit(F, data="imaginary"), curve.imag, atol=1e-12)
    assert np.shape(fit(10.0)) == ()
    squares = np.abs(y - curve) ** 2, np.abs(y - y.mean()) ** 2
    assert fit.r_squared == pytest.approx(1.0 - squares[0].sum() / squares[1].sum())
    predicted = fit.predict([10.0], data="imaginary")
    assert predicted.value[0] == pytest.approx(resonance(10.0, **fit.values).imag)
    axes = fit.plot(data="imaginary").axes
    np.testing.assert_allclose(axes[0].lines[1].get_ydata(), y.imag)
    for method in (fit.plot, partial(fit.predict, [10.0])):
        with pytest.raises(InputError, match="must be one of real, imaginary"):
            method()


def test_complex_values_may_have_several_abscissas() -> None:
    power = np.linspace(1.0, 2.0, 40)

    def driven(at: Any, f_0: Any, q: Any, phase: Any) -> Any:
        return at["power"] * resonance(at["f"], f_0, q, phase)

    y = readings(7)
    fit = fit_curve(driven, {"f": F, "power": power}, power * y, u_y=0.05 * power, start=START)
    plain = fit_curve(resonance, F, y, u_y=0.05, start=START)
    np.testing.assert_allclose([*fit.values.values()], [*plain.values.values()], rtol=1e-7)
    there = fit({"f": [10.0], "power": [3.0]})
    assert there == pytest.approx(3.0 * resonance(10.0, **fit.values))


def test_jitter_and_outliers_are_those_of_both_parts() -> None:
    y = readings(8, 0.1, 0.1)
    fit = fit_curve(resonance, F, y, u_y=0.02, jitter=True, start=START)
    assert fit.names == (*TRUE, "jitter")
    assert abs(fit.values["jitter"] - np.sqrt(0.1**2 - 0.02**2)) < 4.0 * fit.sds["jitter"]
    y[7] += 3.0
    robust = fit_curve(resonance, F, y, robust="student-t", start=START)
    assert robust.names == (*TRUE, "sigma_y")
    assert robust.status == "ok"
    assert all(abs(robust.values[name] - TRUE[name]) < 4.0 * robust.sds[name] for name in TRUE)


def test_an_error_of_the_gain_is_one_of_both_parts() -> None:
    fit = fit_curve(
        resonance, F, readings(9), u_y=0.05, start=START, errors=[Component("scale_y", 0.2)]
    )
    assert fit.names == (*TRUE, "scale_y")
    assert fit.sds["scale_y"] < 0.1  # the amplitude is 1: both parts show the gain


REFUSED: dict[str, dict[str, Any]] = {
    "a formula": {"curve": "a*x"},
    "a name": {"curve": "gaussian"},
    "a share": {"u_y": "2%"},
    "a matrix": {"u_y": None, "cov_y": np.eye(40)},
    "errors of x": {"u_x": 0.1},
    "a zero": {"errors": [Component("zero_y", 0.1)]},
    "a deviation": {"deviation": 0.1},
    "correlation": {"correlated": True},
    "counts": {"u_y": None, "noise": "poisson"},
    "one part exact": {"u_y": 0.1 + 0j},
    "no number": {"y": np.where(F > 10.5, np.nan, readings(1))},
    "ragged": {"y": [[1j, 2.0], [3.0]]},
    "text": {"y": [1j, "2"]},
    "masked": {"y": np.ma.array(readings(1), mask=F > 10.5)},
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_complex_values_do_not_have_is_refused_in_one_line(what: str) -> None:
    given = {"curve": resonance, "x": F, "y": readings(1), "u_y": 0.05, **REFUSED[what]}
    start = {"a": 1.0} if what == "a formula" else None if what == "a name" else START
    with pytest.raises(InputError) as refused:
        fit_curve(**given, start=start)
    assert "\n" not in str(refused.value)


def test_data_sets_without_errors_are_refused_as_before() -> None:
    from estim import DataSet

    data = {"a": DataSet([1, 2, 3], [1, 2, 3.1]), "b": DataSet([1, 2, 3], [1, 2.1, 3])}
    with pytest.raises(InputError, match="needs u_y, cov_y or noise"):
        fit_curves("k*x", data)


@pytest.mark.statistics
@pytest.mark.parametrize("u_y", [0.05, None])
def test_intervals_of_complex_fits_hold_what_they_say(u_y: float | None) -> None:
    """Errors as of 8 real values, where there are 16, would be off by far: see `wrong`."""
    n, n_fit, hits, wrong, ok = 8, 150, np.zeros(2), 0, 0
    for seed in range(n_fit):
        y = readings(seed, n=n)
        fit = fit_curve(resonance, np.linspace(9.0, 11.0, n), y, u_y=u_y, start=TRUE, scan=False)
        ok += fit.status == "ok"
        for name, true in TRUE.items():
            for i, p in enumerate((0.68, 0.95)):
                low, high = fit.intervals[name][p]
                hits[i] += low <= true <= high
            wrong += abs(fit.values[name] - true) < np.sqrt(2.0) * fit.sds[name]
    share, error = hits / (3 * n_fit), np.sqrt(np.array([0.2176, 0.0475]) / (3 * n_fit))
    assert np.all(np.abs(share - (0.68, 0.95)) < 4.0 * error)
    assert abs(wrong / (3 * n_fit) - 0.68) > 5.0 * error[0]
    assert ok > 0.95 * n_fit


def test_a_complex_fit_can_be_kept() -> None:
    found = fit_curve(resonance, F, readings(9), u_y=0.05, start=START)
    again = pickle.loads(pickle.dumps(found))
    assert again.values == found.values
    np.testing.assert_array_equal(again(F), found(F))
