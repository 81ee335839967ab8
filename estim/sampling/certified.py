"""A chain and the second computation that it is compared with.

Two computations of the same thing may differ by chance: one pair in 2000 is called
(`compare_with_chain`).  Where one is, both are done once more with other random numbers.  A
difference that comes back is reported; one that does not was chance, and the second pair is the
result.  Where Monte-Carlo errors are too large for a verdict, both are done once more with more
draws.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from estim.arrays import FloatArray, all_finite
from estim.common import Kind, Stream, phrase, stream
from estim.discrepancy import NormalParts
from estim.problem import Coordinates
from estim.sampling.certificate import Agreement, Certificate, compare_with_chain
from estim.sampling.chain import Chain, Progress, Target, sample_posterior
from estim.sampling.independent_check import second_opinion
from estim.sampling.log_density import Density, InCoordinates, Support
from estim.sampling.parts_proposal import proposal_of_parts
from estim.sampling.proposal import Proposal, adapt_proposal


@dataclass(frozen=True, eq=False)
class Optima:
    """Where a density is known to be high: the fit, its covariance, and further optima.

    starts, covs : of the further ones, for the proposal.
    modes : those of a share that counts, whose ridges are followed.
    parts : normal distributions that the density is nearly made of, where they are known.
    """

    value: FloatArray
    cov: FloatArray
    starts: Sequence[FloatArray] = ()
    covs: Sequence[FloatArray] = ()
    modes: Sequence[FloatArray] = ()
    parts: NormalParts | None = None

    def adapted(
        self, density: Density, rng: np.random.Generator, *, n_round: int = 2000
    ) -> Proposal:
        """A proposal adapted to `density` from these, with so many draws in each round."""
        return adapt_proposal(
            density,
            self.value,
            self.cov,
            rng=rng,
            starts=self.starts,
            covs=self.covs,
            n_round=n_round,
        )

    def of(self, coordinates: Coordinates) -> Optima:
        """The same in coordinates."""

        def transformed(cov: FloatArray, value: FloatArray) -> FloatArray:
            unit = coordinates.slopes(value)
            return cov / np.outer(unit, unit)

        finite = [k for k, start in enumerate(self.starts) if all_finite(coordinates.of(start))]
        return Optima(
            coordinates.of(self.value),
            transformed(self.cov, self.value),
            [coordinates.of(self.starts[k]) for k in finite],
            [transformed(self.covs[k], self.starts[k]) for k in finite],
            [point for mode in self.modes if all_finite(point := coordinates.of(mode))],
        )


@dataclass(frozen=True, eq=False)
class Certified:
    """Draws, the same posterior without a chain (None where there are too many parameters for it),
    and whether both agree.
    """

    chain: Chain
    certificate: Certificate | None
    comparison: Agreement

    def in_values(self, density: InCoordinates) -> Certified:
        """Draws of coordinates as draws of values; the comparison, of ranks, stays."""
        values, certificate = density.coordinates.values, self.certificate
        draws = values(self.chain.draws)
        heights = self.chain.log_density - density.coordinates.log_volume(draws)
        if certificate is not None:
            resampled = values(certificate.draws)
            sd, ess = np.std(resampled, axis=0), min(certificate.ess, len(resampled))
            certificate = replace(
                certificate,
                mean=np.mean(resampled, axis=0),
                sd=sd,
                mcse_mean=sd / math.sqrt(ess),
                mcse_sd=sd / math.sqrt(2.0 * ess),
                quantiles={p: values(ends) for p, ends in certificate.quantiles.items()},
                draws=resampled,
                log_density=certificate.log_density - density.coordinates.log_volume(resampled),
            )
        return replace(
            self,
            chain=replace(self.chain, draws=draws, log_density=heights),
            certificate=certificate,
        )


def certified_chain(
    density: Density,
    optima: Optima,
    *,
    target: Target,
    seed: int,
    most: int,
    support: Support | None,
    coordinates: Coordinates | None = None,
    progress: Progress | None = None,
) -> Certified:
    """Draws of `density` with a second opinion.

    most : parameters beyond which there is no verdict.
    coordinates : in which it is sampled; as it is if None.

    Raises NumericalError where the density is not a number.
    """
    if coordinates is not None and np.any(coordinates.by_size):
        transformed = InCoordinates(density, coordinates)
        ends = None if support is None else (coordinates.of(support[0]), coordinates.of(support[1]))
        return certified_chain(
            transformed,
            optima.of(coordinates),
            target=target,
            seed=seed,
            most=most,
            support=ends,
            progress=progress,
        ).in_values(transformed)
    pairs: list[Certified] = []
    for i in range(2):
        if progress is not None:
            progress(
                0,
                phrase("second opinion")
                if not pairs
                else phrase("chain and second opinion: both are repeated"),
            )
        repeat = (i,) if i else ()
        rng = stream(seed, Stream.PROPOSAL, *repeat)
        certificate, proposal = second_opinion(
            density,
            optima.value,
            optima.cov,
            optima.adapted(density, rng),
            rng=rng,
            starts=optima.modes,
            support=support,
        )
        chain = sample_posterior(
            density,
            optima.value,
            optima.cov,
            target=target,
            rng=stream(seed, Stream.CHAIN, *repeat),
            progress=progress,
            proposal=proposal,
        )
        pairs.append(
            Certified(chain, certificate, compare_with_chain(certificate, chain, most=most))
        )
        if _too_coarse(pairs[-1].comparison):
            # times as many effective draws, where Monte-Carlo errors hide a difference
            target = replace(target, ess=2.0 * target.ess)
        elif pairs[-1].comparison.verdict != "disagree" or not chain.convergence.met:
            break
    first, last = pairs[0], pairs[-1]
    if _too_coarse(first.comparison):
        return last
    if len(pairs) == 1 or last.comparison.verdict == "missing":
        return first
    return replace(last, comparison=_after(first.comparison, last.comparison))


def _too_coarse(comparison: Agreement) -> bool:
    """Whether there is no verdict because the Monte-Carlo errors are too large."""
    return any(finding.kind == Kind.ERRORS_TOO_LARGE for finding in comparison.findings)


def proposed_chain(
    density: Density, optima: Optima, *, target: Target, seed: int, progress: Progress | None = None
) -> Chain:
    """A chain without a second computation, for more parameters than that is made for; most of its
    moves propose from an adapted proposal.

    Raises NumericalError where the density is not a number.
    """
    proposal = None
    # of more parameters, hardly a draw of a proposal is accepted
    if optima.value.size <= 40:
        if progress is not None:
            progress(0, phrase("proposal"))
        rng = stream(seed, Stream.PROPOSAL)
        if optima.parts is not None:
            proposal = proposal_of_parts(density, optima.parts, optima.value, rng=rng)
        proposal = proposal or optima.adapted(density, rng)
    return sample_posterior(
        density,
        optima.value,
        optima.cov,
        target=target,
        rng=stream(seed, Stream.CHAIN),
        progress=progress,
        proposal=proposal,
    )


def _after(first: Agreement, last: Agreement) -> Agreement:
    """`last`, with the largest difference of the first pair stated beside it."""
    errors = first.findings[0].parts[0].numbers["errors"]
    return replace(
        last,
        findings=tuple(
            replace(finding, numbers={**finding.numbers, "before": errors})
            for finding in last.findings
        ),
    )
