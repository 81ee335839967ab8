"""Examples of iminuit 2.33.0, its notebooks (`doc/notebooks`, MIT licence), with the data that they
draw.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from cases import Numbers, example
from scipy.stats import expon, norm

from estim import DataSet, EventTimes, Poisson, fit_curve, fit_curves


def of_iminuit(cost: Any, limits: Any = None, **start: float) -> Numbers:
    from iminuit import Minuit

    minuit = Minuit(cost, **start)
    for name, limit in (limits or {}).items():
        minuit.limits[name] = limit
    minuit.migrad()
    minuit.hesse()
    return {p.name: (p.value, p.error) for p in minuit.params if not p.is_fixed}


BASIC_X = np.linspace(0, 1, 10)
BASIC_Y = np.random.default_rng(1).normal(1 + 2 * BASIC_X, 0.1)


def iminuit_basic() -> Numbers:
    from iminuit.cost import LeastSquares

    def line(x: Any, intercept: float, slope: float) -> Any:
        return intercept + x * slope

    return of_iminuit(LeastSquares(BASIC_X, BASIC_Y, 0.1, line), intercept=0, slope=0)


@example("iminuit", "basic.ipynb", "a line, stated errors", run=iminuit_basic)
def basic() -> Any:
    return fit_curve("line", BASIC_X, BASIC_Y, u_y=0.1)


CURVE_X = np.linspace(0, 1, 20)
CURVE_U = 0.4 * CURVE_X**5 + 0.1
CURVE_Y = np.random.default_rng(4).normal(1 + 2 * CURVE_X**2, CURVE_U)


def iminuit_least_squares() -> Numbers:
    from iminuit.cost import LeastSquares

    def model(x: Any, a: float, b: float) -> Any:
        return a + b * x**2

    return of_iminuit(LeastSquares(CURVE_X, CURVE_Y, CURVE_U, model), a=0, b=0)


@example(
    "iminuit",
    "cost_functions.ipynb, LeastSquares",
    "an error for each point",
    run=iminuit_least_squares,
)
def least_squares() -> Any:
    return fit_curve("a + b*x**2", CURVE_X, CURVE_Y, u_y=CURVE_U)


def mixture() -> Any:
    random = np.random.default_rng(1)
    x = np.append(random.normal(1, 0.1, size=1000), random.exponential(size=1000))
    return x[(x > 0) & (x < 2)]


def peak_density(x: Any, mu: float, sigma: float) -> Any:
    return norm.pdf(x, mu, sigma) / (norm.cdf(2, mu, sigma) - norm.cdf(0, mu, sigma))


def iminuit_unbinned() -> Numbers:
    from iminuit.cost import UnbinnedNLL

    def pdf(x: Any, z: float, mu: float, sigma: float, tau: float) -> Any:
        flat = expon.pdf(x, 0, tau) / expon.cdf(2, 0, tau)
        return z * peak_density(x, mu, sigma) + (1 - z) * flat

    limits = {"z": (0, 1), "mu": (0, 2), "sigma": (0, None), "tau": (0, None)}
    return of_iminuit(UnbinnedNLL(mixture(), pdf), limits, z=0.4, mu=1, sigma=0.2, tau=1)


@example("iminuit", "cost_functions.ipynb, UnbinnedNLL", "single events: a peak over an exponential", run=iminuit_unbinned,
         within=0.05, spread=0.06, why="iminuit takes the second derivatives of the likelihood at its maximum, estim their expectation, the Fisher information; intervals of both are profiles.")  # fmt: skip
def unbinned() -> Any:
    peak = "exp(-((x - mu)/sigma)**2/2)/(sqrt(2*pi)*sigma)"
    return fit_curve(
        f"z*{peak} + (1 - z)*exp(-x/tau)/(tau*(1 - exp(-2/tau)))", mixture(), None, noise=EventTimes(0, 2),
        start={"z": 0.4, "mu": 1, "sigma": 0.2, "tau": 1},
        bounds={"z": (0, 1), "mu": (0, 2), "sigma": (0.01, None), "tau": (0.01, None)},
    )  # fmt: skip


def iminuit_binned() -> Numbers:
    from iminuit.cost import ExtendedBinnedNLL

    def integral(x: Any, s: float, b: float, mu: float, sigma: float, tau: float) -> Any:
        peak = norm.cdf(x, mu, sigma) / (norm.cdf(2, mu, sigma) - norm.cdf(0, mu, sigma))
        return s * peak + b * expon.cdf(x, 0, tau) / expon.cdf(2, 0, tau)

    limits = dict.fromkeys(("s", "b", "sigma", "tau"), (0, None))
    counts, edges = np.histogram(mixture(), bins=20, range=(0, 2))
    return of_iminuit(
        ExtendedBinnedNLL(counts, edges, integral), limits, s=300, b=1500, mu=1, sigma=0.2, tau=2
    )


@example("iminuit", "cost_functions.ipynb, ExtendedBinnedNLL", "counts in bins: a peak over an exponential", run=iminuit_binned,
         within=0.05, spread=0.03)  # fmt: skip
def binned() -> Any:
    counts, edges = np.histogram(mixture(), bins=20, range=(0, 2))
    peak = "exp(-((x - mu)/sigma)**2/2)/(sqrt(2*pi)*sigma)"
    return fit_curve(
        f"s*{peak} + b*exp(-x/tau)/(tau*(1 - exp(-2/tau)))", (edges[1:] + edges[:-1])/2, counts, noise=Poisson(bins=edges),
        start={"s": 300, "b": 1500, "mu": 1, "sigma": 0.2, "tau": 2},
        bounds={"s": (0, None), "b": (0, None), "sigma": (0.01, None), "tau": (0.01, None)},
    )  # fmt: skip


PAIR_COV = np.array([[0.3**2 + 0.1**2, 0.1 * 0.2], [0.1 * 0.2, 0.3**2 + 0.2**2]])


def iminuit_correlated() -> Numbers:
    weights = np.linalg.inv(PAIR_COV)

    def cost(c: float) -> float:
        delta = np.array([1.2, 1.5]) - c
        return float(delta @ weights @ delta)

    return of_iminuit(cost, c=1.0)


@example("iminuit", "correlated_data.ipynb", "a mean of two values with correlated errors", run=iminuit_correlated,
         why="The example searches the weight of a mean that makes chi-squared of both values smallest, which gives the same mean; "
         "here both fit the mean.")  # fmt: skip
def correlated() -> Any:
    return fit_curve("constant", [1, 2], [1.2, 1.5], cov_y=PAIR_COV)


def two_samples() -> Any:
    random = np.random.default_rng(1)
    return random.normal(0, 2.0, size=1000), random.normal(5, 2.0, size=1000)


def iminuit_simultaneous() -> Numbers:
    from iminuit.cost import UnbinnedNLL

    def first(x: Any, mu_1: float, sigma: float) -> Any:
        return norm.pdf(x, mu_1, sigma)

    def second(x: Any, mu_2: float, sigma: float) -> Any:
        return norm.pdf(x, mu_2, sigma)

    one, two = two_samples()
    cost = UnbinnedNLL(one, first) + UnbinnedNLL(two, second)
    said = of_iminuit(cost, {"sigma": (0, None)}, mu_1=1, mu_2=2, sigma=1)
    return {"mu[1]": said["mu_1"], "mu[2]": said["mu_2"], "sigma": said["sigma"]}


@example("iminuit", "simultaneous_fits.ipynb", "single events of two samples with one width", run=iminuit_simultaneous,
         within=0.02, spread=0.02, slow=True)  # fmt: skip
def simultaneous() -> Any:
    one, two = two_samples()
    window = EventTimes(-25, 30)
    data = {"1": DataSet(one, None, noise=window), "2": DataSet(two, None, noise=window)}
    return fit_curves(
        "exp(-((x - mu)/sigma)**2/2)", data, shared=["sigma"], start={"mu[1]": 1, "mu[2]": 2, "sigma": 1},
        bounds={"sigma": (0.1, 10), "mu": (-20, 25)},
    )  # fmt: skip


DECAY_T = np.linspace(0.25, 9.75, 20)


def decays() -> Any:
    random = np.random.default_rng(1)
    volts = random.normal(2 * np.exp(-DECAY_T / 3), 0.05)
    counts = np.histogram(random.exponential(3, 4000), 20, (0, 10))[0] + random.poisson(20, 20)
    times = random.exponential(3, 400)
    return volts, counts, times[times < 10]


def iminuit_sum() -> Numbers:
    from iminuit.cost import ExtendedBinnedNLL, LeastSquares, UnbinnedNLL

    def read(x: Any, V: float, tau: float) -> Any:
        return V * np.exp(-x / tau)

    def integral(x: Any, N: float, B: float, tau: float) -> Any:
        return N * tau * (1 - np.exp(-x / tau)) + B * x

    def density(x: Any, tau: float) -> Any:
        return np.exp(-x / tau) / (tau * (1 - np.exp(-10 / tau)))

    volts, counts, times = decays()
    cost = (
        LeastSquares(DECAY_T, volts, 0.05, read)
        + ExtendedBinnedNLL(counts, np.linspace(0, 10, 21), integral)
        + UnbinnedNLL(times, density)
    )
    return of_iminuit(cost, V=1, tau=2, N=1000, B=50)


@example("iminuit", "cost.CostSum", "readings, counts in bins and single events with one lifetime", run=iminuit_sum,
         within=0.02, spread=0.02, why="The sum of costs of iminuit's reference, with data drawn here.")  # fmt: skip
def sum_of_costs() -> Any:
    volts, counts, times = decays()
    bins = Poisson(bins=np.linspace(0, 10, 21))
    data = {
        "read": DataSet(DECAY_T, volts, u_y=0.05, curve="V*exp(-x/tau)"),
        "counted": DataSet(DECAY_T, counts, noise=bins, curve="N*exp(-x/tau) + B"),
        "times": DataSet(times, None, noise=EventTimes(0, 10), curve="exp(-x/tau)"),
    }
    return fit_curves(None, data, start={"V": 1, "tau": 2, "N": 1000, "B": 50})


HUNDRED = np.random.default_rng(1).normal(size=100)


def iminuit_normal() -> Numbers:
    from iminuit.cost import ExtendedUnbinnedNLL

    def density(x: Any, n: float, mu: float, sigma: float) -> Any:
        return n, n * norm.pdf(x, mu, sigma)

    said = of_iminuit(
        ExtendedUnbinnedNLL(HUNDRED, density), {"sigma": (0, None)}, n=100, mu=0, sigma=1
    )
    return {name: said[name] for name in ("mu", "sigma")}


@example("iminuit", "error_bands.ipynb", "single events without a window", run=iminuit_normal, within=0.02, spread=0.02,
         why="The number of events, 100 ± 10, is not asked of estim; a wide window stands for none.")  # fmt: skip
def normal() -> Any:
    return fit_curve(
        "exp(-((x - mu)/sigma)**2/2)", HUNDRED, None, noise=EventTimes(-6, 6), start={"mu": 0, "sigma": 1},
        bounds={"mu": (-5, 5), "sigma": (0.1, 5)},
    )  # fmt: skip


OUTLIER_Y = np.where(np.arange(20) == 3, 3.0, CURVE_Y)


def iminuit_masked() -> Numbers:
    from iminuit.cost import LeastSquares

    def model(x: Any, a: float, b: float) -> Any:
        return a + b * x**2

    cost = LeastSquares(CURVE_X, OUTLIER_Y, CURVE_U, model)
    cost.mask = np.arange(20) != 3
    return of_iminuit(cost, a=0, b=0)


@example(
    "iminuit",
    "cost_functions.ipynb, LeastSquares with a mask",
    "a bad point that is left out",
    run=iminuit_masked,
)
def masked() -> Any:
    good = np.arange(20) != 3
    return fit_curve("a + b*x**2", CURVE_X[good], OUTLIER_Y[good], u_y=CURVE_U[good])


def iminuit_shape() -> Numbers:
    from iminuit.cost import BinnedNLL

    def cdf(x: Any, z: float, mu: float, sigma: float, tau: float) -> Any:
        peak = norm.cdf(x, mu, sigma) / (norm.cdf(2, mu, sigma) - norm.cdf(0, mu, sigma))
        return z * peak + (1 - z) * expon.cdf(x, 0, tau) / expon.cdf(2, 0, tau)

    counts, edges = np.histogram(mixture(), bins=20, range=(0, 2))
    limits = {"z": (0, 1), "sigma": (0.01, None), "tau": (0.01, None)}
    return of_iminuit(BinnedNLL(counts, edges, cdf), limits, z=0.4, mu=1, sigma=0.2, tau=2)


@example("iminuit", "cost_functions.ipynb, BinnedNLL", "the shape of a histogram alone", run=iminuit_shape, within=0.05, spread=0.04,
         slow=True, why="A number N that is free beside Poisson counts leaves the same likelihood of the shape. "
         "estim's errors are from the Fisher information.")  # fmt: skip
def shape() -> Any:
    counts, edges = np.histogram(mixture(), bins=20, range=(0, 2))
    peak = "exp(-((x - mu)/sigma)**2/2)/(sqrt(2*pi)*sigma)"
    return fit_curve(
        f"N*(z*{peak} + (1 - z)*exp(-x/tau)/(tau*(1 - exp(-2/tau))))", (edges[1:] + edges[:-1])/2, counts,
        noise=Poisson(bins=edges), start={"N": 1800, "z": 0.4, "mu": 1, "sigma": 0.2, "tau": 2},
        bounds={"N": (0, None), "z": (0, 1), "sigma": (0.01, None), "tau": (0.01, None)},
    )  # fmt: skip
