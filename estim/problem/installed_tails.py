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
from estim.plugins import plugin_called, told
from estim.problem.tails import NEAR, Tails

GROUP = "estim.robust"
_SHARES = (np.arange(20_000) + 0.5) / 20_000


@dataclass(frozen=True, eq=False)
class InstalledTails(Tails):
    """name : for words.  law : distribution of z, with the highest density at 0."""

    name: str
    law: Any

    def log_density(self, z: FloatArray, values: Named) -> FloatArray:
        return np.asarray(self.law.logpdf(z))

    def score(self, z: FloatArray, values: Named) -> FloatArray:
        step = 0.1 * NEAR * (1.0 + np.abs(z))
        return np.asarray((self.law.logpdf(z - step) - self.law.logpdf(z + step)) / (2.0 * step))

    def tail(self, z: FloatArray, values: Named) -> FloatArray:
        return np.where(z < 0.0, self.law.cdf(z), self.law.sf(z))

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
        tails, near = InstalledTails(name, law), np.array([NEAR, 100.0 * NEAR])
        first, second = tails.score(near, {}) / near
        highest = np.max(law.logpdf(law.ppf(_SHARES))) <= law.logpdf(0.0)
        if not (highest and 0.5 * first < second < 2.0 * first):
            raise ValueError("its density must have its maximum at 0 and be smooth there")
        return tails

    return plugin.make(checked, InstalledTails)
