"""Examples of lmfit 1.3.4, its directory `examples` (BSD licence): the data are those that they make
or read, the lines are estim's.
"""

from __future__ import annotations

from typing import Any

import lmfit
import numpy as np
from cases import DATA, HERE, Numbers, example
from lmfit.lineshapes import gaussian as gauss_peak
from lmfit.lineshapes import lorentzian as lorentz_peak
from lmfit.lineshapes import step
from lmfit.models import (
    ExponentialModel,
    ExpressionModel,
    Gaussian2dModel,
    GaussianModel,
    LinearModel,
    LorentzianModel,
    StepModel,
    VoigtModel,
)

from estim import DataSet, fit_curve, fit_curves

PEAK_X, PEAK_Y = np.loadtxt(DATA / "gauss1d.csv", delimiter=",", skiprows=1, unpack=True)
VOIGT_X, VOIGT_Y = np.loadtxt(DATA / "voigt_peak.csv", delimiter=",", skiprows=1, unpack=True)
NIST_Y, NIST_X = np.loadtxt(
    HERE.parents[1] / "tests/reference/nist_strd/Gauss2.dat", skiprows=60, unpack=True
)


def of_lmfit(result: Any, *names: str, **renamed: str) -> Numbers:
    """estim's name -> what lmfit says of the parameter of that name, or of the name given."""
    called = {name: name for name in names} | renamed
    params = result.params
    return {
        ours: (float(params[name].value), float(params[name].stderr))
        for ours, name in called.items()
    }


def minimized(residual: Any, **params: Any) -> Any:
    return lmfit.minimize(residual, lmfit.create_params(**params))


# --- a decaying sine

SINE_X = np.linspace(0, 15, 301)
SINE_Y = 5.0 * np.sin(2.0 * SINE_X - 0.1) * np.exp(
    -SINE_X * SINE_X * 0.025
) + np.random.RandomState(2021).normal(size=301, scale=0.2)


def lmfit_decaying_sine() -> Numbers:
    def residual(p: Any) -> Any:
        wave = np.sin(SINE_X * p["omega"] + p["shift"])
        return p["amp"] * wave * np.exp(-SINE_X * SINE_X * p["decay"]) - SINE_Y

    shift = {"value": 0, "min": -np.pi / 2, "max": np.pi / 2}
    fit = minimized(residual, amp={"value": 10, "min": 0}, decay=0.1, omega=3, shift=shift)
    return of_lmfit(fit, "amp", "decay", "shift", "omega")


@example(
    "lmfit", "doc_parameters_basic.py", "limits, errors from the residuals", run=lmfit_decaying_sine
)
def decaying_sine() -> Any:
    return fit_curve(
        "amp*sin(omega*x + shift)*exp(-decay*x**2)", SINE_X, SINE_Y,
        bounds={"amp": (0, None), "shift": (-np.pi / 2, np.pi / 2), "omega": (0, None)},
    )  # fmt: skip


# --- one peak


def lmfit_gaussian() -> Numbers:
    fit = GaussianModel().fit(PEAK_Y, x=PEAK_X, amplitude=5, center=5, sigma=1)
    return of_lmfit(fit, "amplitude", "center", "sigma")


@example("lmfit", "doc_model_gaussian.py", "a peak", run=lmfit_gaussian)
def gaussian() -> Any:
    return fit_curve("gaussian", PEAK_X, PEAK_Y)


def lmfit_two_components() -> Numbers:
    model = GaussianModel() + LinearModel()
    start = {"amplitude": 5, "center": 5, "sigma": 1, "slope": 0, "intercept": 1}
    fit = model.fit(PEAK_Y + 0.25 * PEAK_X - 1.0, x=PEAK_X, **start)
    return of_lmfit(fit, *start)


@example("lmfit", "doc_model_two_components.py", "a sum of two models", run=lmfit_two_components)
def two_components() -> Any:
    return fit_curve("gaussian + line", PEAK_X, PEAK_Y + 0.25 * PEAK_X - 1.0)


def lmfit_missing_points() -> Numbers:
    y = PEAK_Y.copy()
    y[[44, 65]] = np.nan
    fit = GaussianModel().fit(y, x=PEAK_X, amplitude=5, center=6, sigma=1, nan_policy="omit")
    return of_lmfit(fit, "amplitude", "center", "sigma")


