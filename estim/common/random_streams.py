"""Random streams: which part of the work draws from which.

Each part has its own, so that a new part changes the numbers of no other, and none reuses another's
draws.  A name's number is what the draws depend on: new names go to the end.
"""

from __future__ import annotations

from enum import IntEnum
from numbers import Integral
from typing import TYPE_CHECKING

from estim.common.errors import InputError

if TYPE_CHECKING:
    import numpy as np


class Stream(IntEnum):
    """What is drawn from a seed."""

    FIT = 0  # further starts, and trial moves of searches
    CHAIN = 1
    GOODNESS = 2  # null distributions of the tests
    BANDS = 3
    PROPOSAL = 4  # and the second opinion
    PRIOR = 5  # draws of the prior that are handed on
    ENERGY = 6
    PROPAGATED_BANDS = 7
    NARROWING = 8
    LINE_CHAIN = 10
    LINE_EVIDENCE = 11
    CALIBRATION_FIT = 12
    CALIBRATION_TRUTH = 13
    RANK_TRIALS = 14
    COVERAGE_TRIALS = 15
    EXPLANATION = 16  # of what a curve lacks: null distributions
    PARTS = 17  # of bodies
    FRICTION = 18  # as stated
    AGAIN = 19  # data sets drawn from a posterior
    WIDTHS = 20  # of priors, in a comparison of models
    MEASUREMENT = 30  # models: propagated distributions
    PLAN_FIT = 31
    PLAN_DRAWS = 32  # with which linear theory is compared
    REGIMES = 33  # what is known of bodies that are mapped
    RELEASE_DRAWS = 35  # and their importance sampling
    PLAN_TESTS = 36  # null distributions of the tests of what is planned from


def stream(seed: int, name: Stream, *index: int) -> np.random.Generator:
    """The generator of `name` under `seed` (the user's), or of its part number `index` (a trial, a
    run).  Raises InputError for what is no seed.
    """
    from numpy.random import SeedSequence, default_rng

    given: object = seed
    if isinstance(given, bool) or not isinstance(given, Integral) or seed < 0:
        raise InputError("must be a whole number >= 0", field="seed", value=seed)

    return default_rng(SeedSequence(seed, spawn_key=(int(name), *index)))
