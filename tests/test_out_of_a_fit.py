"""What goes out of a fitted curve: residuals, numbers for other programs, copies, figures in axes
of the user's own.
"""

from __future__ import annotations

import copy
import json
import math
import pickle

import numpy as np
import pytest
import uncertainties
from matplotlib.figure import Figure

import estim
from estim import DataSet, EventTimes, InputError, Poisson, fit_curve, fit_curves

X = np.linspace(0.0, 5.0, 30)
Y = 2.0 * np.exp(-X / 1.7) + 0.3 + 0.02 * np.random.default_rng(4).standard_normal(30)


def decay(x, a, tau, c):
    return a * np.exp(-x / tau) + c


@pytest.fixture(scope="module")
def fit():
    return fit_curve("a*exp(-x/tau) + c", X, Y, u_y=0.02, units={"tau": "s"})


def test_a_fit_is_its_curve_and_residuals_are_in_the_order_given(fit) -> None:
    expected = decay(X, **fit.values)
    assert fit(X) == pytest.approx(expected, rel=1e-12)
    assert fit(X.reshape(5, 6)).shape == (5, 6)
    assert np.shape(fit(1.0)) == ()
    assert fit.residuals == pytest.approx(Y - expected, abs=1e-12)
    mixed = np.random.default_rng(0).permutation(30)
    other = fit_curve("a*exp(-x/tau) + c", X[mixed], Y[mixed], u_y=0.02)
    assert other.residuals == pytest.approx(fit.residuals[mixed], abs=1e-7)


def test_residuals_of_counts_and_of_several_sets_are_in_the_order_given() -> None:
    counts = np.random.default_rng(1).poisson(50.0 * np.exp(-X))
    mixed = np.random.default_rng(0).permutation(30)
    edges = np.column_stack([X - 0.05, X + 0.05])
    for noise in ("poisson", Poisson(bins=edges[mixed])):
        binned = fit_curve("a*exp(-x)", X[mixed], counts[mixed], noise=noise, start={"a": 40.0})
        assert binned.residuals - counts[mixed] == pytest.approx(
            -binned.values["a"]
            * (
                np.exp(-X[mixed])
                if noise == "poisson"
                else -np.diff(np.exp(-edges[mixed]), axis=1)[:, 0]
            ),
            rel=1e-6,
        )
    times = np.random.default_rng(2).exponential(1.0, 100)
    events = fit_curve("exp(-x/t0)", times, None, noise=EventTimes(0.0, 50.0), start={"t0": 1.0})
    assert events.residuals.sum() == pytest.approx(0.0, abs=1e-6)
    sets = {"b": DataSet(X[mixed], Y[mixed], u_y=0.02), "a": DataSet(X, Y, u_y=0.02)}
    both = fit_curves("a*exp(-x/tau) + c", sets, shared=["a", "tau", "c"])
    assert both.residuals[:30] == pytest.approx(both.residuals[30:][mixed], abs=1e-9)
    assert both(1.0, data="a") == both(1.0, data="b")


def test_profile_intervals_are_those_of_the_curvature_where_it_is_quadratic(fit) -> None:
    line = fit_curve("a + b*x", X, 1.0 + X + 10.0 * (Y - decay(X, 2.0, 1.7, 0.3)), u_y=0.2)
    low, high = line.profile_interval("b", probability=0.95)
    assert (high - low) / (2 * 1.959964) == pytest.approx(line.sds["b"], rel=1e-6)
    low, high = fit.profile_interval("tau", probability=0.68)
    assert 0.5 * (high - low) == pytest.approx(0.9945 * fit.sds["tau"], rel=0.02)
    with pytest.raises(InputError, match="profile_interval"):
        fit_curve("a + b*x", X, Y, u_y=0.001).profile_interval("b")


def test_correlated_numbers_propagate_as_the_covariance_says(fit) -> None:
    known = fit.ufloats()
    start = known["a"] + known["c"]
    gradient = np.array([1.0, 0.0, 1.0])
    assert start.std_dev == pytest.approx(math.sqrt(gradient @ fit.cov @ gradient), rel=1e-9)
    assert uncertainties.covariance_matrix([known[n] for n in fit.names]) == pytest.approx(
        fit.cov, rel=1e-9
    )
    with pytest.raises(InputError, match="poor-fit"):
        fit_curve("a + b*x", X, Y, u_y=0.001).ufloats()


def test_a_fit_as_json_and_as_a_table(fit) -> None:
    read = json.loads(json.dumps(fit.to_dict()))
    assert read["status"] == "ok"
    assert read["parameters"]["tau"]["value"] == fit.values["tau"]
    assert read["parameters"]["tau"]["unit"] == "s"
    assert read["parameters"]["tau"]["intervals"]["0.95"] == list(fit.intervals["tau"][0.95])
    assert np.array(read["covariance"]) == pytest.approx(fit.cov)
    perfect = fit_curve("a + b*x", X, 1.0 + 2.0 * X)
    assert json.loads(json.dumps(perfect.to_dict()))["parameters"]["a"]["sd"] is None
    frame = fit.to_frame()
    assert list(frame.columns[:2]) == ["value", "sd"]
    assert frame.loc["tau", "high 95 %"] == fit.intervals["tau"][0.95][1]
    assert frame.attrs["status"] == "ok"


@pytest.mark.parametrize("curve", ["a*exp(-x/tau) + c", "exponential + constant", decay])
def test_fits_are_pickled_and_copied(curve) -> None:
    start = {"a": 1.0, "tau": 1.0, "c": 0.0} if curve is decay else None
    fitted = fit_curve(curve, X, Y, u_y=0.02, start=start)
    for other in (pickle.loads(pickle.dumps(fitted)), copy.deepcopy(fitted), copy.copy(fitted)):
        assert str(other) == str(fitted)
        assert other.predict(1.0).u == fitted.predict(1.0).u


def test_a_fit_draws_in_axes_of_the_users_own_and_changes_no_others(fit) -> None:
    figure = Figure()
    left, middle, right = figure.subplots(1, 3)
    left.set_title(r"$\alpha$")
    assert fit.plot(ax=middle) is figure
    fit.contour("a", "tau").plot(ax=right)
    assert left.get_title() == r"$\alpha$"
    assert not left.lines
    assert len(middle.lines) >= 2
    assert right.get_xlabel() == "a"
    assert middle.get_xlabel() == "x"


def test_the_package_knows_its_version() -> None:
    from importlib.metadata import version

    assert estim.__version__ == version("estim")
