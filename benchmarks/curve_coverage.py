"""Whose 68 % is 68 %, for a user's own curve: the tables of docs/statistics.md.

    python benchmarks/curve_coverage.py lacks [N]         with and without `deviation` or
    `correlated` (N sets each, 300) python benchmarks/curve_coverage.py always [N [LINE]] a
    deviation that nobody asked for: price and coverage (N sets a line, 400; from LINE on) python
    benchmarks/curve_coverage.py wrong [N [LINE]]  `deviation` beside a wrong curve and beside a
    right one (N sets a line, 200; from LINE on) python benchmarks/curve_coverage.py conservative
    [N]  the stated error where it covers the pattern in the residuals (N sets a size, 1500) python
    benchmarks/curve_coverage.py alarms [N]        right lines that the tests of residuals call a
    poor fit (N sets a line, 100,000)

Curves that are linear in their parameters, errors made by Cholesky factors and recursions; a minute
or a few.
"""

from __future__ import annotations

import sys

import numpy as np
from scipy import stats

from estim.checks.goodness_of_fit import P_POOR_FIT, _of_order, _pattern, _repeated, _uneven
from estim.discrepancy.curve_covariances import (
    LONG,
    correlated_shapes,
    deviation_shapes,
    relative_grid,
)
from estim.discrepancy.grid import SPIKE
from estim.discrepancy.linearised import linearise
from estim.discrepancy.scale_mixture import diagonalise
from estim.problem.roots import root_of

N_OBS = 60


def design(curve: str, x: np.ndarray) -> np.ndarray:
    wave = 6.0 * np.pi * x
    columns = {
        "fall": [np.ones_like(x), x, x**2],
        "decay": [np.ones_like(x), np.exp(-3.0 * x), x * np.exp(-3.0 * x)],
        "line": [np.ones_like(x), x],
        "parabola": [np.ones_like(x), x, x**2],
        "sine": [np.ones_like(x), np.cos(wave), np.sin(wave), x * np.cos(wave)],
    }
    return np.column_stack(columns[curve])


def smooth(x: np.ndarray, length: float) -> np.ndarray:
    """Factor of a Matern-3/2 covariance."""
    apart = np.sqrt(3.0) * np.abs(x[:, None] - x) / length
    return np.linalg.cholesky((1.0 + apart) * np.exp(-apart) + 1e-9 * np.eye(x.size))


