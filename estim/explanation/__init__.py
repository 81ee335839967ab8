"""What may be missing where a curve does not explain the data: candidates, each refit, and what
they show together.

Read `explaining` first; the candidates of a rolling body stand in
`estim.campaign.candidate_causes`.
"""

from estim.explanation.candidates import Cause, Estimated, Suspects
from estim.explanation.explaining import FOUND, TIED, RefitCandidate, Explanation, Outcome, explain
from estim.explanation.predictive import P_NOT_BROUGHT_BACK, Predicted, predictive_checks
from estim.explanation.runs_of_cause import CauseOfRuns, across_runs, verdict
