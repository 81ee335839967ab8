"""What the data constrain: the information of the data in units of the prior, direction by
direction.

Read this before quoting a parameter.  With P the prior standard deviations and D the Fisher
information of the data at the fit, the eigenvalues of P D P are the information of the data in
units of that of the prior along each direction:

    lambda >> 1   learnt from the data;      lambda << 1   what comes out is what the prior put in.

A uniform prior counts with its standard deviation, width/sqrt(12), although inside its edges it
does not pull at all: a direction in which no prior pulls and the data have no information is
"not identified".  The effective number of directions learnt is sum lambda/(1 + lambda)
(Spiegelhalter et al., J. R. Statist. Soc. B 64 (2002) 583, their p_D for a linear model).

Everything here is local (a Gaussian at the fit); `estim.fitting.profile` and
`estim.checks.prior_sensitivity` are not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray
from estim.common import Amount, Finding, Kind, phrase
from estim.fitting import Fit, known_from_data, prior_sds
from estim.words import describe

PRIOR_DOMINATED = 0.8  # posterior sd / prior sd above which the prior is most of what is known
# information of the data, in units of the prior's, below which a direction is the prior's
_ONLY_PRIOR = 1.0
_NO_PULL = 1e-6  # information of data and prior together, below which nothing holds a direction
_SHOWN = 0.2  # component of a unit direction that is worth stating


@dataclass(frozen=True, eq=False)
class Direction:
    """One combination of parameters.

    information : of the data along it, in units of that of the prior.
    vector : (n_par,) unit vector, components in prior standard deviations; the largest component is
        positive.
    prior_pull : curvature of the log prior along it, in the same units: about 1 for normal priors,
        0 for uniform ones.
    held_by : "data", "prior", or "nothing" (neither data nor prior: only edges of a range, if any).
    moves : the parameters that a step of one prior standard deviation along it changes, by how
        much, and `whole` the value where a share of it is meaningful.
        words : the same in a sentence.
    """

    information: float
    vector: FloatArray
    prior_pull: float
    held_by: str
    moves: tuple[Amount, ...]

    @property
    def words(self) -> str:
        kind = Kind.DIRECTION_LEARNT if self.held_by == "data" else Kind.DIRECTION_SILENT
        return describe(Finding(kind, size=self.information, parameters=self.moves))


@dataclass(frozen=True, eq=False)
class Identifiability:
    """What data and prior each contribute to the parameters of a fit.

    directions : n_par of them, that of least information first.
    sentences : the findings in words, gravest first.
    """

    directions: tuple[Direction, ...]
    sentences: tuple[str, ...]


def identify(fit: Fit) -> Identifiability:
    """What the data of `fit` constrain, direction by direction."""
    problem = fit.problem
    sds = prior_sds(problem, fit.cov)
    whitened = known_from_data(fit.posterior, fit.values).matrix * np.outer(sds, sds)
    values, vectors = np.linalg.eigh(whitened)
    values = np.maximum(values, 0.0)
    pulls = problem.prior_information(fit.values) * np.outer(sds, sds)
    responses = np.sqrt(np.diag(whitened))
    directions = tuple(
        _direction(fit, float(value), vector, float(vector @ pulls @ vector), sds, responses)
        for value, vector in zip(values, vectors.T, strict=True)
    )
    n_learnt = float(np.sum(values / (1.0 + values)))
    return Identifiability(directions, _sentences(directions, n_learnt))


def _direction(
    fit: Fit, value: float, vector: FloatArray, pull: float, sds: FloatArray, responses: FloatArray
) -> Direction:
    """One direction; of one without information those that compensate each other are named, however
    short their steps.

    responses : (n_par,) by how many times the noise one prior sd of each parameter moves the data.
    """
    vector = vector * np.sign(vector[np.argmax(np.abs(vector))])
    held_by = "data" if value >= _ONLY_PRIOR else "prior" if value + pull > _NO_PULL else "nothing"
    shares = np.abs(vector)
    if held_by != "data" and (alone := float(np.max(shares * responses))) >= 1.0:
        shares = np.maximum(shares, shares * responses / alone)
    return Direction(value, vector, pull, held_by, _moves(fit, vector, shares, sds))


def _moves(fit: Fit, vector: FloatArray, shares: FloatArray, sds: FloatArray) -> tuple[Amount, ...]:
    """A step of one prior standard deviation along a unit vector, largest share first."""
    moves = []
    for i in np.argsort(-shares, kind="stable"):
        if shares[i] < _SHOWN:
            break
        parameter = fit.problem.parameters[i]
        label, value = parameter.label, abs(float(fit.values[i]))
        # a percentage is meaningful only for a value that is well away from zero, and never for an
        # angle
        relative = label.factor == 1.0 and value > 3.0 * sds[i]
        moves.append(
            Amount(
                parameter.name, float(vector[i] * sds[i]), label, value if relative else math.nan
            )
        )
    return tuple(moves)


def _sentences(directions: tuple[Direction, ...], n_learnt: float) -> tuple[str, ...]:
    n = len(directions)
    free = [d for d in directions if d.held_by == "nothing"]
    prior = [d for d in directions if d.held_by == "prior"]
    sentences = [
        phrase("Constrained neither by the data nor by the prior: {words}.", words=d.words)
        for d in free
    ]
    count = {"learnt": n_learnt, "n": n}
    if free or prior:
        sentences.append(
            phrase(
                "The data constrain {learnt:.1f} of {n} combinations of the parameters; "
                "the rest comes from the values "
                "stated beforehand.",
                **count,
            )
        )
    else:
        sentences.append(
            phrase(
                "The data constrain {learnt:.1f} of {n} combinations of the parameters; "
                "every combination is determined by "
                "the data.",
                **count,
            )
        )
    sentences += [phrase("Constrained only by the prior: {words}.", words=d.words) for d in prior]
    return tuple(sentences)