@example("lmfit", "doc_model_with_nan_policy.py", "points without a value", run=lmfit_missing_points,
         why="In Python estim refuses y that is not a number, so that one line leaves such points out; "
         "a table with empty cells needs no such line.")  # fmt: skip
def missing_points() -> Any:
    y = PEAK_Y.copy()
    y[[44, 65]] = np.nan
    there = np.isfinite(y)
    return fit_curve("gaussian", PEAK_X[there], y[there])


def lmfit_peak(model: Any, **vary: bool) -> Numbers:
    params = model.guess(VOIGT_Y, x=VOIGT_X)
    for name in vary:
        params[name].set(vary=True, expr="", value=0.7)
    fit = model.fit(VOIGT_Y, params, x=VOIGT_X)
    return of_lmfit(fit, "amplitude", "center", "sigma", *vary)


@example("lmfit", "doc_builtinmodels_peakmodels.py, Gaussian", "a peak",
         run=lambda: lmfit_peak(GaussianModel()))  # fmt: skip
def peak_gaussian() -> Any:
    return fit_curve("gaussian", VOIGT_X, VOIGT_Y)


@example("lmfit", "doc_builtinmodels_peakmodels.py, Lorentzian", "a peak",
         run=lambda: lmfit_peak(LorentzianModel()))  # fmt: skip
def peak_lorentzian() -> Any:
    return fit_curve("lorentzian", VOIGT_X, VOIGT_Y)


@example("lmfit", "doc_builtinmodels_peakmodels.py, Voigt", "a parameter tied to another",
         run=lambda: lmfit_peak(VoigtModel()))  # fmt: skip
def peak_voigt() -> Any:
    return fit_curve("voigt", VOIGT_X, VOIGT_Y, tied={"gamma": "sigma"})


@example("lmfit", "doc_builtinmodels_peakmodels.py, Voigt with its own gamma", "a peak",
         run=lambda: lmfit_peak(VoigtModel(), gamma=True))  # fmt: skip
def peak_voigt_gamma() -> Any:
    return fit_curve("voigt", VOIGT_X, VOIGT_Y)


# --- NIST Gauss2

NIST_START = {
    "g1_center": 105, "g1_amplitude": 4000, "g1_sigma": 15, "g2_center": 155,
    "g2_amplitude": 2000, "g2_sigma": 15, "exp_amplitude": 100, "exp_decay": 100,
}  # fmt: skip


def lmfit_nist() -> Any:
    model = (
        GaussianModel(prefix="g1_") + GaussianModel(prefix="g2_") + ExponentialModel(prefix="exp_")
    )
    params = model.make_params(**NIST_START)
    params.add("area", expr="g1_amplitude + g2_amplitude")
    params.add("centroid", expr="(g1_amplitude*g1_center + g2_amplitude*g2_center)/area")
    return model.fit(NIST_Y, params, x=NIST_X)


@example("lmfit", "doc_builtinmodels_nistgauss2.py", "two peaks over an exponential",
         run=lambda: of_lmfit(lmfit_nist(), *NIST_START))  # fmt: skip
def nist_gauss2() -> Any:
    return fit_curve("g1_gaussian + g2_gaussian + exp_exponential", NIST_X, NIST_Y)


@example("lmfit", "doc_parameters_uvars.py", "what follows from the parameters, with correlations",
         run=lambda: of_lmfit(lmfit_nist(), "area", "centroid"))  # fmt: skip
def derived_quantities() -> Any:
    area = "g1_amplitude + g2_amplitude"
    centroid = "(g1_amplitude*g1_center + g2_amplitude*g2_center)/area"
    return fit_curve(
        "g1_gaussian + g2_gaussian + exp_exponential",
        NIST_X,
        NIST_Y,
        derived={"area": area, "centroid": centroid},
    )


def lmfit_band() -> Numbers:
    fit = lmfit_nist()
    half = fit.eval_uncertainty(sigma=1)
    return {f"y({NIST_X[i]:g})": (float(fit.best_fit[i]), float(half[i])) for i in (50, 106, 200)}


@example("lmfit", "doc_model_uncertainty2.py", "the band of a fitted curve", run=lmfit_band)
def band() -> Any:
    fit = fit_curve("g1_gaussian + g2_gaussian + exp_exponential", NIST_X, NIST_Y)
    curve = fit.predict(NIST_X[[50, 106, 200]])
    return {f"y({x:g})": (v, u) for x, v, u in zip(curve.x, curve.value, curve.u, strict=True)}


