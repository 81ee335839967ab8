"""The gate for numbers that a person hands over in Python: what is no real number is refused by one
line with its cure, at every door.
"""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime, timedelta
from decimal import Decimal
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from uncertainties import ufloat

from estim import (
    Binomial,
    DataSet,
    EventTimes,
    Input,
    InputError,
    Poisson,
    budget_along,
    compare_values,
    confidence_band,
    fit_curve,
    fit_curves,
    fit_line,
    inverse_prediction,
    line_posterior,
    mean,
    prediction_band,
    propagate_linear,
    propagate_monte_carlo,
    sample_curve,
)
from estim.given_numbers import real_number, real_numbers

pd = pytest.importorskip("pandas")
N = 12
X = np.arange(1.0, N + 1.0)
Y = 2.0 * X + 1.0 + 0.05 * (-1.0) ** X
DATES = np.datetime64("2024-01-01T00:00:00", "s") + X.astype("timedelta64[s]")
MASK = np.arange(N) == 3
BAD: dict[str, tuple[Any, str]] = {
    "masked": (
        np.ma.array(Y, mask=MASK),
        "must not be masked: leave those points out of all arrays, as x[~y.mask] and "
        "y[~y.mask]: 1 masked",
    ),
    "list with a masked one": ([*Y[:-1], np.ma.masked], "must not be masked"),
    "dates": (
        DATES,
        "not dates: count them from one of them, (t - t[0])/numpy.timedelta64(1, 's')",
    ),
    "dates in ns": (DATES.astype("datetime64[ns]"), "not dates"),
    "series of dates": (pd.Series(DATES), "not dates"),
    "dates with a zone": (pd.Series(DATES).dt.tz_localize("UTC"), "not dates"),
    "list of dates": ([datetime(2024, 1, 1, 0, 0, i) for i in range(N)], "not dates"),
    "differences": (DATES - DATES[0], "not differences of times: divide them by a unit"),
    "list of differences": ([timedelta(seconds=i) for i in range(N)], "not differences of times"),
    "complex": (Y + 1j, "real ones: of complex ones take the real part"),
    "truth": (X > 4.0, "not true and false: where 0 and 1 are meant, say so by .astype(float)"),
    "list with truth": ([True, *Y[1:]], "not true and false"),
    "truth that may lack": (pd.array([True, None] * 6, dtype="boolean"), "not true and false"),
    "text": ([str(y) for y in Y], "not text"),
    "text in objects": (np.array([str(y) for y in Y], dtype=object), "not text"),
    "bytes": (np.array([str(y) for y in Y], dtype="S"), "not text"),
    "records": (np.array([(y,) for y in Y], dtype=[("y", float)]), "not records of several fields"),
}
GOOD: dict[str, Any] = {
    "list": Y.tolist(),
    "tuple": tuple(Y),
    "whole numbers": np.arange(N),
    "short floats": Y.astype(np.float32),
    "series": pd.Series(Y),
    "series with objects": pd.Series(Y, dtype=object),
    "floats that may lack": pd.array(Y, dtype="Float64"),
    "decimals": [Decimal(str(y)) for y in Y],
    "fractions": [Fraction(y) for y in Y],
    "nothing masked": np.ma.array(Y, mask=False),
    "large": [10**20] * N,
    "other order": np.asfortranarray(Y),
}
START = {"a": 1.0, "b": 0.0}
LINE = fit_line(X, Y)
OF_A = [Input("a", 1.0, 0.1)]


def curve(x: Any = X, y: Any = Y, **given: Any) -> object:
    return fit_curve("a*x + b", x, y, **{"u_y": 0.1, "start": START, "scan": False, **given})


