"""Propagation of uncertainty by the GUM and its Supplement 1: inputs, linear, Monte Carlo, budgets, and which of them to believe.

Read `linear` first.  Stands alone on `common`."""

from estim.propagation.inputs import Input
from estim.propagation.linear import propagate_linear
from estim.propagation.monte_carlo import propagate_monte_carlo
from estim.propagation.uncertainty_budget import BudgetAlong, budget_along