# --- a step

STEP_X = np.linspace(0, 10, 201)
STEP_Y = np.ones(201)
STEP_Y[:48] = 0.0
STEP_Y[48:77] = np.arange(77 - 48) / (77.0 - 48)
STEP_Y = 110.2 * (STEP_Y + 9e-3 * np.random.RandomState(0).randn(201)) + 12.0 + 2.22 * STEP_X


def lmfit_step() -> Numbers:
    model = StepModel(form="erf") + LinearModel()
    start = {"amplitude": 110, "center": 2.5, "sigma": 1, "slope": 0, "intercept": 12}
    return of_lmfit(model.fit(STEP_Y, x=STEP_X, **start), *start)


@example("lmfit", "doc_builtinmodels_stepmodel.py", "a step over a line", run=lmfit_step)
def step_and_line() -> Any:
    return fit_curve(
        "amplitude*(1 + erf((x - center)/sigma))/2 + slope*x + intercept",
        STEP_X,
        STEP_Y,
        bounds={"sigma": (0, None)},
    )


FOLD_Y = step(STEP_X, amplitude=12.5, center=4.5, sigma=0.88, form="erf") + np.random.RandomState(
    0
).normal(scale=0.35, size=201)


def folded(x: Any, amplitude: Any, center: Any, sigma: Any) -> Any:
    """A jump at x = 4, convolved with a Gaussian on the grid of x, as in the example."""
    jump = np.zeros(x.size)
    jump[max(np.where(x <= 4)[0]) :] = 1.0
    edge = np.ones(x.size)
    padded = np.concatenate((edge * jump[0], jump, edge * jump[-1]))
    out = np.convolve(padded, gauss_peak(x, amplitude, center, sigma), mode="valid")
    begin = int((len(out) - x.size) / 2)
    return out[begin : begin + x.size]


def lmfit_composite() -> Numbers:
    start = {"amplitude": 1, "center": 3.5, "sigma": 1.5}
    return of_lmfit(lmfit.Model(folded).fit(FOLD_Y, x=STEP_X, **start), *start)


@example(
    "lmfit", "doc_model_composite.py", "a convolution: a function of Python", run=lmfit_composite
)
def composite() -> Any:
    return fit_curve(
        folded, STEP_X, FOLD_Y, start={"amplitude": 1, "center": 3.5, "sigma": 1.5},
        bounds={"amplitude": (0, None), "sigma": (0.01, None)},
    )  # fmt: skip


# --- intervals

HYPER_X = np.linspace(0.3, 10, 100)
HYPER_Y = 1 / (0.1 * HYPER_X) + 2 + 0.1 * np.random.RandomState(0).randn(100)


def lmfit_confidence() -> Numbers:
    fit = minimized(lambda p: 1 / (p["a"] * HYPER_X) + p["b"] - HYPER_Y, a=0.1, b=1)
    return of_lmfit(fit, "a", "b")


@example("lmfit", "doc_confidence_basic.py", "confidence intervals", run=lmfit_confidence)
def confidence() -> Any:
    return fit_curve("1/(a*x) + b", HYPER_X, HYPER_Y)


TWO_X = np.linspace(1, 10, 250)
TWO_Y = (
    3.0 * np.exp(-TWO_X / 2)
    - 5.0 * np.exp(-(TWO_X - 0.1) / 10.0)
    + 0.1 * np.random.RandomState(0).randn(250)
)


def lmfit_two_exponentials() -> Numbers:
    def residual(p: Any) -> Any:
        first = p["a1"] * np.exp(-TWO_X / p["t1"])
        return first + p["a2"] * np.exp(-(TWO_X - 0.1) / p["t2"]) - TWO_Y

    return of_lmfit(minimized(residual, a1=3, a2=-5, t1=2, t2=10), "a1", "a2", "t1", "t2")


@example("lmfit", "doc_confidence_advanced.py", "two exponentials", run=lmfit_two_exponentials)
def two_exponentials() -> Any:
    return fit_curve(
        "a1*exp(-x/t1) + a2*exp(-(x - 0.1)/t2)",
        TWO_X,
        TWO_Y,
        start={"a1": 4, "a2": -4, "t1": 3, "t2": 9},
    )


