"""A chain whose walkers run away says so in one sentence."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from estim.common import NumericalError
from estim.sampling.stepping import Walk


def walk_that_ends_with(error: ValueError) -> SimpleNamespace:
    def sample(*_: object, **__: object):
        raise error
        yield

    return SimpleNamespace(_replay=lambda n_step: None, _sampler=SimpleNamespace(sample=sample), _state=None, n_step=0, _stop=None, _record=None)


def test_walkers_that_run_away_are_told_in_one_sentence() -> None:
    with pytest.raises(NumericalError, match=r"no posterior exists to draw from; give limits \(low, high\) or a prior$"):
        Walk.advance(walk_that_ends_with(ValueError("At least one parameter value was infinite")), 1)
    with pytest.raises(ValueError, match="something else"):
        Walk.advance(walk_that_ends_with(ValueError("something else")), 1)
