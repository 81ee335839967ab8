"""The straight line with errors in both variables: York, exact intervals, Bayesian; the theta_min series.

Read `least_squares` first, `analysis` for the theta_min line."""

from estim.line.analysis import LineAnalysis, analyse_line
from estim.line.least_squares import CONVENTIONS, confidence_band
from estim.line.series import ThetaMinSeries, read_theta_min
from estim.line.straight import Columns, StraightLine, straight_line