LONG_X = np.linspace(0.0, 250.0, 1001)
LONG_Y = 14.0 * np.sin(0.123 + LONG_X / 5.46) * np.exp(
    -(LONG_X**2) * 0.032**2
) + np.random.RandomState(0).normal(scale=0.7215, size=1001)


def lmfit_report() -> Numbers:
    def residual(p: Any) -> Any:
        wave = np.sin(p["shift"] + LONG_X / p["period"])
        return p["amp"] * wave * np.exp(-(LONG_X**2) * p["decay"] ** 2) - LONG_Y

    fit = minimized(residual, amp=13, period=5.3, shift=0, decay=0.02)
    return of_lmfit(fit, "amp", "period", "shift", "decay")


@example(
    "lmfit", "doc_fitting_withreport.py", "a start far off (period 2 for 5.46)", run=lmfit_report
)
def far_start() -> Any:
    return fit_curve(
        "amp*sin(shift + x/period)*exp(-x**2*decay**2)", LONG_X, LONG_Y,
        start={"amp": 13, "period": 2, "shift": 0, "decay": 0.02}, bounds={"decay": (0, None), "period": (0, None)},
    )  # fmt: skip


# --- expressions, ties, inequalities

WORD_X = np.linspace(-10, 10, 201)
WORD_Y = gauss_peak(WORD_X, 3.4, 1.8, 0.5) + np.random.RandomState(2021).normal(
    size=201, scale=0.01
)
WORDS = "amp*exp(-(x - cen)**2/(2*wid**2))/(sqrt(2*pi)*wid)"


@example("lmfit", "example_expression_model.py", "a curve as text",
         run=lambda: of_lmfit(ExpressionModel(WORDS).fit(WORD_Y, x=WORD_X, amp=5, cen=5, wid=1), "amp", "cen", "wid"))  # fmt: skip
def expression() -> Any:
    return fit_curve(
        "amp*exp(-(x - cen)**2/(2*wid**2))/(sqrt(2*pi)*wid)",
        WORD_X,
        WORD_Y,
        bounds={"wid": (0, None)},
    )


PAIR_X = np.linspace(0.0, 20.0, 601)
PAIR_Y = (
    gauss_peak(PAIR_X, 21, 8.1, 1.2)
    + lorentz_peak(PAIR_X, 10, 9.6, 2.4)
    + 0.01
    + PAIR_X * 0.05
    + np.random.RandomState(0).normal(scale=0.23, size=601)
)


def lmfit_algebraic() -> Numbers:
    model = GaussianModel(prefix="g_") + LorentzianModel(prefix="l_") + LinearModel()
    params = model.make_params(g_amplitude=10, g_center=9, g_sigma=1, slope=0, intercept=0)
    params.add(name="total", value=20)
    params.set(l_amplitude={"expr": "total - g_amplitude"})
    params.set(l_center={"expr": "1.5+g_center"}, l_sigma={"expr": "2*g_sigma"})
    fit = model.fit(PAIR_Y, params, x=PAIR_X, weights=1 / 0.23, scale_covar=False)
    return of_lmfit(fit, "g_amplitude", "g_center", "g_sigma", "total", "slope", "intercept")


@example("lmfit", "example_fit_with_algebraic_constraint.py", "ties, one with a new parameter", run=lmfit_algebraic,
         why="The example states 0.021 for errors of 0.23, and lmfit rescales them by its default; "
         "estim would call that `poor-fit`. Here both have 0.23, and lmfit `scale_covar=False`.")  # fmt: skip
def algebraic_constraint() -> Any:
    return fit_curve(
        "g_gaussian + l_lorentzian + line", PAIR_X, PAIR_Y, u_y=0.23, start={"total": 20, "g_amplitude": 10},
        tied={"l_amplitude": "total - g_amplitude", "l_center": "1.5 + g_center", "l_sigma": "2*g_sigma"},
    )  # fmt: skip


SPLIT_Y = (
    gauss_peak(PAIR_X, 21, 6.1, 1.2)
    + lorentz_peak(PAIR_X, 10, 9.6, 1.3)
    + np.random.RandomState(0).normal(scale=0.1, size=601)
)


