"""Figures in Spanish: longer words stay on the canvas and clear of each other, and a user's own
words stay what they are.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from formulas import formula_problem
from matplotlib import style
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text

from estim import AxisNames, fit_curve
from estim.checks.identifiability import identify
from estim.common import spoken
from estim.drawing import STYLE, new_figure, texts_of
from estim.fitting.least_squares import fit_least_squares
from estim.fitting.profile import profile_intervals
from estim.problem.priors import Normal
from estim.reports.identifiability import direction_figure, profile_figure
from estim.reports.pages import marked

X = np.linspace(0.0, 2.0, 12)


@pytest.fixture(autouse=True)
def _spanish() -> Iterator[None]:
    with spoken("es"), style.context(["default", STYLE]):
        yield


def words_of(figure: Figure) -> list[Text]:
    """The texts that are seen but for numbers of ticks, the figure drawn as in a report."""
    figure.set_dpi(150)
    FigureCanvasAgg(figure).draw()
    return [text for text in texts_of(figure) if text.get_visible() and text.get_text().strip()]


def off_the_canvas(figure: Figure) -> list[str]:
    boxes = [(text.get_text(), text.get_window_extent()) for text in words_of(figure)]
    width, height = figure.get_size_inches() * figure.dpi
    return [
        words
        for words, box in boxes
        if box.x0 < -1.0 or box.y0 < -1.0 or box.x1 > width + 1.0 or box.y1 > height + 1.0
    ]


def test_legends_are_whole_and_the_mark_of_synthetic_data_is_clear_of_them(
    rng: np.random.Generator,
) -> None:
    problem = formula_problem(
        lambda x, a, b: a + b + 0.1 * a * x,
        X,
        1.0 + 0.1 * X,
        0.1,
        {"a": Normal(0.5, 0.3), "b": Normal(0.5, 0.3)},
    )
    fit = fit_least_squares(problem)
    draws = rng.multivariate_normal(fit.values, fit.cov, 2000)
    found = identify(fit)
    for draw in (
        partial(direction_figure, problem, found),
        partial(profile_figure, problem, profile_intervals(fit), draws),
    ):
        figure = marked(draw())
        assert off_the_canvas(figure) == []
        texts = words_of(figure)
        (mark,) = (text for text in texts if "SINTÉTICOS" in text.get_text())
        said = mark.get_window_extent()
        assert not [
            one.get_text()
            for one in texts
            if one is not mark and one.get_window_extent().overlaps(said)
        ]
    cut = new_figure(1.0)
    cut.text(0.5, 0.5, "a lo largo de esta línea los datos dicen menos " * 3)
    assert len(off_the_canvas(cut)) == 1


def test_a_body_has_axes_of_our_words_and_a_users_curve_those_of_the_user() -> None:
    own = formula_problem(lambda x, a: a * x, X, X, 0.1, {"a": Normal(1.0, 0.5)}).runs[0]
    own = replace(own, x_name="position x", x_unit="m", y_name="speed v", y_unit="m/s")
    assert (own.x_label, own.y_label) == ("position x (m)", "speed v (m/s)")
    body = replace(own, motion=SimpleNamespace())
    assert (body.x_label, body.y_label) == ("posición x (m)", "velocidad v (m/s)")


def test_a_fitted_curve_speaks_spanish() -> None:
    y = 3.0 * X + 1.0 + 0.1 * np.random.default_rng(3).standard_normal(12)
    fit = fit_curve(
        "m*x + c", X, y, start={"m": 1.0, "c": 0.0}, axes=AxisNames("time t", "s", "signal", "V")
    )
    figure = fit.plot()
    upper, lower = figure.axes
    assert (upper.get_ylabel(), lower.get_xlabel(), lower.get_ylabel()) == (
        "signal (V)",
        "time t (s)",
        "residuo (V)",
    )
    assert [text.get_text() for text in upper.get_legend().get_texts()] == [
        "la curva, 95 %",
        "la curva, 68 %",
        "mejor curva",
        "datos ± u",
    ]
    assert off_the_canvas(figure) == []
    assert "68 % en [" in str(fit)
    assert "desviación estándar de los residuos" in str(fit)
    assert "| parámetro | valor e intervalos |" in fit._repr_markdown_()
    with spoken("en"):
        assert "68 % in [" in str(fit)
