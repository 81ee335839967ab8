"""Curves fitted in three lines of Python: `fit_curve` (read `single.py` first), `fit_curves` of
several data sets, the record of a fit, figures.
"""

from estim.curve_fitting.result import CurveFit
from estim.curve_fitting.tables import TableColumns, read_table
