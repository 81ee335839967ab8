"""What is assumed: curves, priors, noise, and the density they make.  Read `posterior`, then `noise` (which sigma is which) and `likelihood`."""
from estim.problem.abscissas import hide_the_range
from estim.problem.curve import (
    EXACT,
    CommonError,
    Curve,
    Derived,
    Footing,
    LocalCurve,
    Motion,
    PositionCurve,
    SpeedCurve,
    SquaredCurve,
    Wording,
    plain_words,
)
from estim.problem.events import BINOMIAL, POISSON, Counted, Counts, Events, Law, counted_words
from estim.problem.likelihood import Ends, Likelihood, Noise, NormalErrors, Points, n_draws, reading_sd
from estim.problem.noise import STENCILS, CorrelatedErrors, Derivative, Differentiated, Independent, Linear, Named, Scale, Size, differentiate
from estim.problem.observations import MAX_LACKING, Lacks, Observations, Parameter, n_uses, shared_first, uses_of
from estim.problem.posterior import Group, Measure, Posterior, Problem, StackedPoints
from estim.problem.priors import PRIORS, Flat, HalfNormal, LogNormal, Normal, Prior, TruncatedNormal, Uniform, Unstated, Usual, as_prior
from estim.problem.readings import Correlated, Readings, check_covariance
from estim.problem.rooted import DENSE, Differences, Root, RootErrors, beside, covariance_of, in_bands, root_of, stacked_root, with_columns
from estim.problem.symmetry import Symmetry, folded, no_symmetry, same_curves
from estim.problem.tails import GAUSSIAN, Mixture, StudentT, Tails
