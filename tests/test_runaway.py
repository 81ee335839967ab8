"""A chain whose walkers run away says so in one sentence."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from estim.common import NumericalError
from estim.sampling.stepping import Walk


def walk_that_ends(coords: float) -> SimpleNamespace:
    def sample(*_: object, **__: object):
        raise ValueError
        yield

    state, sampler = SimpleNamespace(coords=np.array([[1.0, coords]])), SimpleNamespace(sample=sample)
    return SimpleNamespace(_replay=lambda n_step: None, _sampler=sampler, _state=state, n_step=0, _stop=None, _record=None)


def test_walkers_that_run_away_are_told_in_one_sentence() -> None:
    with pytest.raises(NumericalError, match=r"no posterior exists to draw from; give limits \(low, high\) or a prior$"):
        Walk.advance(walk_that_ends(-1e200), 1)
    with pytest.raises(ValueError):
        Walk.advance(walk_that_ends(3.0), 1)
