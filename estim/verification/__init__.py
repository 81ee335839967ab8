"""Reports compared: what differs between a report and its recomputation, or between two results.

Read `comparing` first.  Only `cli` may import it."""

from estim.verification.comparing import WHOLE, Difference, Pair, differences
from estim.verification.results import compare_results, estimates, only_estimate
