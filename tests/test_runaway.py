"""A chain whose walkers run away says so in one sentence."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from estim.common import NumericalError
from estim.sampling.ensembles import EnsembleRun


def walk_that_ends(coords: float) -> EnsembleRun:
    def sample(*_: object, **__: object):
        raise ValueError
        yield

    return EnsembleRun(SimpleNamespace(sample=sample, iteration=0), np.array([[[1.0, coords]]]))


def test_walkers_that_run_away_are_told_in_one_sentence() -> None:
    with pytest.raises(
        NumericalError,
        match=r"no posterior exists to draw from; give limits \(low, high\) or a prior$",
    ):
        walk_that_ends(-1e200).advance(1)
    with pytest.raises(ValueError):
        walk_that_ends(3.0).advance(1)
