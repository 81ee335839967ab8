"""Figures of a fitted curve, and the region of two of its parameters."""

from __future__ import annotations

import lmfit
import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy import stats

from estim import AxisNames, CurveFit, Poisson, fit_curve
from estim.common import InputError

X = np.linspace(0.0, 1.1, 12)
Y = 3.0 * np.exp(-X / 0.5) + 1.0 + 0.1 * np.random.default_rng(3).standard_normal(12)
FORMULA, START = "a*exp(-x/tau) + c", {"a": 1.0, "tau": 1.0, "c": 0.0}


@pytest.fixture(scope="module")
def decay() -> CurveFit:
    limits = {"tau": (0.01, 100.0)}
    return fit_curve(
        FORMULA,
        X,
        Y,
        start=START,
        bounds=limits,
        units={"tau": "s", "c": "V"},
        axes=AxisNames("time", "s", "signal $U$", "V"),
    )


def test_the_region_is_that_of_lmfit(decay: CurveFit) -> None:
    """lmfit refits at each point and tells the root of the rise of chi-squared; the probability is
    that of Fisher's F.
    """
    found = lmfit.models.ExpressionModel(FORMULA).fit(Y, x=X, **START)
    taus, offsets, sizes = lmfit.conf_interval2d(
        found, found, "tau", "c", 6, 6, limits=((0.25, 0.6), (0.9, 1.5))
    )
    probability = stats.f.cdf(0.5 * sizes**2, 2, found.nfree)
    region = decay.contour("tau", "c", probabilities=(0.68, 0.9, 0.95))
    assert region.n_failed == 0
    clear = [
        (i, j, p)
        for i, j in np.ndindex(sizes.shape)
        for p in region.levels
        if abs(probability[i, j] - p) > 0.003
    ]
    told = [region.holds(taus[j], offsets[i], probability=p) for i, j, p in clear]
    assert told == [bool(probability[i, j] < p) for i, j, p in clear]
    assert 10 < sum(told) < len(told) - 10


def test_the_region_of_a_line_is_its_ellipse() -> None:
    y = 2.0 * X + 1.0 + 0.1 * np.random.default_rng(1).standard_normal(12)
    region = fit_curve("m*x + c", X, y, u_y=0.1, start={"m": 1.0, "c": 0.0}).contour("m", "c")
    assert region.levels == pytest.approx({0.68: -2.0 * np.log(0.32), 0.95: -2.0 * np.log(0.05)})
    for level, ellipse in region.ellipses.items():
        inner, outer = (region.best + size * (ellipse - region.best) for size in (0.99, 1.01))
        assert all(region.holds(*point, probability=level) for point in inner[::10])
        assert not any(region.holds(*point, probability=level) for point in outer[::10])


def test_a_bent_region_is_not_its_ellipse(decay: CurveFit) -> None:
    region = decay.contour("tau", "c")
    assert not all(
        region.holds(*point) for point in region.best + 0.95 * (region.ellipses[0.95] - region.best)
    )


def test_no_region_of_a_fit_that_is_not_to_be_trusted() -> None:
    bad = fit_curve("m*x + c", X, 5.0 * X**2, u_y=0.01, start={"m": 1.0, "c": 0.0})
    with pytest.raises(InputError, match="status ok, not poor-fit"):
        bad.contour("m", "c")
    good = fit_curve("m*x + c", X, Y, u_y=5.0, start={"m": 1.0, "c": 0.0}, deviation=0.1)
    with pytest.raises(InputError, match="deviation"):
        good.contour("m", "c")
    with pytest.raises(InputError, match="'probabilities' must hold one at least"):
        fit_curve("m*x + c", X, Y, u_y=5.0, start={"m": 1.0, "c": 0.0}).contour(
            "m", "c", probabilities=()
        )


