"""estim: uncertainty and Bayesian parameter estimation for lab experiments.  Start with `estim.pipeline`.

The names below are loaded when they are first used, so that `import estim` and `estim --help` are quick.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from estim.bands import posterior_bands
    from estim.campaign import Campaign, load_campaign
    from estim.diagnosis import diagnose
    from estim.errors import EstimError, InputError
    from estim.fitting import fit_least_squares
    from estim.goodness import check_goodness
    from estim.pipeline import Analysis, analyse
    from estim.report import analysis_report
    from estim.result import result_of
    from estim.sampling import Target, sample_posterior

_HOME = {
    "Analysis": "pipeline",
    "Campaign": "campaign",
    "EstimError": "errors",
    "InputError": "errors",
    "Target": "sampling",
    "analyse": "pipeline",
    "analysis_report": "report",
    "check_goodness": "goodness",
    "diagnose": "diagnosis",
    "fit_least_squares": "fitting",
    "load_campaign": "campaign",
    "posterior_bands": "bands",
    "result_of": "result",
    "sample_posterior": "sampling",
}

__all__ = [
    "Analysis",
    "Campaign",
    "EstimError",
    "InputError",
    "Target",
    "analyse",
    "analysis_report",
    "check_goodness",
    "diagnose",
    "fit_least_squares",
    "load_campaign",
    "posterior_bands",
    "result_of",
    "sample_posterior",
]


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module 'estim' has no attribute {name!r}")
    return getattr(import_module(f"estim.{_HOME[name]}"), name)
