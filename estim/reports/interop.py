"""Results for other programs: an xarray DataTree in the layout of ArviZ, its netCDF file, and
pandas tables.

- `to_datatree(analysis)`: what ArviZ reads (`arviz_stats.summary`, `arviz_stats.loo`, the plots).
  Needs the extra `arviz`.
- `to_netcdf(analysis)`: the same as the bytes of a netCDF-4 file, `draws.nc` of `estim fit`;
  `xarray.open_datatree` reads it.
- `to_frame(analysis)`, `summary_frame(result)`: draws and summaries as pandas tables.  Need pandas.

Without any of them there is `result.json` (`estim.analysis_report`), and
`analysis.chain.flat` is a plain array.

Chains and draws.  Walkers of one ensemble move by each other, so `chain` is an ensemble: R-hat then
compares ensembles, as ours does.  `draw` runs through the earlier half of an ensemble's draws, then
the later, and within each half walker by walker in the order of the steps.  So the two halves into
which ArviZ splits a chain are the halves in time, and draws that follow each other belong to one
walker: for an even number of steps R-hat is exactly ours (for an odd number ours leaves out the
first step), and effective sample sizes agree with ours to about ten per cent.  (Step by step, with
neighbours from different walkers, ArviZ would find no autocorrelation and take every draw for an
independent one.)  The coordinates `step` and `walker` give the origin of a draw.
"""

from __future__ import annotations

import math
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from estim.arrays import FloatArray
from estim.common import InputError, Stream, one_line, phrase, stream
from estim.pipeline import Analysis
from estim.reports.result import Result, software_versions

if TYPE_CHECKING:
    import pandas as pd
    import xarray

HOW_TO_GET = 'pip install "estim[arviz]"'
_NETCDF = ("xarray", "h5netcdf", "h5py")
_PRIOR_DRAWS = 4000


def can_write_netcdf() -> bool:
    """Whether the packages of the extra `arviz` are there."""
    return all(find_spec(package) is not None for package in _NETCDF)


def to_datatree(analysis: Analysis) -> xarray.DataTree:
    """The analysis as an xarray DataTree in ArviZ's layout; SI units and radians, in each
    variable's attribute `units`.

    posterior : each parameter by its name ("gamma[heavy]"), (chain, draw).
    sample_stats : `lp` (chain, draw), log posterior density up to the evidence; `acceptance`
        (chain,), share of accepted moves.
    log_likelihood : each run by its name, (chain, draw, point[RUN]): log density of every point
        given the others of its run (`Posterior.pointwise`), as leave-one-out takes it, for at most
        2000 draws, evenly spread (fewer for more than 300 points); left out for more than 10000
        points, of which it would be hundreds of megabytes.
    observed_data : each run by its name, what was fit.
    constant_data : its abscissas `x[RUN]`, and times `t[RUN]` if there are any.
    prior : independent draws of each prior (chain, draw); a parameter whose prior is improper has
        none.
    attributes : title, kind ("SYNTHETIC" in capitals), status, reasons, seed, how chains were made,
        versions.

    The draws are there whatever the status is: look at it before you use them.  Raises InputError
    where xarray is missing.

    >>> from estim import Target, fit_curve, sample_curve, to_datatree
    >>> fit = fit_curve("a*x + b", [0, 1, 2, 3, 4], [1.0, 3.1, 4.9, 7.2, 9.0], u_y=0.1)
    >>> tree = to_datatree(sample_curve(fit, seed=1, target=Target(ess=400.0)))
    >>> sorted(tree["posterior"].data_vars)
    ['a', 'b']
    """
    _require("xarray")
    from xarray import DataTree

    return DataTree.from_dict(_groups(analysis))


def to_netcdf(analysis: Analysis) -> bytes:
    """`to_datatree(analysis)` as a netCDF-4 file.  Raises InputError where a package of the extra
    `arviz` is missing.

    >>> from estim import Target, fit_curve, sample_curve, to_netcdf
    >>> fit = fit_curve("a*x + b", [0, 1, 2, 3, 4], [1.0, 3.1, 4.9, 7.2, 9.0], u_y=0.1)
    >>> data = to_netcdf(sample_curve(fit, seed=1, target=Target(ess=400.0)))
    >>> data[1:4]  # to be written into draws.nc
    b'HDF'
    """
    _require(*_NETCDF)
    return bytes(to_datatree(analysis).to_netcdf(engine="h5netcdf"))