def test_a_figure_has_points_band_and_residuals_in_the_unit_of_y(decay: CurveFit) -> None:
    figure = decay.plot()
    upper, lower = figure.axes
    assert (upper.get_ylabel(), lower.get_xlabel(), lower.get_ylabel()) == (
        r"signal \$U\$ (V)",
        "time (s)",
        "residual (V)",
    )
    residuals = lower.lines[-1].get_ydata()
    assert residuals == pytest.approx(Y - decay.predict(X).value)
    assert [text.get_text() for text in upper.get_legend().get_texts()] == [
        "the curve, 95 %",
        "the curve, 68 %",
        "best curve",
        "data ± u",
    ]
    assert figure._repr_png_().startswith(b"\x89PNG")  # type: ignore[attr-defined]


def test_a_figure_goes_into_that_of_the_user(decay: CurveFit) -> None:
    own = Figure()
    assert decay.plot(own) is own
    assert len(own.axes) == 2
    assert len(decay.contour("a", "c").plot(own.add_subfigure(own.add_gridspec(1, 1)[0])).axes) == 1  # type: ignore[arg-type]


def test_a_refused_curve_is_drawn_without_a_band() -> None:
    upper, _ = fit_curve("m*x + c", X, 5.0 * X**2, u_y=0.01, start={"m": 1.0, "c": 0.0}).plot().axes
    assert [text.get_text() for text in upper.get_legend().get_texts()] == [
        "best curve",
        "data ± u",
    ]
    assert "poor-fit" in upper.get_title()


def test_counts_have_the_scatter_of_their_law_in_place_of_bars() -> None:
    counts = np.random.default_rng(2).poisson(20.0 * np.exp(-X))
    fit = fit_curve(
        "n*exp(-x/tau)", X, counts, start={"n": 10.0, "tau": 1.0}, noise=Poisson(bins=0.1)
    )
    upper, lower = fit.plot().axes
    assert "counts" in [text.get_text() for text in upper.get_legend().get_texts()]
    band = lower.collections[0].get_paths()[0].vertices
    assert band[:, 1].max() == pytest.approx(np.sqrt(fit.predict(X).value.max()))


def test_axes_are_logarithmic_where_the_points_span_decades() -> None:
    rng = np.random.default_rng(2)
    f = np.geomspace(10.0, 1e5, 25)
    gain = 1.0 / (1.0 + (f / 800.0) ** 2)
    decades = fit_curve(
        "1/(1+(x/f0)**2)",
        f,
        gain * (1.0 + rng.normal(0.0, 0.03, 25)),
        u_y=0.03 * gain,
        start={"f0": 500.0},
        scan=False,
    )
    figure = decades.plot()
    assert [(ax.get_xscale(), ax.get_yscale()) for ax in figure.axes] == [
        ("log", "log"),
        ("log", "linear"),
    ]
    # the curve is drawn as finely in each decade
    x = figure.axes[0].lines[0].get_xdata()
    assert np.ptp(np.diff(np.log(np.asarray(x, dtype=float)))) < 1e-9
    # an error of a fortieth of the largest reading hides what is beyond: y stays linear
    noisy = fit_curve(
        "1/(1+(x/f0)**2)", f, gain + 1e-4, u_y=0.025, start={"f0": 500.0}, scan=False
    ).plot()
    assert (noisy.axes[0].get_xscale(), noisy.axes[0].get_yscale()) == ("log", "linear")
    short = fit_curve("a*x+b", f[:8], 2.0 * f[:8] + 1.0, u_y=0.3, scan=False).plot()
    assert short.axes[0].get_xscale() == "linear"


def test_what_is_drawn_in_axes_of_the_user_leaves_their_scale_and_bins_from_0_are_drawn() -> None:
    t = np.linspace(0.0, 8.0, 30)
    decay = fit_curve("A*exp(-x/tau)", t, 1e5 * np.exp(-t), u_y=1e3 * np.exp(-t), scan=False)
    assert decay.plot().axes[0].get_yscale() == "log"
    axes = Figure().subplots()
    decay.plot(ax=axes)
    assert axes.get_yscale() == "linear"
    edges = np.array([0.0, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 200.0])
    counts = np.array([95, 90, 160, 240, 270, 200, 80, 10])
    centres = 0.5 * (edges[1:] + edges[:-1])
    fit = fit_curve("A*exp(-x/tau)", centres, counts, noise=Poisson(bins=edges))
    assert fit.plot().axes[0].get_xscale() == "linear"