def lmfit_inequality() -> Numbers:
    def residual(p: Any) -> Any:
        peak = gauss_peak(PAIR_X, p["amp_g"], p["cen_g"], p["wid_g"])
        return peak + lorentz_peak(PAIR_X, p["amp_l"], p["cen_l"], p["wid_l"]) - SPLIT_Y

    fit = minimized(
        residual, amp_g=10, cen_g=5, wid_g=1, amp_l=10, split={"value": 2.5, "min": 0, "max": 5},
        cen_l={"expr": "split+cen_g"}, wid_l={"expr": "wid_g"},
    )  # fmt: skip
    names = {"g_amplitude": "amp_g", "g_center": "cen_g", "g_sigma": "wid_g"}
    return of_lmfit(fit, "split", l_amplitude="amp_l", l_center="cen_l", **names)


@example(
    "lmfit",
    "example_fit_with_inequality.py",
    "one parameter at most 5 above another",
    run=lmfit_inequality,
)
def inequality() -> Any:
    return fit_curve(
        "g_gaussian + l_lorentzian", PAIR_X, SPLIT_Y, start={"split": 2.5}, bounds={"split": (0, 5)},
        tied={"l_center": "g_center + split", "l_sigma": "g_sigma"},
    )  # fmt: skip


# --- several data sets, errors of x


def five_peaks() -> tuple[Any, Any]:
    random = np.random.RandomState(2021)
    x, sets = np.linspace(-1, 2, 151), []
    for _ in range(5):
        amp, cen, sig = (
            0.60 + 9.50 * random.rand(),
            -0.20 + 1.20 * random.rand(),
            0.25 + 0.03 * random.rand(),
        )
        sets.append(
            amp * np.exp(-((x - cen) ** 2) / (2.0 * sig**2)) + random.normal(size=151, scale=0.1)
        )
    return x, sets


def lmfit_several() -> Numbers:
    x, sets = five_peaks()

    def residual(p: Any) -> Any:
        return np.concatenate(
            [
                p[f"a{i}"] * np.exp(-((x - p[f"c{i}"]) ** 2) / (2 * p["sig"] ** 2)) - y
                for i, y in enumerate(sets)
            ]
        ) / 0.1  # fmt: skip

    params = lmfit.create_params(
        sig=0.3, **{f"a{i}": 0.5 for i in range(5)}, **{f"c{i}": 0.4 for i in range(5)}
    )
    fit = lmfit.minimize(residual, params, scale_covar=False)
    named = {f"amp[{i}]": f"a{i}" for i in range(5)} | {f"cen[{i}]": f"c{i}" for i in range(5)}
    return of_lmfit(fit, "sig", **named)


@example("lmfit", "example_fit_multi_datasets.py", "five data sets with one width", run=lmfit_several, slow=True,
         why="The example states no errors, and lmfit takes one size for all; estim asks for those of every data set "
         "(0.1, with which they were made), and lmfit has them here too.")  # fmt: skip
def several_sets() -> Any:
    x, sets = five_peaks()
    data = {str(i): DataSet(x, y, u_y=0.1) for i, y in enumerate(sets)}
    return fit_curves(
        "amp*exp(-(x - cen)**2/(2*sig**2))", data, shared=["sig"], start={"amp": 0.5, "cen": 0.4, "sig": 0.3},
        bounds={"amp": (0, 200), "cen": (-2, 2), "sig": (0.01, 3)},
    )  # fmt: skip


def with_errors_of_x() -> tuple[Any, Any]:
    random, true = np.random.RandomState(17), np.linspace(0, 50, 101)
    y = gauss_peak(true, 39, 28.2, 4.4) - 13 + 0.012 * true + random.normal(size=101, scale=0.1)
    return true + np.clip(random.normal(size=101, scale=0.05), -0.4, 0.4), y


def lmfit_errors_of_x() -> Numbers:
    x, y = with_errors_of_x()
    model = GaussianModel() + LinearModel()

    def residual(p: Any) -> Any:
        curve = model.eval(p, x=x)
        return (curve - y) / np.hypot(0.06, 0.5 * np.gradient(curve) / np.gradient(x))

    start = {"amplitude": 50, "center": 25, "sigma": 10, "slope": 1e-4, "intercept": -5}
    fit = lmfit.minimize(residual, model.make_params(**start), scale_covar=False)
    return of_lmfit(fit, *start)


@example("lmfit", "example_uncertainties_y_and_x.py", "errors of x and y", run=lmfit_errors_of_x, within=3, spread=1, slow=True,
         why="The example states errors ten times too large in x (0.5 for 0.05). lmfit's effective variance rewards a "
         "steep curve; estim integrates the true abscissas out, and calls errors of y that are too small `poor-fit`.")  # fmt: skip
