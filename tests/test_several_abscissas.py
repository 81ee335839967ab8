"""Curves of several abscissas, y = f(u, v; parameters)."""

from __future__ import annotations

import pickle
import re
from typing import Any

import lmfit
import numpy as np
import pandas as pd
import pytest

from estim import (
    DataSet,
    EventTimes,
    InputError,
    Target,
    curve_report,
    fit_curve,
    fit_curves,
    sample_curve,
)
from estim.checks import influences

U, V = (grid.ravel() for grid in np.meshgrid(np.linspace(-3, 3, 9), np.linspace(-2, 2, 8)))
BOTH = {"u": U, "v": V}
SPOT = "h*exp(-((u - u_0)**2 + (v - v_0)**2)/(2*w**2)) + b"
START = {"u_0": 0.0, "v_0": 0.0, "w": 1.0}


def spot(u: Any, v: Any, h: float, u_0: float, v_0: float, w: float, b: float) -> Any:
    return h * np.exp(-((u - u_0) ** 2 + (v - v_0) ** 2) / (2 * w**2)) + b


def noise(sd: float, seed: int = 1) -> Any:
    return sd * np.random.default_rng(seed).standard_normal(U.size)


def test_a_peak_of_two_abscissas_is_that_of_lmfit() -> None:
    z = spot(U, V, 5.0, 0.5, -0.3, 1.2, 1.0) + noise(0.1)
    fit = fit_curve(SPOT, BOTH, z, u_y=0.1, start=START)
    model = lmfit.Model(spot, independent_vars=["u", "v"])
    weights = np.full(U.size, 10.0)
    theirs = model.fit(z, u=U, v=V, weights=weights, scale_covar=False, h=4, b=0, **START).params
    assert fit.status.ok
    for name in fit.names:
        assert fit.values[name] == pytest.approx(theirs[name].value, abs=1e-3 * theirs[name].stderr)
        assert fit.sds[name] == pytest.approx(theirs[name].stderr, rel=1e-3)


def test_a_plane_needs_no_start_and_is_the_linear_regression() -> None:
    z = 2.0 * U - V + 0.5 + noise(0.2)
    fit = fit_curve("a*u + b*v + c", pd.DataFrame(BOTH), z)
    design = np.column_stack([U, V, np.ones(U.size)])
    best, squares, _, _ = np.linalg.lstsq(design, z)
    cov = np.linalg.inv(design.T @ design) * squares[0] / (U.size - 3)
    assert fit.status.ok
    assert [fit.values[n] for n in "abc"] == pytest.approx(best, rel=1e-7)
    assert [fit.sds[n] for n in "abc"] == pytest.approx(np.sqrt(np.diag(cov)), rel=1e-6)
    at = {"u": [0.3, 5.0], "v": [-1.0, 7.0]}  # a place between the points, and one far away
    rows = np.column_stack([at["u"], at["v"], np.ones(2)])
    predicted = fit.predict(at)
    assert fit(at) == pytest.approx(rows @ best)
    assert predicted.u == pytest.approx(np.sqrt(np.einsum("ni,ij,nj->n", rows, cov, rows)))
    assert pickle.loads(pickle.dumps(fit))(at) == pytest.approx(rows @ best)


def test_a_column_of_a_data_frame_is_one_abscissa() -> None:
    frame = pd.DataFrame({"x": U, "y": 2.0 * U + noise(0.2)}, index=[f"row {i}" for i in U])
    fit = fit_curve("a*x + b", frame["x"], frame["y"], u_y=0.2)
    same = fit_curve("a*x + b", U, frame["y"].to_numpy(), u_y=0.2)
    assert fit.values == same.values
    assert fit(frame["x"]) == pytest.approx(same(U))
    assert fit(U.reshape(8, 9)).shape == (8, 9)
    joint = fit_curves("a*x + b", {"one": DataSet(frame["x"], frame["y"], 0.2)})
    assert joint.values["a"] == pytest.approx(same.values["a"])


def test_a_wrong_surface_is_refused() -> None:
    z = 2.0 * U - V + 0.5 + 0.15 * U * V + noise(0.2)
    assert fit_curve("a*u + b*v + c", BOTH, z, u_y=0.2).status == "poor-fit"
    assert fit_curve("a*u + b*v + c + d*u*v", BOTH, z, u_y=0.2).status.ok


def test_a_function_gets_the_abscissas_as_they_were_given() -> None:
    z, start = 2.0 * U - V + noise(0.2), {"a": 1.0, "b": 1.0}
    of_mapping = fit_curve(lambda at, a, b: a * at["u"] + b * at["v"], BOTH, z, start=start)
    of_array = fit_curve(lambda at, a, b: a * at[0] + b * at[1], np.array([U, V]), z, start=start)
    of_formula = fit_curve("a*u + b*v", BOTH, z)
    for fit in (of_mapping, of_array):
        assert list(fit.values.values()) == pytest.approx(list(of_formula.values.values()))
    assert of_array(np.array([[1.0], [2.0]])) == pytest.approx(of_mapping({"u": [1], "v": [2]}))


