"""What `estim` offers, each name once: type checkers read it here, and `__init__.py` when a
name is first used.
"""

from estim.campaign.campaign import Campaign as Campaign
from estim.campaign.loading import load_campaign as load_campaign
from estim.checks.diagnosis import diagnose as diagnose
from estim.checks.goodness_of_fit import check_goodness as check_goodness
from estim.common.errors import EstimError as EstimError
from estim.common.errors import InputError as InputError
from estim.curve_fitting.joint_fit import fit_curves as fit_curves
from estim.curve_fitting.repeated_fits import ManyFits as ManyFits
from estim.curve_fitting.repeated_fits import fit_many as fit_many
from estim.curve_fitting.result import CurveFit as CurveFit
from estim.curve_fitting.single import fit_curve as fit_curve
from estim.curve_fitting.tables import read_table as read_table
from estim.curves.count_data import Binomial as Binomial
from estim.curves.count_data import EventTimes as EventTimes
from estim.curves.count_data import LogDensity as LogDensity
from estim.curves.count_data import Poisson as Poisson
from estim.curves.curve_problem import AxisNames as AxisNames
from estim.curves.data_set import DataSet as DataSet
from estim.curves.differential import ode as ode
from estim.curves.models import Model as Model
from estim.curves.systematic_errors import Component as Component
from estim.fitting.least_squares import fit_least_squares as fit_least_squares
from estim.line.analysis import analyse_line as analyse_line
from estim.line.posterior import line_posterior as line_posterior
from estim.line.regression import LineFit as LineFit
from estim.line.regression import confidence_band as confidence_band
from estim.line.regression import fit_line as fit_line
from estim.line.regression import inverse_prediction as inverse_prediction
from estim.line.regression import prediction_band as prediction_band
from estim.line.slope_interval import slope_interval as slope_interval
from estim.line.theta_min_series import read_theta_min as read_theta_min
from estim.means.averages import Mean as Mean
from estim.means.averages import mean as mean
from estim.means.two_values import compare_values as compare_values
from estim.pipeline import Analysis as Analysis
from estim.pipeline import analyse as analyse
from estim.pipeline import sample_curve as sample_curve
from estim.propagation.inputs import Input as Input
from estim.propagation.linear import propagate_linear as propagate_linear
from estim.propagation.monte_carlo import propagate_monte_carlo as propagate_monte_carlo
from estim.propagation.uncertainty_budget import budget as budget
from estim.propagation.uncertainty_budget import budget_along as budget_along
from estim.propagation.validation import compare as compare
from estim.reports.analysis import analysis_report as analysis_report
from estim.reports.curve import curve_report as curve_report
from estim.reports.curve import write_curve_report as write_curve_report
from estim.reports.interop import summary_frame as summary_frame
from estim.reports.interop import to_datatree as to_datatree
from estim.reports.interop import to_frame as to_frame
from estim.reports.interop import to_netcdf as to_netcdf
from estim.reports.result import result_of as result_of
from estim.sampling.bands import posterior_bands as posterior_bands
from estim.sampling.chain import Target as Target
from estim.sampling.chain import sample_posterior as sample_posterior
from estim.studies.energy import energy_along as energy_along
from estim.studies.paper_band import propagated_bands as propagated_bands

__version__: str