DOORS: dict[str, Callable[[Any], object]] = {
    "x": lambda v: curve(v),
    "y": lambda v: curve(y=v),
    "u_y": lambda v: curve(u_y=v),
    "u_x": lambda v: curve(u_x=v),
    "correlated": lambda v: curve(correlated=v),
    "curve": lambda v: fit_curve(lambda x, a, b: v, X, Y, u_y=0.1, start=START),
    "data set": lambda v: fit_curves(
        "a*x + b", {"one": DataSet(X, v, u_y=0.1)}, shared=["a"], start=START
    ),
    "counts": lambda v: fit_curve("a*x + b", X, v, noise="poisson", start=START),
    "bins": lambda v: fit_curve("a*x + b", X, np.round(Y), noise=Poisson(bins=v), start=START),
    "trials": lambda v: fit_curve(
        "a + 0*x", X, np.ones(N), noise=Binomial(trials=v), start={"a": 0.5}
    ),
    "events": lambda v: fit_curve(
        "exp(-x/tau)", v, None, noise=EventTimes(0.0, 1e12), start={"tau": 3.0}
    ),
    "line x": lambda v: fit_line(v, Y),
    "line y": lambda v: fit_line(X, v),
    "line u_y": lambda v: fit_line(X, Y, u_y=v),
    "line r_xy": lambda v: fit_line(X, Y, u_x=0.1, u_y=0.1, r_xy=v),
    "line posterior": lambda v: line_posterior(X, v, scatter=1.0),
    "confidence band": lambda v: confidence_band(LINE, v),
    "prediction band": lambda v: prediction_band(LINE, X, u_y=v),
    "prediction band, u_x": lambda v: prediction_band(LINE, X, u_x=v),
    "predict": lambda v: curve().predict(v),  # type: ignore[attr-defined]
    "readings": lambda v: Input.from_readings("a", v),
    "budget": lambda v: budget_along(propagate_linear(lambda q: q["a"] * X, OF_A), v),
    "linear": lambda v: propagate_linear(lambda q: v, OF_A),
    "Monte Carlo": lambda v: propagate_monte_carlo(
        lambda q: v, OF_A, rng=np.random.default_rng(1), n_draw=10_000
    ),
}
NUMBERS: dict[str, Callable[[Any], object]] = {
    "start": lambda v: curve(start={"a": v, "b": 0.0}),
    "fixed": lambda v: curve(start={"b": 0.0}, fixed={"a": v}),
    "bounds": lambda v: curve(bounds={"a": (None, v)}),
    "deviation": lambda v: curve(deviation=v),
    "low": lambda v: fit_curve(
        "exp(-x/tau)", X, None, noise=EventTimes(v, 20.0), start={"tau": 3.0}
    ),
    "value": lambda v: Input("a", v, 0.1),
    "u": lambda v: Input("a", 1.0, v),
    "half width": lambda v: Input.from_half_width("a", 1.0, v),
    "inverse": lambda v: inverse_prediction(LINE, v),
}
MATRICES: dict[str, Callable[[Any], object]] = {
    "cov_y": lambda m: curve(u_y=None, cov_y=m(N)),
    "cov": lambda m: fit_line(X, Y, cov=m(2 * N)),
    "correlation": lambda m: propagate_linear(
        lambda q: q["a"], [*OF_A, Input("b", 1.0, 0.1)], correlation=m(2)
    ),
}


@pytest.mark.parametrize("kind", BAD)
def test_what_is_no_real_number_is_told_with_its_cure(kind: str) -> None:
    values, told = BAD[kind]
    with pytest.raises(InputError) as refused:
        real_numbers(values, "y")
    assert str(refused.value).startswith("'y' must ")
    assert told in str(refused.value)


@pytest.mark.parametrize("door", DOORS)
def test_every_door_for_arrays_refuses_them_in_one_line(door: str) -> None:
    for kind, (values, _) in BAD.items():
        with pytest.raises(InputError) as refused:
            DOORS[door](values)
        assert "\n" not in str(refused.value), kind


@pytest.mark.parametrize("door", NUMBERS)
@pytest.mark.parametrize(
    "value",
    [
        True,
        np.True_,
        "1.0",
        1j,
        np.complex128(1.0),
        DATES[0],
        DATES[1] - DATES[0],
        datetime(2024, 1, 1),
        None,
        [1.0],
        np.ma.masked,
    ],
)
def test_every_door_for_one_number_refuses_them_in_one_line(door: str, value: object) -> None:
    if door == "bounds" and value is None:
        return  # no limit
    with pytest.raises(InputError):
        NUMBERS[door](value)


@pytest.mark.parametrize("door", MATRICES)
def test_every_door_for_matrices_refuses_them_in_one_line(door: str) -> None:
    assert (
        MATRICES[door](lambda n: 0.01 * np.eye(n) if door != "correlation" else np.eye(n))
        is not None
    )
    for bad in (
        lambda n: np.ma.array(np.eye(n), mask=np.eye(n, k=1) > 0),
        lambda n: np.eye(n) * (1.0 + 0j),
        lambda n: np.eye(n) > 0,
        lambda n: [[str(one) for one in row] for row in np.eye(n)],
        lambda n: [np.ma.array(row, mask=row > 0) for row in np.eye(n)],
    ):
        with pytest.raises(InputError):
            MATRICES[door](bad)