def test_ties_robust_errors_and_joint_fits_take_them() -> None:
    z = 2.0 * U - V + 0.5 + noise(0.2)
    tied = fit_curve("a*u + b*v + c", BOTH, z, u_y=0.2, tied={"b": "-a/2"})
    assert tied.values["a"] == pytest.approx(2.0, abs=4.0 * tied.sds["a"])
    assert tied({"u": [1.0], "v": [1.0]}) == pytest.approx(
        0.5 * tied.values["a"] + tied.values["c"]
    )
    z[5] += 9.0
    robust = fit_curve("a*u + b*v + c", BOTH, z, u_y=0.2, robust="mixture")
    assert robust.status.ok
    assert robust.values["a"] == pytest.approx(2.0, abs=4.0 * robust.sds["a"])
    plane, line = DataSet(BOTH, z - 9.0 * (np.arange(U.size) == 5), 0.2), DataSet(U, 2.0 * U, 0.2)
    joint = fit_curves(
        "a*u + b*v + c", {"plane": plane, "line": DataSet(line.x, line.y, 0.2, curve="a*x")}
    )
    assert set(joint.names) == {"a", "b", "c"}
    assert joint.sds["a"] < tied.sds["a"]
    assert joint({"u": [1.0], "v": [0.0]}, data="plane") == pytest.approx(
        joint.values["a"] + joint.values["c"]
    )
    assert joint([3.0], data="line") == pytest.approx(3.0 * joint.values["a"])


def test_the_digest_of_the_data_is_that_of_all_abscissas() -> None:
    y = 2.0 * U - V + noise(0.2)
    target = Target(ess=400.0)
    told = set()
    for x in (BOTH, {"u": U, "v": 1.5 * V}):
        fit = fit_curve("a*u + b*v", x, y)
        analysis = sample_curve(fit, seed=1, target=target)
        report = curve_report(fit, analysis, title="A plane", kind="synthetic", figures="none")
        told.add(re.findall(rb"`\(arrays\)`, SHA-256 `(\w{64})`", report["report.md"])[0])
    assert len(told) == 2


@pytest.mark.slow
def test_nothing_is_said_of_an_axis_that_is_only_the_order_of_the_points() -> None:
    fit = fit_curve("a*u + b*v + c", BOTH, 2.0 * U - V + noise(0.2), u_y=0.2)
    assert fit.notes == ()
    analysis = sample_curve(fit, seed=1)
    assert analysis.diagnosis.status.ok
    assert [error.name for error in influences(fit.fit)] == ["scale_y"]


@pytest.mark.parametrize(
    ("curve", "x", "rest", "field", "words"),
    [
        ("a*u + b*w", BOTH, {}, "x", "'v', which is not in the formula"),
        ("a*u + b*v*x", BOTH, {}, "curve", r"none of its abscissas \(u, v\)"),
        ("a*u + b*v", {"u": U, "v": V[:3]}, {}, "x", "as many values of each"),
        ("a*u", {"u": U}, {}, "x", "at least two abscissas"),
        ("a*u + b*v", {"u": U, "v": V * np.nan}, {}, r"x\[v\]", "must be finite"),
        ("a*u + b*v", np.array([U, V]), {}, "x", "must map the names"),
        ("a*exp(b*u) + v", BOTH, {}, "start[b]", "needs a starting value"),
        ("a*u + b*v", BOTH, {"start": {"q": 1.0}}, "start", "'q', which is not in the formula"),
        ("a*u + b*v", BOTH, {"u_y": 0.1, "u_x": 0.1}, "u_x", "several abscissas"),
        ("a*u + b*v", BOTH, {"u_y": 0.1, "deviation": 0.1}, "deviation", "several abscissas"),
        ("a*u + b*v", BOTH, {"noise": EventTimes(0.0, 9.0)}, "noise", "several abscissas"),
    ],
)
def test_what_does_not_go_together_is_refused(
    curve: str, x: Any, rest: dict[str, Any], field: str, words: str
) -> None:
    with pytest.raises(InputError, match=words) as refused:
        fit_curve(curve, x, 2.0 * U - V, **rest)
    assert refused.value.field == field.replace("\\", "")


@pytest.mark.parametrize("x", [3.0, {"u": [1.0], "w": [1.0]}, np.ones((2, 3))])
def test_other_places_have_the_same_abscissas(x: Any) -> None:
    fit = fit_curve("a*u + b*v", BOTH, 2.0 * U - V + noise(0.2))
    with pytest.raises(InputError, match=r"must hold the abscissas of the fit \(u, v\)"):
        fit(x)
    with pytest.raises(InputError, match="along one axis"):
        fit_curve("a*x", U, 2.0 * U + noise(0.2))({"u": [1.0], "v": [2.0]})


def test_what_shared_does_not_name_is_a_data_sets_own() -> None:
    u = np.linspace(0.1, 10.0, 20)
    x, rng = {"u": u, "v": np.cos(u)}, np.random.default_rng(0)
    sets = {
        name: DataSet(x, 2.0 * u + x["v"] + c + 0.05 * rng.standard_normal(20), 0.05)
        for name, c in (("a", 5.0), ("b", 9.0))
    }
    fit = fit_curves("P*u + q*v + c", sets, shared=["P", "q"], derived={"d": "c[b] - c[a]"})
    assert fit.names == ("P", "q", "c[a]", "c[b]")
    assert fit.status == "ok"
    assert fit.derived["d"].value == pytest.approx(4.0, abs=4.0 * fit.derived["d"].sd)
    assert fit_curves("P*u + q*v + c", sets).status == "poor-fit"
