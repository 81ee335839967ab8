"""Quantities that vary between runs: `between_runs = {phi_deg = 0.2}` under [shared] or a body.

The value of each run is that of the quantity plus a normal deviation whose standard deviation is
inferred: half-normal beforehand, of the scale that is stated.  The quantity itself is then the mean
of the runs.  Sampled as mean, spread and one standard normal shift a run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from estim.campaign.campaign_file import RunTable
from estim.campaign.lookup_levels import Levels
from estim.campaign.quantities import QuantityKind
from estim.common import Notation, phrase
from estim.problem import HalfNormal, Normal, Observations, Parameter, shift_of, spread_of

KEY = "between_runs"


@dataclass(frozen=True)
class BetweenRunSpread:
    """How a quantity varies.  name : of the parameter of its standard deviation.  scale : of its
    half-normal prior, SI.
    """

    quantity: str
    kind: QuantityKind
    name: str
    scale: float


def spreads_of(levels: Levels, kinds: Mapping[str, QuantityKind]) -> dict[str, BetweenRunSpread]:
    """Quantity -> how it varies, by the most particular level that states it; not those that the
    run states for itself.

    Raises InputError at the key's line for what is no quantity, stands at a run, or has nothing to
    vary: fewer than two of several runs take the quantity from there.
    """
    of_key = {key: (quantity, kind) for quantity, kind in kinds.items() for key in kind.keys}
    spreads: dict[str, BetweenRunSpread] = {}
    for level in levels:
        for key, scale in (getattr(level.table, KEY) or {}).items():
            path = (*level.path, KEY, key)
            if level.path[0] == "runs":
                raise levels.error(
                    "belongs under [shared] or a body, whose runs it is about", (*level.path, KEY)
                )
            if key not in of_key:
                raise levels.error(f"must name a quantity ({', '.join(sorted(of_key))})", path)
            quantity, kind = of_key[key]
            runs = [
                run
                for run in levels.source.runs
                if level.path[0] == "shared" or run.body == level.path[1]
            ]
            taking = sum(not _is_stated_by(run, kind) for run in runs)
            if taking < 2 <= len(runs):
                raise levels.error(
                    f"has nothing to vary: {taking} of {len(runs)} runs take it from here, "
                    "the others state their own",
                    path,
                )
            spreads.setdefault(
                quantity,
                BetweenRunSpread(
                    quantity, kind, f"{quantity}_spread{level.suffix}", scale * kind.keys[key]
                ),
            )
    return {
        quantity: spread
        for quantity, spread in spreads.items()
        if not _is_stated_by(levels.run, spread.kind)
    }


def varied(
    runs: Sequence[Observations], spreads: Mapping[str, Mapping[str, BetweenRunSpread]]
) -> tuple[tuple[Parameter, ...], tuple[Observations, ...]]:
    """The runs with values of their own where several of them share a spread, and the unknowns that
    these need.

    spreads : run -> quantity -> how it varies.  A run that is fit alone has one value, and nothing
        that it could vary about.
    """
    names = [spread.name for run in runs for spread in spreads[run.name].values()]
    unknowns: dict[str, Parameter] = {}
    changed = []
    for run in runs:
        run_spreads = {
            quantity: spread
            for quantity, spread in spreads[run.name].items()
            if names.count(spread.name) > 1
        }
        for spread in run_spreads.values():
            unknowns.setdefault(spread.name, _of_spread(spread))
        for quantity, spread in run_spreads.items():
            shift = f"{quantity}_shift[{run.name}]"
            notation = Notation(f"z({spread.kind.notation.symbol})")
            meaning = phrase(
                "{meaning}: deviation of this run from the mean, in standard deviations "
                "between runs",
                meaning=spread.kind.meaning,
            )
            unknowns[shift] = Parameter(shift, "1", Normal(0.0, 1.0), meaning, notation)
        changed.append(_varying(run, run_spreads) if run_spreads else run)
    return tuple(unknowns.values()), tuple(changed)


def _of_spread(spread: BetweenRunSpread) -> Parameter:
    kind = spread.kind
    notation = Notation(f"s({kind.notation.symbol})", kind.notation.unit, kind.notation.factor)
    meaning = phrase("{meaning}: standard deviation between runs", meaning=kind.meaning)
    return Parameter(
        spread.name, kind.unit, HalfNormal(spread.scale), meaning, notation, between=True
    )


def _varying(run: Observations, own: Mapping[str, BetweenRunSpread]) -> Observations:
    further = {spread_of(quantity): spread.name for quantity, spread in own.items()}
    further |= {shift_of(quantity): f"{quantity}_shift[{run.name}]" for quantity in own}
    return replace(run, arguments={**run.arguments, **further})


def _is_stated_by(run: RunTable, kind: QuantityKind) -> bool:
    return any(getattr(run, key) is not None for key in kind.keys)
