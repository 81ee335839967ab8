"""estim: uncertainty and Bayesian parameter estimation for lab experiments.  Start with `estim.pipeline`.

The names below are loaded when they are first used, so that `import estim` and `estim --help` are quick.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from estim.bands import posterior_bands
    from estim.budget import budget, budget_along
    from estim.campaign import Campaign, load_campaign
    from estim.curve_analysis import curve_report, sample_curve
    from estim.curve_problem import AxisNames
    from estim.diagnosis import diagnose
    from estim.energy import energy_along
    from estim.errors import EstimError, InputError
    from estim.fitting import fit_least_squares
    from estim.goodness import check_goodness
    from estim.inputs import Input
    from estim.interop import summary_frame, to_datatree, to_frame, to_netcdf
    from estim.line import LineFit, confidence_band, fit_line, inverse_prediction, prediction_band
    from estim.line_analysis import analyse_line
    from estim.line_intervals import slope_interval
    from estim.line_posterior import line_posterior
    from estim.monte_carlo import propagate_monte_carlo
    from estim.own_curve import CurveFit, fit_curve
    from estim.pipeline import Analysis, analyse
    from estim.propagated import propagated_bands
    from estim.propagation import propagate_linear
    from estim.report import analysis_report
    from estim.result import result_of
    from estim.sampling import Target, sample_posterior
    from estim.systematic import Component
    from estim.theta_min import read_theta_min
    from estim.validation import compare

_HOME = {
    "Analysis": "pipeline",
    "AxisNames": "curve_problem",
    "Campaign": "campaign",
    "Component": "systematic",
    "CurveFit": "own_curve",
    "EstimError": "errors",
    "Input": "inputs",
    "InputError": "errors",
    "LineFit": "line",
    "Target": "sampling",
    "analyse": "pipeline",
    "analyse_line": "line_analysis",
    "analysis_report": "report",
    "budget": "budget",
    "budget_along": "budget",
    "check_goodness": "goodness",
    "compare": "validation",
    "confidence_band": "line",
    "curve_report": "curve_analysis",
    "diagnose": "diagnosis",
    "energy_along": "energy",
    "fit_curve": "own_curve",
    "fit_least_squares": "fitting",
    "fit_line": "line",
    "inverse_prediction": "line",
    "line_posterior": "line_posterior",
    "load_campaign": "campaign",
    "posterior_bands": "bands",
    "prediction_band": "line",
    "propagate_linear": "propagation",
    "propagate_monte_carlo": "monte_carlo",
    "propagated_bands": "propagated",
    "read_theta_min": "theta_min",
    "result_of": "result",
    "sample_curve": "curve_analysis",
    "sample_posterior": "sampling",
    "slope_interval": "line_intervals",
    "summary_frame": "interop",
    "to_datatree": "interop",
    "to_frame": "interop",
    "to_netcdf": "interop",
}

__all__ = [
    "Analysis",
    "AxisNames",
    "Campaign",
    "Component",
    "CurveFit",
    "EstimError",
    "Input",
    "InputError",
    "LineFit",
    "Target",
    "analyse",
    "analyse_line",
    "analysis_report",
    "budget",
    "budget_along",
    "check_goodness",
    "compare",
    "confidence_band",
    "curve_report",
    "diagnose",
    "energy_along",
    "fit_curve",
    "fit_least_squares",
    "fit_line",
    "inverse_prediction",
    "line_posterior",
    "load_campaign",
    "posterior_bands",
    "prediction_band",
    "propagate_linear",
    "propagate_monte_carlo",
    "propagated_bands",
    "read_theta_min",
    "result_of",
    "sample_curve",
    "sample_posterior",
    "slope_interval",
    "summary_frame",
    "to_datatree",
    "to_frame",
    "to_netcdf",
]


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module 'estim' has no attribute {name!r}")
    return getattr(import_module(f"estim.{_HOME[name]}"), name)
