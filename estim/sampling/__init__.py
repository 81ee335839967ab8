"""Draws of a posterior: proposals, chains (`ensembles`: the only file that imports emcee), a second
computation, bands.

Read `chain` first, then `certificate`.
"""

from estim.sampling.bands import Bands, central_intervals, curve_draws, motion_end, posterior_bands
from estim.sampling.certificate import (
    MAX_PARAMETERS,
    MAX_TIED,
    Agreement,
    Certificate,
    certify,
    no_comparison,
    too_many,
)
from estim.sampling.certified import Certified, Optima, certified_chain, proposed_chain
from estim.sampling.chain import Chain, Progress, Target, sample_posterior
from estim.sampling.diagnostics import mcse_mean, mixing_of
from estim.sampling.importance import K_HAT_LIMIT, log_mean_uncertainty, pareto_smoothed
from estim.sampling.marginal_draws import marginal_chain
from estim.sampling.proposal import adapt_proposal
from estim.sampling.log_density import InCoordinates
from estim.sampling.summary import (
    Summary,
    interval_cell,
    lopsided,
    parameter_cells,
    summarise,
    summarise_parameter,
    trusted,
    value_cell,
)
