"""The straight line with errors in both variables: York, exact intervals, Bayesian; the theta_min
series; trials of release.

Read `regression` first, `analysis` for the theta_min line, `release_analysis` for trials.
"""

from estim.line.analysis import LineAnalysis, analyse_line
from estim.line.conventions import CONVENTIONS
from estim.line.findings import line_goodness
from estim.line.regression import LineFit, confidence_band, coverage_factor
from estim.line.theta_min_series import ThetaMinSeries, read_theta_min
from estim.line.stated_errors import LineCovariances, commons
from estim.line.table_line import LineColumns, PredictedPoint, StraightLine, straight_line
from estim.line.release_likelihood import effective_start
from estim.line.release_analysis import UNKNOWNS, WAYS, TrialsAnalysis, analyse_trials
from estim.line.trial_data import HIGH, LOW, read_trials
