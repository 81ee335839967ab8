"""Propagation of uncertainty by the GUM and its Supplement 1: inputs, linear, Monte Carlo, budgets,
and which of them to believe.

Read `linear` first.  Of the rest it needs `common`, and the formulas of `curves`.
"""

from estim.propagation.inputs import Input
from estim.propagation.linear import LinearResult, propagate_linear
from estim.propagation.monte_carlo import (
    MOST_VALUES,
    BatchProgress,
    Interval,
    IntervalKind,
    MonteCarloResult,
    propagate_monte_carlo,
)
from estim.propagation.scores import BOUNDED, Distribution
from estim.propagation.uncertainty_budget import Budget, BudgetAlong, budget, budget_along
from estim.propagation.validation import Validation, compare
