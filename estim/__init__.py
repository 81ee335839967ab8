"""estim: uncertainty and Bayesian parameter estimation for lab experiments.  Start with `estim.pipeline`.

The names below are loaded when they are first used, so that `import estim` and `estim --help` are quick.  None of them is the
name of a file in this folder: importing a file binds its name here, and would put the module in the place of the function.
"""

from __future__ import annotations

from importlib import import_module

TYPE_CHECKING = False  # not of `typing`, which a file beside the data may stand for until `estim.__main__` has looked
if TYPE_CHECKING:
    from estim.campaign.campaign import Campaign, load_campaign
    from estim.checks.diagnosis import diagnose
    from estim.checks.goodness import check_goodness
    from estim.common.errors import EstimError, InputError
    from estim.curve_fit import CurveFit, fit_curve
    from estim.curve_fits import fit_curves
    from estim.curves.counting import Binomial, EventTimes, Poisson
    from estim.curves.differential import ode
    from estim.curves.joining import DataSet
    from estim.curves.posing import AxisNames
    from estim.curves.shared_errors import Component
    from estim.fitting.least_squares import fit_least_squares
    from estim.line.analysis import analyse_line
    from estim.line.interval import slope_interval
    from estim.line.least_squares import LineFit, confidence_band, fit_line, inverse_prediction, prediction_band
    from estim.line.posterior import line_posterior
    from estim.line.series import read_theta_min
    from estim.pipeline import Analysis, analyse, sample_curve
    from estim.propagation.inputs import Input
    from estim.propagation.linear import propagate_linear
    from estim.propagation.monte_carlo import propagate_monte_carlo
    from estim.propagation.uncertainty_budget import budget, budget_along
    from estim.propagation.validation import compare
    from estim.reports.analysis import analysis_report
    from estim.reports.curve import curve_report, write_curve_report
    from estim.reports.interop import summary_frame, to_datatree, to_frame, to_netcdf
    from estim.reports.result import result_of
    from estim.sampling.bands import posterior_bands
    from estim.sampling.chain import Target, sample_posterior
    from estim.studies.energy import energy_along
    from estim.studies.paper_band import propagated_bands

_HOME = {
    "Analysis": "pipeline",
    "AxisNames": "curves.posing",
    "Binomial": "curves.counting",
    "Campaign": "campaign.campaign",
    "Component": "curves.shared_errors",
    "CurveFit": "curve_fit",
    "DataSet": "curves.joining",
    "EstimError": "common.errors",
    "EventTimes": "curves.counting",
    "Input": "propagation.inputs",
    "InputError": "common.errors",
    "LineFit": "line.least_squares",
    "Poisson": "curves.counting",
    "Target": "sampling.chain",
    "analyse": "pipeline",
    "analyse_line": "line.analysis",
    "analysis_report": "reports.analysis",
    "budget": "propagation.uncertainty_budget",
    "budget_along": "propagation.uncertainty_budget",
    "check_goodness": "checks.goodness",
    "compare": "propagation.validation",
    "confidence_band": "line.least_squares",
    "curve_report": "reports.curve",
    "diagnose": "checks.diagnosis",
    "energy_along": "studies.energy",
    "fit_curve": "curve_fit",
    "fit_curves": "curve_fits",
    "fit_least_squares": "fitting.least_squares",
    "fit_line": "line.least_squares",
    "inverse_prediction": "line.least_squares",
    "line_posterior": "line.posterior",
    "load_campaign": "campaign.campaign",
    "ode": "curves.differential",
    "posterior_bands": "sampling.bands",
    "prediction_band": "line.least_squares",
    "propagate_linear": "propagation.linear",
    "propagate_monte_carlo": "propagation.monte_carlo",
    "propagated_bands": "studies.paper_band",
    "read_theta_min": "line.series",
    "result_of": "reports.result",
    "sample_curve": "pipeline",
    "sample_posterior": "sampling.chain",
    "slope_interval": "line.interval",
    "summary_frame": "reports.interop",
    "to_datatree": "reports.interop",
    "to_frame": "reports.interop",
    "to_netcdf": "reports.interop",
    "write_curve_report": "reports.curve",
}

__all__ = [
    "Analysis",
    "AxisNames",
    "Binomial",
    "Campaign",
    "Component",
    "CurveFit",
    "DataSet",
    "EstimError",
    "EventTimes",
    "Input",
    "InputError",
    "LineFit",
    "Poisson",
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
    "fit_curves",
    "fit_least_squares",
    "fit_line",
    "inverse_prediction",
    "line_posterior",
    "load_campaign",
    "ode",
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
    "write_curve_report",
]


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module 'estim' has no attribute {name!r}")
    try:
        return getattr(import_module(f"estim.{_HOME[name]}"), name)
    except ImportError as error:
        from estim.namesakes import in_the_way, namesake_behind

        file = namesake_behind(error)
        if file:
            raise ImportError(in_the_way(file)) from error
        raise


def __dir__() -> list[str]:
    return list(__all__)
