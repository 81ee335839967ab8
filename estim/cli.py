"""The command line: the only file that prints or writes.  Heavy imports are local to the commands.

Exit codes: 0 the result is ok; 2 the input is wrong (one line on stderr); 3 a result is not ok (the report is written all
the same); 130 interrupted.
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from estim.errors import EstimError, InputError, NumericalError

if TYPE_CHECKING:
    from estim.campaign import Campaign
    from estim.energy import Drift, EnergyRecord
    from estim.pipeline import Analysis
    from estim.sampling import Progress

BAD_INPUT, NOT_OK, INTERRUPTED = 2, 3, 130

_RUNS = click.option("--run", "runs", multiple=True, metavar="NAME", help="This run only; may be given several times.  [default: every run]")
_JOINT = click.option("--joint", is_flag=True, help="Fit the runs together: what they share is one unknown.")
_STEPS = click.option("--max-steps", type=click.IntRange(min=400), default=20_000, show_default=True, help="Hard cap on the sampler's steps.")
_OUT = click.option(
    "--out", type=click.Path(path_type=Path, file_okay=False),
    help="Folder for the report, made if it is not there.  [default: out/ and the name of the campaign's folder]",
)
_SEED = click.option("--seed", type=click.IntRange(min=0), default=1, show_default=True, help="Seed of every random number.")


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(package_name="estim")
def cli() -> None:
    """Uncertainties and Bayesian parameter estimation for lab experiments.

    Start with `estim fit CAMPAIGN`: a campaign is one TOML file that says what was measured (docs/campaign.md).
    """


@cli.command()
@click.argument("campaign", type=click.Path(path_type=Path))
@_RUNS
@_JOINT
@_STEPS
@_OUT
@_SEED
def fit(campaign: Path, runs: tuple[str, ...], joint: bool, max_steps: int, out: Path | None, seed: int) -> None:
    """Fit runs of CAMPAIGN and write a report.

    Each run is fit by itself unless --joint is given.  Exit code 3 means that a result is not to be trusted; the
    report says why.
    """
    from estim.campaign import load_campaign
    from estim.pipeline import analyse
    from estim.report import analysis_report, index_report
    from estim.result import result_of
    from estim.sampling import Target

    loaded = load_campaign(campaign)
    folder = out or Path("out") / campaign.resolve().parent.name
    groups = _groups(loaded, runs, joint=joint)
    results = {}
    for group in groups:
        with _progress(", ".join(group), max_steps) as progress:
            analysis = analyse(loaded, group, seed=seed, target=Target(max_step=max_steps), progress=progress)
        place = folder if len(groups) == 1 else folder / group[0]
        _write(place, analysis_report(loaded, analysis))
        results[group[0]] = result_of(loaded, analysis)
        _conclude(", ".join(group), analysis.diagnosis.status, analysis.diagnosis.reasons)
    if len(groups) > 1:
        _write(folder, index_report(loaded, results))
    click.echo(f"report: {folder / 'report.md'}")
    if any(result.status != "ok" for result in results.values()):
        sys.exit(NOT_OK)


@cli.command()
@click.argument("campaign", type=click.Path(path_type=Path))
@_OUT
@_SEED
def line(campaign: Path, out: Path | None, seed: int) -> None:
    """Fit the theta_min line of CAMPAIGN: sin(theta_min) against sin(phi), whose slope is 1/gamma."""
    from estim.campaign import gamma_of_body, load_campaign
    from estim.line_analysis import analyse_line
    from estim.line_report import line_report
    from estim.sampling import Target
    from estim.theta_min import read_theta_min

    loaded = load_campaign(campaign)
    series = read_theta_min(loaded.source)
    target = Target()
    with _progress("line", target.max_step) as progress:
        analysis = analyse_line(series, gamma_masses=gamma_of_body(loaded, series.body), seed=seed, target=target, progress=progress)
    folder = out or Path("out") / campaign.resolve().parent.name / "line"
    _write(folder, line_report(loaded, analysis))
    _conclude("line", analysis.status, [finding.reason for finding in analysis.findings])
    click.echo(f"report: {folder / 'report.md'}")
    if analysis.status != "ok":
        sys.exit(NOT_OK)


def _groups(campaign: Campaign, runs: Iterable[str], *, joint: bool) -> list[tuple[str, ...]]:
    """The runs that are fit together.  Raises InputError where there is none."""
    names = tuple(dict.fromkeys(runs)) or campaign.run_names
    if not names:
        raise InputError("has no [[runs]] (estim line fits its theta_min series)", field="campaign", file=campaign.source.path)
    return [names] if joint else [(name,) for name in names]


@cli.command()
@click.argument("campaign", type=click.Path(path_type=Path))
@_RUNS
@_JOINT
@_STEPS
@_OUT
@_SEED
def energy(campaign: Path, runs: tuple[str, ...], joint: bool, max_steps: int, out: Path | None, seed: int) -> None:
    """Check the energy along the runs of CAMPAIGN: how much is lost, and is the loss steady?"""
    import numpy as np

    from estim.campaign import load_campaign
    from estim.energy import drift_of, energy_along
    from estim.energy_report import energy_report
    from estim.pipeline import analyse
    from estim.sampling import Target

    loaded = load_campaign(campaign)
    analyses: list[Analysis] = []
    records: list[EnergyRecord] = []
    drifts: list[Drift] = []
    for group in _groups(loaded, runs, joint=joint):
        with _progress(", ".join(group), max_steps) as progress:
            analyses.append(analyse(loaded, group, seed=seed, target=Target(max_step=max_steps), progress=progress))
        records.extend(energy_along(analyses[-1], rng=np.random.default_rng(seed)))
        drifts.append(drift_of(analyses[-1], rng=np.random.default_rng(seed)))
        _conclude(", ".join(group), analyses[-1].diagnosis.status, analyses[-1].diagnosis.reasons)
    folder = out or Path("out") / campaign.resolve().parent.name / "energy"
    _write(folder, energy_report(loaded, analyses, records, drifts, seed=seed))
    click.echo(f"report: {folder / 'report.md'}")
    if any(not analysis.diagnosis.ok for analysis in analyses):
        sys.exit(NOT_OK)


@cli.command()
@click.argument("campaign", type=click.Path(path_type=Path))
@_STEPS
@_OUT
@_SEED
def reanalyse(campaign: Path, max_steps: int, out: Path | None, seed: int) -> None:
    """Everything that CAMPAIGN says, in one report.

    The theta_min line, each run by itself, the runs of each body together, energies, the propagated band beside the
    posterior band, and published numbers beside reanalysed ones.
    """
    from estim.campaign import load_campaign
    from estim.reanalysis import reanalyse as run_reanalysis
    from estim.reanalysis_report import reanalysis_report
    from estim.sampling import Target

    loaded = load_campaign(campaign)
    result = run_reanalysis(loaded, seed=seed, target=Target(max_step=max_steps), progress_of=lambda what: _announced(what, max_steps))
    folder = out or Path("out") / campaign.resolve().parent.name
    _write(folder, reanalysis_report(result))
    for what, status in result.statuses.items():
        _conclude(what, status, ())
    click.echo(f"report: {folder / 'report.md'}")
    if any(status != "ok" for status in result.statuses.values()):
        sys.exit(NOT_OK)


@cli.command()
@click.argument("campaign", type=click.Path(path_type=Path))
@_RUNS
@_JOINT
@click.option("--simulations", type=click.IntRange(min=20), default=200, show_default=True, help="Simulated campaigns for each question.")
@click.option("--what", type=click.Choice(["sbc", "coverage", "both"]), default="both", show_default=True, help="Truths from the priors, or the fit.")
@click.option("--jobs", type=click.IntRange(min=1), help="Processes.  [default: one for each core]")
@_OUT
@_SEED
def calibrate(
    campaign: Path, runs: tuple[str, ...], joint: bool, simulations: int, what: str, jobs: int | None, out: Path | None, seed: int
) -> None:
    """Check on simulated data whether the intervals for CAMPAIGN hold the truth as often as they say.

    Exit code 3 means that they do not; the report says which one is too narrow, too wide or biased.
    """
    import numpy as np

    from estim.calibration import coverage, coverage_sentence, findings, simulation_based_calibration
    from estim.calibration_report import calibration_report
    from estim.campaign import load_campaign
    from estim.fitting import fit_least_squares
    from estim.synthetic import campaign_design

    loaded = load_campaign(campaign)
    folder = out or Path("out") / campaign.resolve().parent.name / "calibration"
    groups, trusted = _groups(loaded, runs, joint=joint), True
    chosen = {"sbc": simulation_based_calibration, "coverage": coverage}
    for group in groups:
        fit = fit_least_squares(loaded.problem(group), rng=np.random.default_rng(seed))
        design = campaign_design(loaded, group, fitted=fit.values)
        calibrations = []
        for kind in ("sbc", "coverage") if what == "both" else (what,):
            with _count(f"{', '.join(group)}: {kind}", simulations) as progress:
                calibrations.append(
                    chosen[kind](design, fit, n_trial=simulations, seed=seed, jobs=jobs or os.cpu_count() or 1, progress=progress)
                )
        place = folder if len(groups) == 1 else folder / group[0]
        _write(place, calibration_report(loaded, calibrations))
        for calibration in calibrations:
            found = findings(calibration)
            trusted = trusted and not found
            said = [] if calibration.what == "sbc" else [coverage_sentence(calibration, name) for name in calibration.reported]
            _conclude(f"{', '.join(group)}, {calibration.what}", "not-calibrated" if found else "ok", [*(f.sentence for f in found), *said])
        click.echo(f"report: {place / 'report.md'}")
    if not trusted:
        sys.exit(NOT_OK)


@contextmanager
def _count(what: str, total: int) -> Iterator[Callable[[int], None]]:
    """A progress bar on stderr for a number of equal pieces of work."""
    from tqdm import tqdm

    with tqdm(total=total, desc=what, unit="campaign", leave=False, disable=None, dynamic_ncols=True) as bar:

        def show(done: int) -> None:
            bar.update(done - bar.n)

        yield show


def _conclude(what: str, status: str, reasons: Iterable[str]) -> None:
    click.echo(f"{what}: {status}")
    for reason in reasons:
        click.echo(f"  {reason}")


@cli.command()
@click.argument("design", type=click.Path(path_type=Path))
@click.option("--out", required=True, type=click.Path(path_type=Path, file_okay=False), help="Folder for the campaign.")
def simulate(design: Path, out: Path) -> None:
    """Make a SYNTHETIC campaign from DESIGN (a TOML file): runs, theta_min series, campaign.toml and the truth."""
    from estim.design import load_design, simulate_campaign

    files = simulate_campaign(load_design(design))
    _write(out, {name: text.encode() for name, text in files.items()})
    click.echo(f"synthetic campaign: {out / 'campaign.toml'} ({len(files)} files)")


@contextmanager
def _announced(what: str, max_steps: int) -> Iterator[Progress]:
    """A progress bar, and a line when it is done, for a command of several minutes."""
    with _progress(what, max_steps) as progress:
        yield progress
    click.echo(f"sampled: {what}")


@contextmanager
def _progress(what: str, max_steps: int) -> Iterator[Progress]:
    """A progress bar on stderr that says what sampling still lacks."""
    from tqdm import tqdm

    with tqdm(total=max_steps, desc=what, unit="step", leave=False, disable=None, dynamic_ncols=True) as bar:

        def show(step: int, message: str) -> None:
            bar.n = step
            bar.set_postfix_str(message[:60], refresh=True)

        yield show


def _write(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write every file whole: to a temporary name beside it, then renamed into place."""
    for name, data in files.items():
        path = folder / name
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
            try:
                with os.fdopen(handle, "wb") as stream:
                    stream.write(data)
                os.chmod(temporary, 0o644)
                os.replace(temporary, path)
            except BaseException:
                os.unlink(temporary)
                raise
        except OSError as error:
            raise EstimError(f"{path}: cannot be written ({(error.strerror or str(error)).lower()})") from None


def main() -> None:
    """Entry point: one line on stderr and an exit code in place of a traceback."""
    try:
        status = cli.main(standalone_mode=False)
    except click.exceptions.Abort:
        click.echo("interrupted", err=True)
        sys.exit(INTERRUPTED)
    except click.ClickException as error:
        click.echo(f"error: {error.format_message()}".replace("\n", " "), err=True)
        sys.exit(BAD_INPUT)
    except NumericalError as error:
        click.echo(f"error: {error}", err=True)
        sys.exit(NOT_OK)
    except EstimError as error:
        click.echo(f"error: {error}", err=True)
        sys.exit(BAD_INPUT)
    sys.exit(status if isinstance(status, int) else 0)


if __name__ == "__main__":
    main()