def errors_of_x() -> Any:
    x, y = with_errors_of_x()
    return fit_curve("gaussian + line", x, y, u_x=0.5, u_y=0.06)


# --- of the gallery of examples


def lmfit_pandas() -> Numbers:
    model = LorentzianModel()
    x, y = VOIGT_X[::4], VOIGT_Y[::4]
    return of_lmfit(model.fit(y, model.guess(y, x=x), x=x), "amplitude", "center", "sigma")


@example("lmfit", "example_use_pandas.py", "a peak of a table", run=lmfit_pandas)
def table() -> Any:
    return fit_curve("lorentzian", VOIGT_X[::4], VOIGT_Y[::4])


BOUND_X = np.linspace(0, 250, 1500)
BOUND_Y = 14.0 * np.sin(0.12345 + BOUND_X / 5.4321) * np.exp(
    -((BOUND_X * 0.010) ** 2)
) + np.random.RandomState(0).normal(scale=2.8, size=1500)


def lmfit_bounds() -> Numbers:
    def residual(p: Any) -> Any:
        wave = np.sin(p["shift"] + BOUND_X / p["period"])
        return p["amp"] * wave * np.exp(-((BOUND_X * p["decay"]) ** 2)) - BOUND_Y

    fit = minimized(
        residual, amp={"value": 13, "max": 20, "min": 0}, period={"value": 5.4, "max": 10},
        shift={"value": 0.1, "max": np.pi / 2, "min": -np.pi / 2}, decay={"value": 0.02, "max": 0.1, "min": 0},
    )  # fmt: skip
    return of_lmfit(fit, "amp", "period", "shift", "decay")


@example("lmfit", "example_fit_with_bounds.py", "limits, a start far off", run=lmfit_bounds)
def bounds() -> Any:
    return fit_curve(
        "amp*sin(shift + x/period)*exp(-(x*decay)**2)", BOUND_X, BOUND_Y,
        start={"amp": 13, "period": 2, "shift": 0, "decay": 0.02},
        bounds={"amp": (0, 20), "period": (1, 10), "shift": (-np.pi/2, np.pi/2), "decay": (0, 0.1)},
    )  # fmt: skip


DERIV_X = np.linspace(0, 4, 50)
DERIV_Y = 2.5 * np.exp(-1.3 * DERIV_X) + 0.8 + 0.15 * np.random.RandomState(2021).normal(size=50)


def lmfit_derivatives() -> Numbers:
    fit = minimized(
        lambda p: p["a"] * np.exp(-p["b"] * DERIV_X) + p["c"] - DERIV_Y, a=10, b=10, c=10
    )
    return of_lmfit(fit, "a", "b", "c")


@example(
    "lmfit",
    "example_fit_with_derivfunc.py",
    "derivatives: those of a formula are exact",
    run=lmfit_derivatives,
)
def derivatives() -> Any:
    return fit_curve("a*exp(-b*x) + c", DERIV_X, DERIV_Y)


SYMPY_X = np.linspace(0, 10, 40)
SYMPY_Y = (
    2 * np.exp(-((SYMPY_X - 2) ** 2) / 2)
    + 3 * np.exp(-((SYMPY_X - 5) ** 2) / 2)
    + 5 * np.exp(-SYMPY_X / 4)
    + np.random.RandomState(1).randn(40) * 0.4
)
SYMPY = "A1*exp(-(x - xc1)**2/(2*sigma1**2)) + A2*exp(-(x - xc2)**2/(2*sigma2**2)) + B*exp(-x/xw)"


def lmfit_sympy() -> Numbers:
    model = ExpressionModel(SYMPY)
    params = model.make_params(A1=2, A2=3, sigma1=1, sigma2=1, xc1=2, xc2=5, xw=4, B=5)
    params["sigma2"].set(expr="sigma1")
    params["A2"].set(expr="1.5*A1")
    return of_lmfit(model.fit(SYMPY_Y, params, x=SYMPY_X), "A1", "sigma1", "xc1", "xc2", "B", "xw")