@pytest.mark.parametrize("kind", GOOD)
def test_numbers_of_any_make_pass_unchanged(kind: str) -> None:
    read = real_numbers(GOOD[kind], "y")
    assert read.dtype == np.float64
    assert read.tolist() == [float(one) for one in GOOD[kind]]


def test_one_number_of_any_make_passes() -> None:
    assert [
        real_number(one, "u")
        for one in (2, 2.0, np.int64(2), np.float32(2.0), Decimal(2), Fraction(2), np.array(2.0))
    ] == [2.0] * 7


def test_a_function_that_masks_its_values_is_refused_where_its_mask_would_be_dropped() -> None:
    with pytest.raises(
        InputError, match="must return a plain array, with nan where it has no value"
    ):
        fit_curve(lambda x, a, b: np.ma.masked_greater(a * x + b, 1e3), X, Y, u_y=0.1, start=START)


def test_points_without_the_masked_ones_give_the_line_of_the_others() -> None:
    y = np.ma.array(np.where(MASK, 1e3, Y), mask=MASK)
    assert fit_line(X[~y.mask], y[~y.mask]).slope == pytest.approx(2.0, abs=0.02)
    assert abs(fit_line(X, y.data).slope - 2.0) > 1.0  # what the dropped mask gave


def test_dates_counted_as_told_give_the_slope_in_their_unit() -> None:
    seconds = (DATES - DATES[0]) / np.timedelta64(1, "s")
    assert fit_line(seconds, Y).slope == pytest.approx(2.0, abs=0.02)


def test_a_seed_stands_for_its_generator_and_anything_else_is_refused() -> None:
    x = np.arange(5.0)
    y = 1.0 + 2.0 * x + 0.1 * np.random.default_rng(1).standard_normal(5)
    by_seed, by_generator = (
        fit_curve("a + b*x", x, y, u_y=0.1, rng=rng) for rng in (7, np.random.default_rng(7))
    )
    assert by_seed.goodness[0].checks == by_generator.goodness[0].checks
    inputs = [Input("L", 1.0, 0.1)]
    seeded, generated = (
        propagate_monte_carlo("2*L", inputs, rng=rng, n_draw=2000)
        for rng in (7, np.random.default_rng(7))
    )
    assert seeded.u == generated.u
    for wrong in ("one", -1, 1.5, True, [1, 2]):
        with pytest.raises(InputError, match="'rng' must be a seed"):
            fit_curve("a + b*x", x, y, rng=wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("ask", "field"),
    [
        (lambda: fit_line(X * 1e200, Y), "x"),
        (lambda: fit_line(X, Y * 1e-200), "y"),
        (lambda: fit_line(X, Y, u_y=1e-200), "u_y"),
        (lambda: fit_curve("a + b*x", X, Y * 1e200), "y"),
        (lambda: fit_curve("a + b*x", X, Y, u_y=[1e-200, *[0.1] * (len(Y) - 1)]), "u_y"),
        (lambda: mean([1e200, 3e200]), "values"),
        (lambda: mean([1.0, 2.0], [0.1, 1e-200]), "u"),
    ],
)
def test_what_cannot_be_squared_is_refused_at_every_door(
    ask: Callable[[], object], field: str
) -> None:
    with pytest.raises(InputError, match=rf"^'{field}' must be 0 or between 1e-100 and 1e100"):
        ask()


def test_small_values_beside_ordinary_ones_are_kept() -> None:
    """The end of a decay that was computed, for example."""
    assert fit_line(X, Y + 1e-200).slope == fit_line(X, Y).slope
    assert fit_curve("a + b*x", [0.0, 1e-180, 1.0, 2.0], [1.0, 1.1, 2.0, 3.1]).status == "ok"


@pytest.mark.parametrize("wrong", ["a", -1, 2.5, True])
def test_a_seed_is_a_whole_number(wrong: object) -> None:
    with pytest.raises(InputError, match=r"^'seed' must be a whole number >= 0"):
        sample_curve(fit_curve("a + b*x", X, Y), seed=wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize("wrong", [(9.81, 0.02), ["9.81(2)"], ufloat(9.81, 0.02), None])
def test_what_is_no_quantity_is_not_compared(wrong: object) -> None:
    with pytest.raises(InputError, match=r"^'first' must be a number or"):
        compare_values(wrong, "9.79(3)")  # type: ignore[arg-type]