def to_frame(analysis: Analysis) -> pd.DataFrame:
    """The draws, a row each and a column a parameter; the index says ensemble, step after burn-in,
    and walker.

    SI units and radians: `frame.attrs["units"]` maps names to units, the other attributes are
    title, kind, status and reasons.  Raises InputError where pandas is missing.

    analysis : of a campaign or of a curve.

    >>> from estim import Target, fit_curve, sample_curve, to_frame
    >>> fit = fit_curve("a*x + b", [0, 1, 2, 3, 4], [1.0, 3.1, 4.9, 7.2, 9.0], u_y=0.1)
    >>> frame = to_frame(sample_curve(fit, seed=1, target=Target(ess=400.0)))
    >>> list(frame.columns)
    ['a', 'b']
    """
    _require("pandas")
    from pandas import DataFrame, MultiIndex

    chain = analysis.chain
    frame = DataFrame(
        chain.flat,
        index=MultiIndex.from_product(
            [range(n) for n in chain.draws.shape[:3]], names=["ensemble", "step", "walker"]
        ),
        columns=list(chain.names),
    )
    frame.attrs.update(
        units={p.name: p.unit for p in analysis.problem.parameters}, **_title_and_status(analysis)
    )
    return frame


def summary_frame(result: Result) -> pd.DataFrame:
    """The parameters of a result, a row each: unit, meaning, mean, sd, quantiles, prior,
    diagnostics; NaN where the status allows no number.

    limit : "upper" or "lower" for a parameter whose most probable value is an edge of its prior,
        else "": then `limit_95` holds with 95 % probability, and there is no mean and sd.

    Raises InputError where pandas is missing.

    >>> from estim import Target, analyse, load_campaign, result_of, summary_frame
    >>> campaign = load_campaign("data/gallery/hubble.toml", only="with-intercept")
    >>> analysis = analyse(campaign, ["with-intercept"], seed=1, target=Target(ess=400.0))
    >>> frame = summary_frame(result_of(campaign, analysis))
    >>> frame.loc["H", "unit"]
    'km/s/Mpc'
    """
    _require("pandas")
    from pandas import DataFrame

    rows = {
        name: msgspec.structs.asdict(p)
        | {"limit": p.limit.side if p.limit else "", "limit_95": p.limit and p.limit.limit_95}
        for name, p in result.parameters.items()
    }
    frame = DataFrame.from_dict(rows, orient="index")
    numbers = [
        c
        for c in frame.columns
        if c not in ("unit", "meaning", "prior", "limit", "stated", "measured")
    ]
    frame[numbers] = frame[numbers].astype(float)
    frame.index.name = "parameter"
    frame.attrs.update(
        title=result.title,
        kind=_shown_kind(result.kind),
        status=result.status,
        reasons=list(result.reasons),
    )
    return frame


def time_halves_order(n_step: int, n_walker: int) -> NDArray[np.intp]:
    """(n_step * n_walker,) where each draw of an ensemble stands in time order (step, walker):
    earlier half, later half, each by walkers.
    """
    place = np.arange(n_step * n_walker)
    n_half = place.size // 2
    # an odd one out stays in the middle
    half = np.where(place < n_half, 0, np.where(place >= place.size - n_half, 2, 1))
    return np.lexsort((place, place % n_walker, half))


def _require(*packages: str) -> None:
    for package in packages:
        if find_spec(package) is None:
            raise InputError(f"is not installed: {HOW_TO_GET}", field=package)


def _shown_kind(kind: str) -> str:
    return "SYNTHETIC" if kind == "synthetic" else kind or "not stated"


def _title_and_status(analysis: Analysis) -> dict[str, Any]:
    return {
        "title": analysis.title,
        "kind": _shown_kind(analysis.kind),
        "status": str(analysis.diagnosis.status),
        "reasons": list(analysis.diagnosis.reasons),
    }