def errors(kind: str, x: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Errors whose white part has the standard deviation 1 (of AR(1): all of them)."""
    white = rng.standard_normal(x.size)
    if kind.startswith("AR"):
        phi = float(kind.split()[1])
        made = white.copy()
        for i in range(1, x.size):
            made[i] = phi * made[i - 1] + np.sqrt(1.0 - phi**2) * white[i]
        return made
    if kind == "wave 2":
        return 2.0 * np.sqrt(2.0) * np.sin(4.0 * np.pi * x + rng.uniform(0.0, 2.0 * np.pi)) + white
    if kind.startswith("smooth"):
        return float(kind.split()[1]) * smooth(x, 0.2) @ rng.standard_normal(x.size) + white
    return white


def lacks(n_set: int) -> None:
    rng = np.random.default_rng(7)
    kinds = ("nothing", "AR .5", "AR .9", "smooth .5", "smooth 2", "wave 2")
    cases = [
        (curve, kind, stated)
        for curve in ("line", "sine")
        for kind in kinds
        for stated in (True, False)
    ]
    for curve, kind, stated in cases:
        for key in (
            ("deviation", "correlated")
            if kind == "nothing"
            else ("correlated",)
            if kind.startswith("AR")
            else ("deviation",)
        ):
            without, held = zip(
                *(_one(curve, kind, rng, key, stated=stated) for _ in range(n_set)), strict=True
            )
            cells = [
                " ".join(f"{a:.0f}/{b:.0f}" for a, b in 100.0 * np.mean(table, axis=0))
                for table in (without, held)
            ]
            print(
                f"{curve:5} {kind:10} {key:10} u_y {'stated' if stated else 'left out':8} | "
                f"{' | '.join(cells)}",
                flush=True,
            )


def _one(
    curve: str, kind: str, rng: np.random.Generator, key: str, *, stated: bool
) -> tuple[np.ndarray, np.ndarray]:
    """(n_par, 2) whether 68 and 95 % intervals hold the truth, without the key and with it."""
    x = np.linspace(0.0, 1.0, N_OBS)
    jacobian, made = design(curve, x), errors(kind, x, rng)
    off = np.linalg.lstsq(jacobian, made, rcond=None)[0]
    residuals, n_par = made - jacobian @ off, jacobian.shape[1]
    rms = float(np.sqrt(residuals @ residuals / (N_OBS - n_par)))
    base = 1.0 if stated else rms
    sds = base * np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    times = stats.norm.ppf([0.84, 0.975]) if stated else stats.t.ppf([0.84, 0.975], N_OBS - n_par)
    shapes = (
        deviation_shapes(x) if key == "deviation" else correlated_shapes(np.arange(float(N_OBS)))
    )
    scale = (
        float(f"{2.0 * np.sqrt(np.mean(residuals**2)):.1g}")
        if key == "deviation"
        else 2.0 * max(rms, base)
    )
    grid = diagonalise(
        root_of(np.full(N_OBS, base**2)),
        tuple(shape.times(scale) for shape in shapes),
        relative_grid(stated=stated),
    )
    found = linearise(grid, residuals, jacobian, precision=np.zeros((n_par, n_par)), stated=stated)
    places = np.array(
        [
            found.probability_below(direction, -o)
            for direction, o in zip(np.eye(n_par), off, strict=True)
        ]
    )
    return np.abs(off / sds)[:, None] < times, np.abs(places - 0.5)[:, None] < np.array(
        [0.34, 0.475]
    )


class Tests:
    """The tests of residuals of a linear curve, against `n` simulated sets of residuals."""

    def __init__(
        self, x: np.ndarray, jacobian: np.ndarray, rng: np.random.Generator, n: int
    ) -> None:
        self.basis = np.linalg.qr(jacobian)[0]
        grows, repeated = _uneven(jacobian.sum(axis=1), x), _repeated(x, np.ones(x.size))
        self.tests = _of_order(x.size, stated=True) | grows | repeated
        self.null = {name: np.sort(values) for name, values in self.drawn(rng, n).items()}

    def drawn(self, rng: np.random.Generator, n: int) -> dict[str, np.ndarray]:
        """Statistics of `n` sets of right residuals."""
        found = []
        for _ in range(0, n, 10_000):
            made = rng.standard_normal((min(n, 10_000), len(self.basis)))
            found.append(self.statistics(made - made @ self.basis @ self.basis.T))
        return {name: np.concatenate([one[name] for one in found]) for name in found[0]}

    def statistics(self, z: np.ndarray) -> dict[str, np.ndarray]:
        return {name: test(z) for name, test in self.tests.items()}

    def p_values(self, found: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        above = {
            name: null.size - np.searchsorted(null, found[name] - 1e-12)
            for name, null in self.null.items()
        }
        return {name: (1 + above[name]) / (1 + null.size) for name, null in self.null.items()}

    def fail(self, z: np.ndarray, *, stated: bool) -> bool:
        """Whether residuals (n_obs,) fail any."""
        return any(
            p[0] < P_POOR_FIT
            for name, p in self.p_values(self.statistics(z[None, :])).items()
            if stated or name != "chi2"
        )


def always(n_set: int, first: int = 0) -> None:
    """Half of the prior probability on none, the scale of the half-normal that of one reading,
    stated or found from the residuals.

    Beside coverage, how many sets the tests of a curve taken as complete refuse, and what the
    intervals of the others hold.
    """
    kinds = ("nothing", "smooth 1", "growing", "by x")
    cases = [
        (n, curve, kind, stated)
        for n in (20, 60)
        for curve in ("line", "sine", "decay")
        for kind in kinds
        for stated in (True, False)
    ]
    for k, (n, curve, kind, stated) in enumerate(cases[first:], first):
        rng = np.random.default_rng([9, k])
        x = (
            np.linspace(0.0, 1.0, n)
            if kind != "by x"
            else np.repeat(np.linspace(0.0, 1.0, n // 4), 4)
        )
        tests = Tests(x, design(curve, x), np.random.default_rng([13, k]), 20_000)
        tables = [
            _always(design(curve, x), x, kind, rng, tests, stated=stated) for _ in range(n_set)
        ]
        without, held, price, present, refused = (
            np.array(one) for one in zip(*tables, strict=True)
        )
        parts = (without, held, without[~refused])
        cells = [
            "/".join(f"{100.0 * np.mean(one[:, :, j]):.0f}" for j in (0, 1)) if len(one) else "-"
            for one in parts
        ]
        sds = " ".join(f"{one:.2f}" for one in np.mean(price, axis=0))
        u_sds = np.max(np.std(price, axis=0)) / np.sqrt(n_set)
        what = f"{k:2} {n} points, {curve:5} {kind:8} u_y {'stated' if stated else 'left out':8}"
        high = 100.0 * np.mean(present[~refused] > 0.9)
        refusals = (
            f"refused {100.0 * np.mean(refused):.0f} %, the others {cells[2]}, P(a > 0) > "
            f"0.9 for {high:.1f} %"
        )
        print(
            f"{what} | {cells[0]}, {refusals} | {cells[1]} | sds times {sds} (± "
            f"{u_sds:.2f}) | P(a > 0) {np.mean(present):.2f}",
            flush=True,
        )


def _always(
    jacobian: np.ndarray,
    x: np.ndarray,
    kind: str,
    rng: np.random.Generator,
    tests: Tests,
    *,
    stated: bool,
) -> tuple[np.ndarray, ...]:
    """Of a set: (n_par, 2) whether 68 and 95 % intervals hold the truth without and with a
    deviation, (n_par,) what it does to sds, P(a > 0), and whether the curve taken as complete is a
    poor fit.
    """
    n, n_par = jacobian.shape
    made = (
        errors(kind, x, rng) if kind.startswith(("smooth", "nothing")) else rng.standard_normal(n)
    )
    if kind == "growing":
        made *= 0.2 + 1.3 * x
    if kind == "by x":
        made += rng.standard_normal(n // 4)[np.searchsorted(np.unique(x), x)]
    off = np.linalg.lstsq(jacobian, made, rcond=None)[0]
    residuals = made - jacobian @ off
    base = 1.0 if stated else float(np.sqrt(residuals @ residuals / (n - n_par)))
    sds = base * np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    times = stats.norm.ppf([0.84, 0.975]) if stated else stats.t.ppf([0.84, 0.975], n - n_par)
    grid = relative_grid(stated=stated, spike=SPIKE)
    found = linearise(
        diagonalise(
            root_of(np.full(n, base**2)),
            tuple(shape.times(base) for shape in deviation_shapes(x)),
            grid,
        ),
        residuals,
        jacobian,
        precision=np.zeros((n_par, n_par)),
        stated=stated,
    )
    places = np.array(
        [
            found.probability_below(direction, -o)
            for direction, o in zip(np.eye(n_par), off, strict=True)
        ]
    )
    wide = sds * (1.0 if stated else np.sqrt((n - n_par) / max(n - n_par - 2, 1)))
    return (
        np.abs(off / sds)[:, None] < times,
        np.abs(places - 0.5)[:, None] < np.array([0.34, 0.475]),
        np.sqrt(np.diag(found.covariance)) / wide,
        np.array(found.p_deviation),
        np.array(tests.fail(residuals / base, stated=stated)),
    )


# curve -> the term that a wrong one lacks, and the parameter that both have
_MISSING = {
    "fall": (lambda x: -(x**4), 2),
    "line": (lambda x: x**2, 1),
    "decay": (lambda x: np.exp(-12.0 * x), 1),
    "sine": (lambda x: np.expm1(-x) * np.cos(6.0 * np.pi * x), 1),
}


def wrong(n_set: int, first: int = 0) -> None:
    """60 points, stated errors of 1, the scale of the deviation twice the residuals; what shows of
    the missing term, or the deviation, is `size`.
    """
    kinds = [
        (kind, size)
        for kind in ("wrong", "Matern .1", "Matern .2")
        for size in (0.5, 1.0, 2.0, 6.0)
    ]
    x = np.linspace(0.0, 1.0, N_OBS)
    cases = [(curve, kind, size) for curve in _MISSING for kind, size in kinds]
    for k, (curve, kind, size) in enumerate(cases[first:], first):
        rng, rows = np.random.default_rng([10, k]), []
        jacobian, (missing, place) = design(curve, x), _MISSING[curve]
        for _ in range(n_set):
            shape = (
                missing(x)
                if kind == "wrong"
                else smooth(x, float(kind.split()[1])) @ rng.standard_normal(N_OBS)
            )
            visible = shape - jacobian @ np.linalg.lstsq(jacobian, shape, rcond=None)[0]
            made = size * shape / np.sqrt(np.mean(visible**2)) + rng.standard_normal(N_OBS)
            off = np.linalg.lstsq(jacobian, made, rcond=None)[0]
            residuals, n_par = made - jacobian @ off, jacobian.shape[1]
            scale = 2.0 * float(np.sqrt(np.mean(residuals**2)))
            grid = diagonalise(
                root_of(np.ones(N_OBS)),
                tuple(one.times(scale) for one in deviation_shapes(x)),
                relative_grid(stated=True),
            )
            found = linearise(grid, residuals, jacobian, precision=np.zeros((n_par, n_par)))
            below = found.probability_below(np.eye(n_par)[place], -off[place])
            slow = float(
                found.weights[
                    (grid.column("amplitude") > 0.0) & (grid.lengths() > LONG["deviation"])
                ].sum()
            )
            rows.append((abs(below - 0.5) < 0.34, abs(below - 0.5) < 0.475, slow > 0.5))
        held68, held95, refused = 100.0 * np.mean(rows, axis=0)
        print(
            f"{k:2} {curve:5} {kind:9} {size:3} of a reading | {held68:.0f}/{held95:.0f} | "
            f"refused {refused:.0f} %",
            flush=True,
        )


def conservative(n_set: int) -> None:
    rng = np.random.default_rng(8)
    for curve, n, length in [
        (c, n, one)
        for c in ("line", "parabola", "sine")
        for n in (30, 100, 300)
        for one in (0.1, 0.4, 0.8)
    ]:
        x = np.linspace(0.0, 1.0, n)
        basis, triangle = np.linalg.qr(design(curve, x))
        back = np.linalg.inv(triangle)
        size = np.repeat([0.05, 0.1, 0.2, 0.3], n_set)[:, None]
        made = size * (
            rng.standard_normal((4 * n_set, n)) @ smooth(x, length).T
        ) + 0.02 * rng.standard_normal((4 * n_set, n))
        off = np.abs(made @ basis @ back.T) / np.linalg.norm(back, axis=1)
        left = made - made @ basis @ basis.T
        alike = np.sum(left[:, 1:] * left[:, :-1], axis=1) / np.sum(
            left**2, axis=1
        ) > 3.3 / np.sqrt(n)
        covered = alike & (np.array([_pattern(row) for row in left]) <= 1.0)
        cells = [
            "/".join(
                f"{100.0 * np.min(np.mean(off[some] < q, axis=0)):.0f}" for q in (0.9945, 1.96)
            )
            for some in (alike, covered)
        ]
        print(
            f"{curve:8} {n:3} points, length {length}: all {cells[0]}; covered "
            f"{np.sum(covered) / np.sum(alike):.2f}, {cells[1]}",
            flush=True,
        )


def alarms(n_set: int) -> None:
    """Stated errors; p-values from as many other simulated sets as are judged."""
    for n, each in ((12, 1), (30, 1), (100, 1), (12, 3), (30, 3), (100, 4)):
        rng = np.random.default_rng([11, n, each])
        x = np.repeat(np.linspace(0.0, 1.0, n // each), each)
        tests = Tests(x, design("line", x), rng, n_set)
        failed = {
            name: p < P_POOR_FIT for name, p in tests.p_values(tests.drawn(rng, n_set)).items()
        }
        cells = " ".join(f"{name} {100.0 * np.mean(one):.2f}" for name, one in failed.items())
        print(
            f"{n:3} points, {each} at each x | any "
            f"{100.0 * np.mean(np.any(list(failed.values()), axis=0)):.2f} % | {cells}",
            flush=True,
        )


if __name__ == "__main__":
    studies = {
        "lacks": (lacks, 300),
        "always": (always, 400),
        "wrong": (wrong, 200),
        "conservative": (conservative, 1500),
        "alarms": (alarms, 100_000),
    }
    study, default = studies[sys.argv[1]]
    study(*(map(int, sys.argv[2:]) if len(sys.argv) > 2 else (default,)))
