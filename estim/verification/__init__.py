"""Reports compared: what differs between a report and its recomputation, or between two results.

Read `differences` first.  Only `cli` may import it."""

from estim.verification.differences import differences
from estim.verification.results import compare_results
