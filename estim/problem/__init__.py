"""What is assumed: curves, priors, noise, and the posterior density that they make.
Read `problem` first, then `noise` (which sigma is which).  Imports `common` alone."""

from estim.problem.abscissas import hide_the_range, true_abscissas
from estim.problem.curve import EXACT, CommonError, Curve, Derived, LocalCurve, SpeedCurve, Wording, plain_words
from estim.problem.derivative import STENCILS, Derivative, differentiate
from estim.problem.flat import Flat
from estim.problem.latent import LatentRun
from estim.problem.noise import Differentiated, Independent, Noise, Scale, covariance, noise_parameters, reading_sd, variances
from estim.problem.observations import Observations, Parameter, n_uses, shared_first
from estim.problem.priors import MEASURED, HalfNormal, LogNormal, Normal, Prior, TruncatedNormal, Uniform, as_prior
from estim.problem.problem import Posterior, Problem, informative
from estim.problem.readings import Correlated, Readings, check_covariance
from estim.problem.symmetry import Symmetry, folded, in_words, no_symmetry
from estim.problem.tails import GAUSSIAN, Mixture, StudentT, Tails