def _groups(analysis: Analysis) -> dict[str, xarray.Dataset]:
    from xarray import Dataset

    chain, runs = analysis.chain, analysis.problem.runs
    n_ensemble, n_step, n_walker, n_par = chain.draws.shape
    order, by_draw = time_halves_order(n_step, n_walker), ("chain", "draw")
    draws = chain.draws.reshape(n_ensemble, -1, n_par)[:, order]
    log_density = chain.log_density.reshape(n_ensemble, -1)[:, order]
    places = {
        "chain": np.arange(n_ensemble),
        "draw": np.arange(order.size),
        "step": ("draw", order // n_walker),
        "walker": ("draw", order % n_walker),
    }
    posterior = {
        _variable(p.name, "parameter"): (by_draw, draws[..., i], _about(p.unit, p.meaning))
        for i, p in enumerate(analysis.problem.parameters)
    }
    accepted = _about("1", phrase("fraction of accepted moves"))
    height = _about("1", phrase("log posterior density up to the evidence"))
    statistics = {
        "lp": (by_draw, log_density, height),
        "acceptance": ("chain", chain.acceptance, accepted),
    }
    observed = {
        _variable(run.name, "run"): (_dim(run.name), run.y, _about(run.y_unit, run.y_name))
        for run in runs
    }
    constant = {}
    for run in runs:
        constant[f"x[{run.name}]"] = (_dim(run.name), run.x, _about(run.x_unit, run.x_name))
        if run.t is not None:
            constant[f"t[{run.name}]"] = (_dim(run.name), run.t, _about("s", phrase("time")))
    groups = {
        "/": Dataset(attrs=_attributes(analysis)),
        "/posterior": Dataset(posterior, places),
        "/sample_stats": Dataset(statistics, places),
        "/prior": _prior(analysis),
        "/observed_data": Dataset(observed),
        "/constant_data": Dataset(constant),
    }
    if analysis.problem.n_obs <= 10_000:  # points
        groups["/log_likelihood"] = _log_likelihood(analysis, draws)
    return groups


def _attributes(analysis: Analysis) -> dict[str, Any]:
    attributes = _title_and_status(analysis) | {
        "title": one_line(analysis.title),
        "reasons": "\n".join(analysis.diagnosis.reasons),
        "seed": analysis.seed,
        "sampling": analysis.chain.convergence.message,
        "draws": phrase(
            "chain: ensemble of walkers; draw: first half, then second half of the steps, each "
            "walker by walker"
        ),
    }
    for package, number in software_versions().items():
        attributes[f"version_{package.replace('-', '_')}"] = number
    return attributes


def _log_likelihood(analysis: Analysis, draws: FloatArray) -> xarray.Dataset:
    """draws : (n_ensemble, n_draw, n_par)."""
    from xarray import Dataset

    n_chain, n_all, n_par = draws.shape
    # of the log likelihood of every point: draws, and draws times points
    n_draw = min(2000, max(400, 600_000 // analysis.problem.n_obs))
    indices = np.unique(np.linspace(0, n_all - 1, max(1, n_draw // n_chain)).astype(int))
    pointwise = analysis.fit.posterior.pointwise(draws[:, indices].reshape(-1, n_par))
    about = _about("1", phrase("log density of a point given the other points of its run"))
    variables = {
        _variable(run.name, "run"): (
            ("chain", "draw", _dim(run.name)),
            terms.reshape(n_chain, indices.size, -1),
            about,
        )
        for run, terms in zip(analysis.problem.runs, pointwise, strict=True)
    }
    return Dataset(variables, {"chain": np.arange(n_chain), "draw": indices})


def _prior(analysis: Analysis) -> xarray.Dataset:
    from xarray import Dataset

    rng = stream(analysis.seed, Stream.PRIOR)
    variables, improper = {}, []
    for p in analysis.problem.parameters:
        if math.isfinite(p.prior.sd):
            about = _about(p.unit, p.meaning) | {"prior": p.prior.describe()}
            drawn = p.prior.draw(rng, _PRIOR_DRAWS)[None]
            variables[_variable(p.name, "parameter")] = (("chain", "draw"), drawn, about)
        else:
            improper.append(p.name)
    places = {"chain": np.zeros(1, dtype=int), "draw": np.arange(_PRIOR_DRAWS)}
    return Dataset(variables, places, {"improper": ", ".join(improper)})


def _variable(name: str, what: str) -> str:
    """The name of a variable: that of the parameter or run, but "parameter chain" where a
    coordinate bears it already.
    """
    return f"{what} {name}" if name in ("chain", "draw", "step", "walker") else name


def _dim(run: str) -> str:
    return f"point[{run}]"


def _about(unit: str, meaning: str) -> dict[str, str]:
    return {"units": one_line(unit), "long_name": one_line(meaning)}  # HDF5 takes no null character