@example("lmfit", "example_sympy.py", "substitutions in a formula", run=lmfit_sympy)
def substitutions() -> Any:
    return fit_curve(
        SYMPY, SYMPY_X, SYMPY_Y, tied={"sigma2": "sigma1", "A2": "1.5*A1"},
        start={"A1": 2, "sigma1": 1, "xc1": 2, "xc2": 5, "xw": 4, "B": 5}, bounds={"sigma1": (0, None)},
    )  # fmt: skip


DECAY_X = np.linspace(0, 5, num=1000)
DECAY_Y = 7 * np.exp(-DECAY_X / 3) + np.random.RandomState(2021).randn(1000)


def lmfit_held(**fixed: float) -> Numbers:
    model = ExpressionModel("N*exp(-x/tau)")
    params = model.make_params(N=10, tau={"value": 1, "min": 0})
    for name, value in fixed.items():
        params[name].set(value=value, vary=False)
    return of_lmfit(model.fit(DECAY_Y, params, x=DECAY_X), *({"N", "tau"} - {*fixed}))


@example("lmfit", "example_Model_interface.py", "two parameters", run=lmfit_held)
def model_interface() -> Any:
    return fit_curve("N*exp(-x/tau)", DECAY_X, DECAY_Y)


@example(
    "lmfit",
    "example_Model_interface.py, N held fixed",
    "a parameter that is known",
    run=lambda: lmfit_held(N=7),
)
def held_fixed() -> Any:
    return fit_curve("N*exp(-x/tau)", DECAY_X, DECAY_Y, fixed={"N": 7})


# --- several abscissas, and complex values

_PEAK = np.random.RandomState(2021)
PEAK_U, PEAK_V = _PEAK.rand(10000) * 10 - 4, _PEAK.rand(10000) * 5 - 3
PEAK_Z = lmfit.lineshapes.gaussian2d(PEAK_U, PEAK_V, 30, 2, -0.5, 0.6, 0.8)
PEAK_Z += 2 * (_PEAK.rand(10000) - 0.5)


def lmfit_peak_of_two() -> Numbers:
    model = Gaussian2dModel()
    fit = model.fit(PEAK_Z, model.guess(PEAK_Z, PEAK_U, PEAK_V), x=PEAK_U, y=PEAK_V)
    return of_lmfit(fit, "amplitude", "centerx", "centery", "sigmax", "sigmay")


@example(
    "lmfit",
    "example_two_dimensional_peak.py",
    "two abscissas",
    run=lmfit_peak_of_two,
    slow=True,
    why="The example weighs the points by random numbers, 1/√(z + 1); here both programs weigh all alike.",
)
def peak_of_two() -> Any:
    return fit_curve(
        "amplitude/(2*pi*sigmax*sigmay)*exp(-((x-centerx)/sigmax)**2/2 - ((y-centery)/sigmay)**2/2)",
        {"x": PEAK_U, "y": PEAK_V}, PEAK_Z,
        start={"centerx": 1, "centery": 0, "sigmax": 1, "sigmay": 1},
        bounds={"sigmax": (0, None), "sigmay": (0, None)},
    )  # fmt: skip


S21_F = np.linspace(99.95, 100.05, 100)
_S21 = np.random.RandomState(123)


def resonator(f: Any, f_0: Any, Q: Any, Q_e_real: Any, Q_e_imag: Any) -> Any:
    return 1 - Q / (Q_e_real + 1j * Q_e_imag) / (1 + 2j * Q * (f - f_0) / f_0)


S21 = resonator(S21_F, 100, 10000, 9000, -9000)
S21 = S21 + 0.02 * (_S21.randn(100) + 1j * _S21.randn(100))


def lmfit_resonator() -> Numbers:
    model = lmfit.Model(resonator)
    params = model.make_params(f_0=100.001, Q=5000, Q_e_real=8000, Q_e_imag=0)
    return of_lmfit(model.fit(S21, params, f=S21_F), "f_0", "Q", "Q_e_real", "Q_e_imag")


@example(
    "lmfit",
    "example_complex_resonator_model.py",
    "complex values",
    run=lmfit_resonator,
    within=0.1,
    spread=0.05,
    why="lmfit's derivatives are rough differences: the sum of squares is 0.0853405 at its values, 0.0853364 at estim's.",
)
def complex_resonator() -> Any:
    return fit_curve(
        resonator, S21_F, S21, start={"f_0": 100.001, "Q": 5000, "Q_e_real": 8000, "Q_e_imag": 0}
    )
