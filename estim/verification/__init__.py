"""Reports compared: what differs between a report and its recomputation, or between two results.

Read `comparing` first.  Only `cli` may import it."""

from estim.verification.comparing import Difference, Verdict, differences, draws_are_same
from estim.verification.results import Moved as Moved
from estim.verification.results import compare_results, estimates, only_estimate
