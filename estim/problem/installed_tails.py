"""Laws of the errors that installed packages add (the entry points `estim.robust`;
`docs/extending.md` explains them to their authors): distributions of `scipy.stats`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from estim.arrays import FloatArray, Named
from estim.common import InputError, phrase
from estim.distributions import normal_quantile
from estim.plugins import plugin_called, told
from estim.problem.tails import Tails

GROUP = "estim.robust"
_NEAR = 1e-4
_SHARES = (np.arange(20_000) + 0.5) / 20_000


@dataclass(frozen=True, eq=False)
class InstalledTails(Tails):
    """name : for words.  law : distribution of z, with the highest density at 0."""

    name: str
    law: Any

    def log_density(self, z: FloatArray, values: Named) -> FloatArray:
        return np.asarray(self.law.logpdf(z))

    def score(self, z: FloatArray) -> FloatArray:
        """Minus the derivative of the log density."""
        step = 0.1 * _NEAR * (1.0 + np.abs(z))
        return np.asarray((self.law.logpdf(z - step) - self.law.logpdf(z + step)) / (2.0 * step))

    def deviance_residual(self, z: FloatArray, values: Named) -> tuple[FloatArray, FloatArray]:
        near = np.where(np.abs(z) < _NEAR, _NEAR, z)  # where the slope is taken
        falls = self.law.logpdf(0.0) - self.law.logpdf(np.stack([z, near]))
        root, beside = np.sqrt(np.maximum(2.0 * falls, 0.0))
        return np.sign(z) * root, np.sign(near) * self.score(near) / beside

    def information(self, values: Named) -> tuple[float, float]:
        z = self.law.ppf(_SHARES)
        score = self.score(z)
        return float(np.mean(score**2)), float(np.mean((score * z - 1.0) ** 2))

    def normal_score(self, z: FloatArray, values: Named) -> FloatArray:
        tail = np.where(z < 0.0, self.law.cdf(z), self.law.sf(z))
        return np.where(z < 0.0, 1.0, -1.0) * normal_quantile(np.maximum(tail, 1e-300))

    def draw(self, rng: np.random.Generator, size: int, values: Named) -> FloatArray:
        return np.asarray(self.law.ppf(rng.random(size)))

    def describe(self) -> str:
        return phrase("errors distributed as '{name}'", name=self.name)


def known_laws() -> Iterator[str | InputError]:
    """The laws of the errors that installed packages add, or what is wrong with one."""
    return told(GROUP, lambda plugin: f"law of the errors {tails_called(plugin.name).name}")


def tails_called(name: str) -> InstalledTails:
    """The law of the errors that an installed package has by that name.  Raises InputError."""
    plugin = plugin_called(GROUP, name)
    if plugin is None:
        rule = (
            'must be "student-t" or "mixture", or name an error distribution from an installed '
            "package"
        )
        raise InputError(rule, field="robust", value=name)

    def checked(law: Any) -> InstalledTails:
        tails, near = InstalledTails(name, law), np.array([_NEAR, 100.0 * _NEAR])
        first, second = tails.score(near) / near
        highest = np.max(law.logpdf(law.ppf(_SHARES))) <= law.logpdf(0.0)
        if not (highest and 0.5 * first < second < 2.0 * first):
            raise ValueError("its density must have its maximum at 0 and be smooth there")
        return tails

    return plugin.make(checked, InstalledTails)
