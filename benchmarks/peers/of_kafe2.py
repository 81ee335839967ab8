"""Examples of kafe2 2.11.0, its directory `examples` (GPL; the measured values alone are taken from
there).  Data that an example draws at random are drawn here with a seed.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from cases import DATA, Numbers, example

from estim import (
    Component,
    DataSet,
    EventTimes,
    Input,
    Poisson,
    fit_curve,
    fit_curves,
    propagate_linear,
)

X_ERRORS = (
    "kafe2 turns errors of x into errors of y by the slope of the curve; "
    "estim integrates the true abscissas out, under a normal distribution of them."
)


def of_kafe2(fit: Any) -> Numbers:
    fit.do_fit()
    rows = zip(fit.parameter_names, fit.parameter_values, fit.parameter_errors, strict=True)
    return {n: (float(v), float(e)) for n, v, e in rows if e > 0}


def xy_fit(x: Any, y: Any, model: Any, u_x: Any = None, u_y: Any = None, **options: Any) -> Any:
    from kafe2 import XYFit

    fit = XYFit([x, y], model, **options)
    for axis, u in (("x", u_x), ("y", u_y)):
        if u is not None:
            fit.add_error(axis, u)
    return fit


# --- lines and exponentials

LINE_X, LINE_Y = [1.0, 2.0, 3.0, 4.0], [2.3, 4.2, 7.5, 9.4]


def kafe2_line() -> Numbers:
    def model(x: Any, slope: float = 1.0, intercept: float = 0.0) -> Any:
        return slope * x + intercept

    return of_kafe2(xy_fit(LINE_X, LINE_Y, model, 0.1, 0.4))


@example(
    "kafe2",
    "001_line_fit/line_fit.py",
    "errors of x and y",
    run=kafe2_line,
    within=0.1,
    spread=0.1,
    why=X_ERRORS,
)
def line() -> Any:
    return fit_curve("line", LINE_X, LINE_Y, u_x=0.1, u_y=0.4)


GROW_X = [0.38112870, 0.83863144, 1.96570121, 2.82368929, 4.28311618, 4.69787499, 5.97143846,
          7.60855804, 7.62988103, 8.81892470, 9.87390396, 10.91359057]  # fmt: skip
GROW_Y = [1.60452123, 1.66605787, 2.12515048, 3.05188384, 3.57901206, 4.65414813, 6.21371192,
          7.57698153, 8.27444060, 10.79536623, 14.27240419, 18.48681514]  # fmt: skip


def kafe2_exponential() -> Numbers:
    def model(x: Any, A_0: float = 1.0, x_0: float = 5.0) -> Any:
        return A_0 * np.exp(x / x_0)

    return of_kafe2(xy_fit(GROW_X, GROW_Y, model, 0.3, 0.05 * np.array(GROW_Y)))


@example("kafe2", "002_model_functions/model_functions.py", "errors of x, errors of y in per cent of the data",
         run=kafe2_exponential, within=0.5, spread=0.15, why=X_ERRORS)  # fmt: skip
def exponential() -> Any:
    return fit_curve("A_0*exp(x/x_0)", GROW_X, GROW_Y, u_x=0.3, u_y=0.05 * np.array(GROW_Y))


FALL_X = [
    0.8018943,
    1.839664,
    1.941974,
    1.276013,
    2.839654,
    3.488302,
    3.775855,
    4.555187,
    4.477186,
    5.376026,
]
FALL_Y = [0.2650644, 0.1472682, 0.08077234, 0.1850181, 0.05326301, 0.01984233, 0.01866309, 0.01230001, 0.009694612, 0.002412357]  # fmt: skip


def kafe2_decay() -> Numbers:
    def model(x: Any, A_0: float = 1.0, tau: float = 1.0) -> Any:
        return A_0 * np.exp(-x / tau)

    return of_kafe2(xy_fit(FALL_X, FALL_Y, model, 0.3, 0.4 * np.array(FALL_Y)))


@example("kafe2", "003_profiling/01_non_linear_fit.py", "errors of x and y, asymmetric intervals",
         run=kafe2_decay, within=0.5, spread=0.25, why=X_ERRORS)  # fmt: skip
def decay() -> Any:
    return fit_curve("A_0*exp(-x/tau)", FALL_X, FALL_Y, u_x=0.3, u_y=0.4 * np.array(FALL_Y))


# --- double slit

THETA = [-0.044, -0.040, -0.036, -0.030, -0.024, -0.018, -0.012, -0.008, -0.004, -0.001, 0.004, 0.008,
         0.012, 0.018, 0.024, 0.030, 0.036, 0.040, 0.044]  # fmt: skip
LIGHT = [0.06, 0.07, 0.03, 0.04, 0.32, 0.03, 0.64, 0.08, 0.20, 1.11, 0.52, 0.07, 0.89, 0.01, 0.17, 0.05, 0.09, 0.02, 0.01]  # fmt: skip
U_LIGHT = [0.02, 0.02, 0.02, 0.02, 0.04, 0.02, 0.05, 0.03, 0.05, 0.08, 0.05, 0.03, 0.05, 0.01, 0.04, 0.03, 0.03, 0.02, 0.01]  # fmt: skip


def kafe2_double_slit() -> Numbers:
    def model(x: Any, I_0: float = 1.0, b: float = 20.0, g: float = 50.0) -> Any:
        arg = np.pi * np.sin(x) / 0.6471
        return I_0 * np.sinc(b * np.sin(x) / 0.6471) ** 2 * np.cos(g * arg) ** 2

    fit = xy_fit(THETA, LIGHT, model, 0.002, U_LIGHT)
    for name in ("I_0", "b", "g"):
        fit.limit_parameter(name, lower=1e-8)
    return of_kafe2(fit)


@example("kafe2", "003_profiling/02_double_slit.py", "errors of x, limits, a constant that is known", run=kafe2_double_slit,
         within=3, spread=1, why=X_ERRORS + " The fringes are curved over 0.002 rad, so that the slope is a poor guide. "
         "Lengths are in µm.")  # fmt: skip
def double_slit() -> Any:
    arm = "pi*sin(x)/wavelength"
    return fit_curve(
        f"I_0*(sin(b*{arm})/(b*{arm}))**2*cos(g*{arm})**2", THETA, LIGHT, u_x=0.002, u_y=U_LIGHT,
        start={"I_0": 1, "b": 20, "g": 50}, fixed={"wavelength": 0.6471},
        bounds={"I_0": (0, None), "b": (0, None), "g": (0, None)},
    )  # fmt: skip


# --- constraints

SWING_T, SWING_Y = np.loadtxt(DATA / "pendulum.csv", delimiter=",", skiprows=1, unpack=True)


def kafe2_pendulum() -> Numbers:
    def model(
        t: Any,
        y_0: float = 0.6,
        l: float = 10.0,
        r: float = 0.052,
        g: float = 9.81,
        c: float = 0.01,
    ) -> Any:
        omega = np.sqrt(g / (l + r) - c**2)
        return y_0 * np.exp(-c * t) * (np.cos(omega * t) + c / omega * np.sin(omega * t))

    fit = xy_fit(SWING_T, SWING_Y, model, 0.001, 0.01)
    fit.add_parameter_constraint("l", 10.0, 0.001)
    fit.add_parameter_constraint("r", 0.052, 0.001)
    fit.add_parameter_constraint("y_0", 0.6, 0.01, relative=True)
    fit.limit_parameter("g", 9.71, 9.91)
    fit.limit_parameter("c", 1e-6, 0.87)
    return of_kafe2(fit)


@example("kafe2", "004_constraints/constraints.py", "three measured parameters, limits, errors of x", run=kafe2_pendulum,
         within=0.05, spread=0.03, slow=True, why=X_ERRORS)  # fmt: skip
def pendulum() -> Any:
    w = "sqrt(g/(l + r) - c**2)"
    return fit_curve(
        f"y_0*exp(-c*x)*(cos({w}*x) + c/{w}*sin({w}*x))", SWING_T, SWING_Y, u_x=0.001, u_y=0.01,
        priors={"l": "10.000(1)", "r": "0.052(1)", "y_0": "0.600(6)"}, bounds={"g": (9.71, 9.91), "c": (0, 0.87)},
        start={"l": 10, "r": 0.052, "y_0": 0.6, "g": 9.81, "c": 0.01},
    )  # fmt: skip


# --- covariance matrices and components of errors

W_MASS = [80.429, 80.339, 80.217, 80.449, 80.477, 80.310, 80.324, 80.353]
W_COV = np.diag(np.array([0.055, 0.073, 0.068, 0.058, 0.069, 0.091, 0.078, 0.068]) ** 2)
W_COV += np.block([[np.full((4, 4), 0.021**2), np.full((4, 4), 0.025**2)],
                   [np.full((4, 4), 0.025**2), np.full((4, 4), 0.044**2)]])  # fmt: skip


def kafe2_w_mass() -> Numbers:
    from kafe2 import IndexedFit

    def model(c: float = 80.0) -> Any:
        return np.full(8, c)

    fit = IndexedFit(W_MASS, model)
    fit.add_matrix_error(W_COV, "cov")
    return of_kafe2(fit)


@example(
    "kafe2",
    "006_advanced_errors/01_covariance_matrix.py",
    "a mean with a covariance matrix",
    run=kafe2_w_mass,
)
def w_mass() -> Any:
    return fit_curve("constant", np.arange(8), W_MASS, cov_y=W_COV)


LEP_E = [88.387, 89.437, 90.223, 91.238, 92.059, 93.004, 93.916]
LEP_U_E = [0.005, 0.0015, 0.005, 0.003, 0.005, 0.0015, 0.005]
LEP_S = [6.803, 13.965, 26.113, 41.364, 27.535, 13.362, 7.302]
LEP_U_S = [0.036, 0.013, 0.075, 0.010, 0.088, 0.015, 0.045]


def kafe2_resonance() -> Numbers:
    def model(E: Any, s0: float = 41.0, M: float = 91.2, G: float = 2.5) -> Any:
        return s0 * E**2 * G**2 / ((E**2 - M**2) ** 2 + E**4 * G**2 / M**2)

    fit = xy_fit(LEP_E, LEP_S, model, LEP_U_E, LEP_U_S)
    fit.add_error("x", 0.0017, correlation=1.0)
    fit.add_error("y", 0.0007, correlation=1.0, relative=True)
    return of_kafe2(fit)


@example("kafe2", "006_advanced_errors/02_error_components.py", "errors of x, and errors that all points share",
         run=kafe2_resonance, within=0.6, spread=0.06, why=X_ERRORS + " The relative error is of the curve in estim, of the data in kafe2.")  # fmt: skip
def resonance() -> Any:
    return fit_curve(
        "s0*x**2*G**2/((x**2 - M**2)**2 + x**4*G**2/M**2)", LEP_E, LEP_S, u_x=LEP_U_E, u_y=LEP_U_S,
        start={"s0": 41, "M": 91.2, "G": 2.5}, errors=[Component("zero_x", 0.0017), Component("scale_y", 0.0007)],
    )  # fmt: skip


SHARE_X, SHARE_Y = (
    [19.8, 3.0, 5.1, 16.1, 8.2, 11.7, 6.2, 10.1],
    [23.2, 3.2, 4.5, 19.9, 7.1, 12.5, 4.5, 7.2],
)


def kafe2_relative() -> Numbers:
    def model(x: Any, a: float = 1.0, b: float = 0.0) -> Any:
        return a * x + b

    fit = xy_fit(SHARE_X, SHARE_Y, model, 0.3)
    fit.add_error("y", 0.15, relative=True, reference="model")
    return of_kafe2(fit)


@example("kafe2", "006_advanced_errors/03_relative_uncertainties.py", "errors of y in per cent of the curve, errors of x",
         run=kafe2_relative, within=0.1, spread=0.2, why=X_ERRORS + " Standard deviations are from the expected "
         "information in estim, from the curvature at the best point in kafe2.")  # fmt: skip
def relative() -> Any:
    return fit_curve("a*x + b", SHARE_X, SHARE_Y, u_x=0.3, u_y="15%", start={"a": 1, "b": 0})


DIODE_U = [0.450, 0.470, 0.490, 0.510, 0.530, 0.550, 0.560, 0.570, 0.580, 0.590, 0.600, 0.610, 0.620, 0.630,
           0.640, 0.645, 0.650, 0.655, 0.660, 0.665]  # fmt: skip
DIODE_I = [0.056, 0.198, 0.284, 0.404, 0.739, 1.739, 1.962, 2.849, 3.265, 5.706, 6.474, 7.866, 11.44, 18.98,
           23.35, 27.96, 38.61, 46.73, 49.78, 57.75]  # fmt: skip
DIODE_U_I = np.hypot(2 * [0.0003] + 12 * [0.03] + 6 * [0.3], 0.05)


def kafe2_diode() -> Numbers:
    def model(U: Any, I_S: float = 0.5, U_0: float = 0.03) -> Any:
        return 1e-6 * I_S * np.exp(U / U_0 - 1.0)

    fit = xy_fit(DIODE_U, DIODE_I, model, np.hypot(0.0015, 0.005), DIODE_U_I)
    fit.add_error("x", 0.005, correlation=1.0, relative=True, reference="model")
    fit.add_error("y", 0.01, correlation=1.0, relative=True, reference="model")
    fit.limit_parameter("U_0", lower=0.005)
    return of_kafe2(fit)


@example("kafe2", "006_advanced_errors/04_shockley.py", "errors of x, calibrations in per cent that all points share",
         run=kafe2_diode, within=0.5, spread=0.3, why=X_ERRORS)  # fmt: skip
def diode() -> Any:
    return fit_curve(
        "1e-6*I_S*exp(x/U_0 - 1)", DIODE_U, DIODE_I, u_x=np.hypot(0.0015, 0.005), u_y=DIODE_U_I,
        start={"I_S": 0.5, "U_0": 0.03}, bounds={"U_0": (0.005, None)},
        errors=[Component("scale_x", 0.005), Component("scale_y", 0.01)],
    )  # fmt: skip


# --- counts

HISTOGRAM = np.loadtxt(DATA / "histogram.csv", skiprows=1)
EDGES = np.linspace(-5, 5, 11)


def kafe2_histogram() -> Numbers:
    from kafe2 import HistContainer, HistFit

    def model(x: Any, A: float = 100.0, mu: float = 0.0, sigma: float = 1.0) -> Any:
        return A * np.exp(-0.5 * ((x - mu) / sigma) ** 2) / np.sqrt(2.0 * np.pi * sigma**2)

    data = HistContainer(n_bins=10, bin_range=(-5, 5), fill_data=HISTOGRAM)
    return of_kafe2(HistFit(data, model, density=False))


@example("kafe2", "009_histogram_fit/02_absolute.py", "counts in bins", run=kafe2_histogram, within=0.02, spread=0.02,
         why="The values are those of histogram.yml beside it, for the example draws without a seed.")  # fmt: skip
def histogram() -> Any:
    counts = np.histogram(HISTOGRAM, EDGES)[0]
    return fit_curve(
        "A*exp(-((x - mu)/sigma)**2/2)/sqrt(2*pi*sigma**2)", (EDGES[1:] + EDGES[:-1])/2, counts, noise=Poisson(bins=EDGES),
        start={"A": 100, "mu": 0, "sigma": 1}, bounds={"sigma": (0.1, None)},
    )  # fmt: skip


MUONS = np.loadtxt(DATA / "muon_lifetimes.csv", skiprows=1)


def kafe2_lifetimes() -> Numbers:
    from kafe2 import Fit, UnbinnedContainer

    def pdf(t: Any, tau: float = 2.2, fbg: float = 0.1) -> Any:
        decays = np.exp(-t / tau) / tau / (np.exp(-1 / tau) - np.exp(-11.5 / tau))
        return (1 - fbg) * decays + fbg / 10.5

    fit = Fit(UnbinnedContainer(MUONS), pdf)
    fit.limit_parameter("fbg", 0.0, 1.0)
    return of_kafe2(fit)


@example("kafe2", "010_unbinned_fit/01_unbinned.py", "times of single events", run=kafe2_lifetimes, within=0.02, spread=0.04,
         why="kafe2's errors are from the second derivatives of the likelihood at its maximum, estim's from the Fisher "
         "information, which is their expectation; the intervals of both are profiles.")  # fmt: skip
def lifetimes() -> Any:
    decays = "exp(-x/tau)/tau/(exp(-1/tau) - exp(-11.5/tau))"
    return fit_curve(
        f"(1 - fbg)*{decays} + fbg/10.5", MUONS, None, noise=EventTimes(1, 11.5),
        start={"tau": 2.2, "fbg": 0.1}, bounds={"tau": (0.1, None), "fbg": (0, 1)},
    )  # fmt: skip


def few_signals() -> Any:
    random = np.random.RandomState(0)
    flat, peak = (
        random.uniform(low=0, high=20, size=3000),
        random.normal(loc=10.0, scale=1.0, size=50),
    )
    return np.histogram(np.concatenate((flat, peak)), bins=20, range=(0, 20))


def kafe2_few_signals() -> Numbers:
    from kafe2 import HistFit
    from scipy.stats import norm

    def model(
        x: Any, N_b: float = 3000.0, N_s: float = 30.0, mu: float = 10.0, sigma: float = 1.0
    ) -> Any:
        return N_b / 20 + N_s * norm.pdf(x, mu, sigma)

    fit = HistFit(few_signals(), model, density=False)
    fit.add_parameter_constraint("mu", 10.0, 1.0)
    fit.add_parameter_constraint("sigma", 1.0, 0.1)
    return of_kafe2(fit)


@example("kafe2", "003_profiling/04_one_sided_limit.py", "counts in bins, two measured parameters", run=kafe2_few_signals,
         within=0.05, spread=0.05)  # fmt: skip
def few_signal_events() -> Any:
    counts, edges = few_signals()
    return fit_curve(
        "N_b/20 + N_s*exp(-((x - mu)/sigma)**2/2)/(sqrt(2*pi)*sigma)", (edges[1:] + edges[:-1])/2, counts,
        noise=Poisson(bins=edges), start={"N_b": 3000, "N_s": 30, "mu": 10, "sigma": 1},
        priors={"mu": "10(1)", "sigma": "1.0(1)"}, bounds={"N_b": (0, None)},
    )  # fmt: skip


C14_YEAR = [19, 46, 82, 119, 147, 178, 196, 221, 251, 278, 308, 328, 372, 394, 425, 452, 489]
C14_COUNT = [
    6287,
    6180,
    6266,
    6298,
    6349,
    6395,
    6425,
    6328,
    6405,
    6338,
    6457,
    6551,
    6366,
    6440,
    6744,
    6461,
    6502,
]
C14_ATOMS = 1e-12 * 6.02214076e23 / 14.003241
C14 = "N0*log(2)/(T*365.25)*exp(-log(2)*(Delta_t + 2019 - x)/T)"


def kafe2_radiocarbon(cost: str) -> Numbers:
    def model(x: Any, Delta_t: float = 5000.0, T: float = 5730.0) -> Any:
        rate = C14_ATOMS * np.log(2) / (T * 365.25)
        return rate * np.exp(-np.log(2) * (Delta_t + 2019 - x) / T)

    errors = np.sqrt(C14_COUNT) if cost == "chi2" else None
    fit = xy_fit(C14_YEAR, C14_COUNT, model, None, errors, cost_function=cost)
    fit.add_parameter_constraint("T", 5730, 40)
    return of_kafe2(fit)


@example("kafe2", "007_cost_functions/01_poisson_cost_function.py", "counts, a measured parameter",
         run=lambda: kafe2_radiocarbon("nll-poisson"), within=0.02, spread=0.02)  # fmt: skip
def radiocarbon() -> Any:
    return fit_curve(
        C14, C14_YEAR, C14_COUNT, noise="poisson", start={"Delta_t": 5000, "T": 5730},
        priors={"T": "5730(40)"}, fixed={"N0": C14_ATOMS},
    )  # fmt: skip


@example("kafe2", "007_cost_functions/02_gaussian_approximation_good.py", "a measured parameter",
         run=lambda: kafe2_radiocarbon("chi2"), within=0.02, spread=0.02)  # fmt: skip
def radiocarbon_gaussian() -> Any:
    return fit_curve(
        C14, C14_YEAR, C14_COUNT, u_y=np.sqrt(C14_COUNT), start={"Delta_t": 5000, "T": 5730},
        priors={"T": "5730(40)"}, fixed={"N0": C14_ATOMS},
    )  # fmt: skip


# --- several data sets, coordinates

MULTI_X = np.arange(1.0, 11.0)
MULTI_1 = [1.29, 1.78, 3.32, 3.85, 5.27, 6.00, 7.07, 8.57, 8.95, 10.52]
MULTI_2 = [0.76, 1.19, 1.71, 2.21, 2.58, 3.01, 3.67, 4.24, 4.69, 4.97]


def kafe2_two_lines() -> Numbers:
    from kafe2 import MultiFit

    def first(x: Any, p0: float = 1.0, g1: float = 1.0, o1: float = 0.0) -> Any:
        return g1 * p0 * x + o1

    def second(x: Any, p0: float = 1.0, g2: float = 0.5, o2: float = 0.0) -> Any:
        return g2 * p0 * x + o2

    one, two = (
        xy_fit(MULTI_X, MULTI_1, first, 0.15, 0.2),
        xy_fit(MULTI_X, MULTI_2, second, 0.15, 0.15),
    )
    one.add_parameter_constraint("g1", 1.0, 0.05)
    two.add_parameter_constraint("g2", 0.5, 0.05)
    names = {"p0": "p0", "g1": "g[1]", "o1": "o[1]", "g2": "g[2]", "o2": "o[2]"}
    return {names[name]: number for name, number in of_kafe2(MultiFit([one, two])).items()}


@example("kafe2", "011_multifit/04_multifit3.py", "two data sets, one parameter in common, a prior in each", run=kafe2_two_lines,
         within=0.1, spread=0.1, why=X_ERRORS)  # fmt: skip
def two_lines() -> Any:
    data = {
        "1": DataSet(MULTI_X, MULTI_1, u_x=0.15, u_y=0.2),
        "2": DataSet(MULTI_X, MULTI_2, u_x=0.15, u_y=0.15),
    }
    return fit_curves(
        "g*p0*x + o", data, shared=["p0"], priors={"g[1]": "1.00(5)", "g[2]": "0.50(5)"},
        start={"p0": 1, "g[1]": 1, "g[2]": 0.5, "o": 0},
    )  # fmt: skip


OHM_U = np.arange(0.5, 10.1, 0.5)
OHM_I = [0.50, 0.89, 1.41, 1.67, 2.30, 2.59, 2.77, 3.57, 3.94, 4.24, 4.73, 4.87, 5.35, 5.74, 5.77, 6.17, 6.32, 6.83, 6.87, 7.17]  # fmt: skip
OHM_T = np.array([293.5, 293.8, 295.4, 296.8, 299.4, 301.0, 303.0, 307.4, 310.9, 315.1, 318.0, 323.2, 327.4, 333.7, 338.2, 343.1, 350.0, 354.7, 358.6, 367.9]) - 273.15  # fmt: skip


def kafe2_ohm() -> Numbers:
    from kafe2 import MultiFit

    def warm(U: Any, p2: float = 1.0, p1: float = 1.0, p0: float = 0.0) -> Any:
        return p2 * U**2 + p1 * U + p0

    def flow(
        U: Any,
        R0: float = 1.0,
        alpha: float = 0.004,
        p2: float = 1.0,
        p1: float = 1.0,
        p0: float = 0.0,
    ) -> Any:
        return U / (R0 * (1.0 + alpha * warm(U, p2, p1, p0)))

    fits = [xy_fit(OHM_U, OHM_T, warm, u_y=0.5), xy_fit(OHM_U, OHM_I, flow, u_y=0.1)]
    both = MultiFit(fits, minimizer="iminuit")
    both.add_error(0.2, axis="x", fits="all")
    return of_kafe2(both)


@example("kafe2", "011_multifit/02_multifit.py", "I(U) and T(U) with parameters in common, and with the same errors of U", run=kafe2_ohm,
         within=0.11, spread=0.03, slow=True, why="kafe2 turns errors of U into errors of I and T by the slopes of both curves; "
         "here the true voltages are parameters.")  # fmt: skip
def ohm() -> Any:
    k = np.arange(20)  # the number of the reading

    def voltage(k, **true):  # type: ignore[no-untyped-def]
        return sum(value * (k == i) for i, value in enumerate(true.values()))

    def warm(k, p2=1.0, p1=1.0, p0=0.0, **true):  # type: ignore[no-untyped-def]
        return p2 * voltage(k, **true) ** 2 + p1 * voltage(k, **true) + p0

    def flow(k, R0, alpha, p2, p1, p0, **true):  # type: ignore[no-untyped-def]
        return voltage(k, **true) / (R0 * (1 + alpha * warm(k, p2, p1, p0, **true)))

    data = {
        "U": DataSet(k, OHM_U, u_y=0.2, curve=voltage),
        "T": DataSet(k, OHM_T, u_y=0.5, curve=warm),
        "I": DataSet(k, OHM_I, u_y=0.1, curve=flow),
    }
    start = {"R0": 1, "alpha": 0.004, "p2": 1, "p1": 1, "p0": 0}
    return fit_curves(None, data, start=start | {f"U{i}": u for i, u in enumerate(OHM_U)})


def two_histograms() -> Any:
    random = np.random.RandomState(1)
    drawn = []
    for n, share, blur, bins in ((200, 0.8, 0.66, 30), (500, 0.25, 0.11, 50)):
        raw = [random.normal(6.66, 0.33, int(share * n)), random.uniform(0, 10, n - int(share * n))]
        values = np.concatenate(raw) + random.normal(0, blur, n)
        drawn.append((values[(values > 0) & (values < 10)], bins))
    return drawn


def kafe2_two_histograms() -> Numbers:
    from kafe2 import HistContainer, HistFit, MultiFit
    from scipy.stats import norm

    def first(
        x: Any, mu: float = 6.0, width: float = 0.3, res1: float = 0.66, sf1: float = 0.5
    ) -> Any:
        return sf1 * norm.pdf(x, mu, np.hypot(width, res1)) + (1 - sf1) / 10

    def second(
        x: Any, mu: float = 6.0, width: float = 0.3, res2: float = 0.11, sf2: float = 0.5
    ) -> Any:
        return sf2 * norm.pdf(x, mu, np.hypot(width, res2)) + (1 - sf2) / 10

    fits = [
        HistFit(HistContainer(bins, (0, 10), fill_data=values), model)
        for (values, bins), model in zip(two_histograms(), (first, second), strict=True)
    ]
    fits[0].add_parameter_constraint("res1", 0.66, 0.165)
    fits[1].add_parameter_constraint("res2", 0.11, 0.055)
    return of_kafe2(MultiFit(fits))


@example("kafe2", "011_multifit/03_multifit2.py", "two histograms that share a place and a width, priors", run=kafe2_two_histograms,
         within=0.02, spread=0.08, why="kafe2 takes the second derivatives of the likelihood at its maximum, estim their expectation.")  # fmt: skip
def histograms() -> Any:
    data = {}
    for name, (values, bins) in zip("12", two_histograms(), strict=True):
        counts, edges = np.histogram(values, bins, (0, 10))
        peak = (
            f"exp(-(x - mu)**2/(2*(width**2 + res{name}**2)))/sqrt(2*pi*(width**2 + res{name}**2))"
        )
        curve = f"{values.size}*(sf{name}*{peak} + (1 - sf{name})/10)"
        data[name] = DataSet(
            (edges[1:] + edges[:-1]) / 2, counts, noise=Poisson(bins=edges), curve=curve
        )
    return fit_curves(
        None, data, start={"mu": 6, "width": 0.3, "sf1": 0.5, "sf2": 0.5, "res1": 0.66, "res2": 0.11},
        bounds={"width": (0.01, 3), "sf1": (0, 1), "sf2": (0, 1)}, priors={"res1": "0.660(165)", "res2": "0.110(55)"},
    )  # fmt: skip


def kafe2_polar() -> Numbers:
    from kafe2 import IndexedFit

    def polar(x: float = 0.65, y: float = 0.6) -> Any:
        return np.array([np.hypot(x, y), np.arctan2(y, x)])

    fit = IndexedFit([0.9, 0.755], polar)
    fit.add_error([0.01, 0.15])
    return of_kafe2(fit)


@example("kafe2", "008_indexed_fit/01_parameter_and_interval_transformation.py", "other coordinates of a measured point",
         run=kafe2_polar, within=0.02, spread=0.02)  # fmt: skip
def coordinates() -> Any:
    inputs = [Input("r", 0.9, 0.01), Input("phi", 0.755, 0.15)]
    point = propagate_linear(
        lambda v: np.array([v["r"] * np.cos(v["phi"]), v["r"] * np.sin(v["phi"])]), inputs
    )
    return dict(zip("xy", zip(point.value, point.u, strict=True), strict=True))


def signal_on_flat() -> Any:
    random = np.random.RandomState(1)
    signal, flat = (
        random.normal(loc=6.66, scale=0.33, size=160),
        random.uniform(low=0, high=10, size=40),
    )
    return np.histogram(np.concatenate((signal, flat)), bins=35, range=(0, 10))


def kafe2_signal() -> Numbers:
    from kafe2 import HistFit
    from scipy.stats import norm

    def model(
        x: Any, Ns: float = 150.0, mu: float = 6.5, sigma: float = 0.4, Nb: float = 50.0
    ) -> Any:
        return Ns * norm.pdf(x, mu, sigma) + Nb / 10

    return of_kafe2(HistFit(signal_on_flat(), model, density=False))


@example("kafe2", "009_histogram_fit/03_SplusBfit.py", "counts in bins: a peak on a flat background", run=kafe2_signal,
         within=0.05, spread=0.05)  # fmt: skip
def signal() -> Any:
    counts, edges = signal_on_flat()
    return fit_curve(
        "Ns*exp(-((x - mu)/sigma)**2/2)/(sqrt(2*pi)*sigma) + Nb/10", (edges[1:] + edges[:-1])/2, counts, noise=Poisson(bins=edges),
        start={"Ns": 200, "mu": 6, "sigma": 0.5, "Nb": 50},
        bounds={"Ns": (0, None), "sigma": (0.05, 5), "Nb": (0, None), "mu": (0, 10)},
    )  # fmt: skip
