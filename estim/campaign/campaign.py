"""A campaign: its file, the tables of its runs, and the study that says what they measure."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType

from estim.campaign.binding import parts_fact
from estim.campaign.bodies import RollingStudy
from estim.campaign.campaign_file import CampaignFile, NoiseTable, RunTable, read_campaign_file
from estim.campaign.curve_models import CurveModel
from estim.campaign.derived import read_derived, with_derived
from estim.campaign.dialect_table import dialect_of
from estim.campaign.noise_models import Candidate
from estim.campaign.own_curve import read_curve_study
from estim.campaign.study import Study
from estim.campaign.truth import read_truth
from estim.common import InputError, code, kind_words, later, listed, markdown, phrase, table
from estim.curves import SoughtQuantity
from estim.explanation import Suspects
from estim.problem import Problem
from estim.reading import COLUMNS, Run, compare_intervals, is_timed_track, is_tracker_file, read_run

_HEADS = (later("run"), later("body"), later("file"), later("fitted points"), later("unknowns"))


@dataclass(frozen=True, eq=False)
class Campaign:
    """A campaign and the tables of its runs, read and checked.  `problem` poses the inference for
    some of its runs.

    truth : parameter -> true value, of synthetic data where it is known; no fit uses it.
    """

    source: CampaignFile
    tables: Mapping[str, Run]
    study: Study
    derived: tuple[SoughtQuantity, ...] = ()
    truth: Mapping[str, float] = field(default_factory=dict)

    @property
    def title(self) -> str:
        return self.source.title

    @property
    def kind(self) -> str:
        return self.source.kind

    @property
    def path(self) -> str:
        """The campaign file, as provenance names it."""
        return str(self.source.path)

    @property
    def sha256(self) -> str:
        """Digest of the campaign file."""
        return self.source.sha256

    def digests(self, names: Sequence[str]) -> tuple[object, ...]:
        """What decides the results of runs: the campaign file and their data, as digests, and the
        true values that reports show.
        """
        return (
            self.sha256,
            tuple((name, self.tables[name].sha256) for name in names),
            tuple(sorted(self.truth.items())),
        )

    @property
    def formula(self) -> str | None:
        """The user's own curve as written, None for a rolling body."""
        return self.study.formula

    def columns(self, names: Sequence[str]) -> str:
        """Which columns of the files of the runs `names` are x and y, in words; "" where their
        names are fixed.
        """
        return "; ".join(
            dict.fromkeys(filter(None, (self.study.columns(name, self.tables) for name in names)))
        )

    @property
    def published(self) -> Path | None:
        """The file of published numbers that the campaign names, if any."""
        return (
            None
            if self.source.published is None
            else self.source.path.parent / self.source.published
        )

    @property
    def run_names(self) -> tuple[str, ...]:
        return tuple(name for name in self.source.names if name in self.tables)

    def problem(
        self, names: Sequence[str], *, noise: NoiseTable | None = None, usual: bool = False
    ) -> Problem:
        """The joint problem of the runs `names`: what they share is one parameter.  Raises
        InputError.

        noise : in place of the noise tables of the campaign.
        usual : with the usual errors of length scale and clock where nothing is said of them, as an
            analysis has them.
        """
        if not names or len(set(names)) < len(names):
            raise InputError(
                "must name one run or several, each once",
                field="run",
                value=", ".join(names),
                file=self.source.path,
            )
        for name in names:
            if name not in self.run_names:
                raise InputError(
                    f"must name one of the runs ({', '.join(self.run_names)})",
                    field="run",
                    value=name,
                    file=self.source.path,
                )
        try:
            return with_derived(
                self.study.problem(names, self.tables, noise=noise, usual=usual),
                self.derived,
                self._bodies,
                self.study.unit_of,
            )
        except InputError as error:
            if error.file is not None or error.field not in {
                quantity.name for quantity in self.derived
            }:
                raise
            raise self.source.places.error(
                error.rule, ("derived", error.field), value=error.value
            ) from None

    @property
    def _bodies(self) -> dict[str, str | None]:
        return {name: self.study.body_of(name) for name in self.source.names}

    @contextmanager
    def placing(self, problem: Problem) -> Iterator[None]:
        """While a problem of this campaign is fit: an error has its place in the files."""
        try:
            yield
        except InputError as error:
            raise (
                error if error.file is not None else self.study.placed(error, problem, self.tables)
            ) from None

    def suspects(self, names: Sequence[str]) -> Suspects:
        """The runs `names` as stated, and with each thing that they may have beside it."""
        return self.study.suspects(names, self.tables)

    def noise_models(self, name: str) -> tuple[Candidate, ...]:
        """The models of the noise that the data of a run allow.  Raises InputError where there is
        only one.
        """
        return self.study.noise_models(name, self.tables[name])

    def curve_models(self, names: Sequence[str]) -> tuple[CurveModel, ...]:
        """The models of the runs `names`, fit together, that can be compared, the simplest first.
        Raises InputError where there is only one.
        """
        self.problem(names)
        return self.study.curve_models(names, self.tables)

    def _repr_markdown_(self) -> str:
        """What a notebook shows: title, kind of data, and the runs with their points and
        unknowns.
        """
        rows = []
        for name in self.run_names:
            problem = self.problem([name])
            rows.append(
                (
                    name,
                    self.study.body_of(name) or "",
                    self.source.files[name],
                    f"{problem.n_obs}",
                    ", ".join(problem.names),
                )
            )
        parts = [
            f"**{markdown(self.title)}**",
            kind_words(self.kind),
            code(f"y = {self.formula}") if self.formula else "",
        ]
        return "\n\n".join([*filter(None, parts), table([phrase(head) for head in _HEADS], rows)])

    def require_unknowns(self, problem: Problem, *, drawn: bool = False) -> None:
        """Raises InputError where every quantity of a problem of this campaign is exact, or
        (`drawn`) a prior cannot be drawn from.
        """
        if not problem.parameters:
            rule = (
                "leaves nothing to fit: every quantity is exact; give at least one an "
                "uncertainty or a prior"
            )
            name = problem.runs[0].name
            raise self.source.places.error(
                rule, self.study.place_of_unknowns(name), field=f"run {name}"
            )
        if drawn:
            self.study.require_draws(problem)


def load_campaign(
    path: str | Path, *, only: str | None = None, asked: Collection[str] = ()
) -> Campaign:
    """The campaign in the TOML file at `path`, with the tables of its runs.

    only : the one run that is read, as if there were no other; None: all of them.
    asked : runs whose tables are wanted, all of them where it is empty; a track is compared with
        the others of the campaign that can be read, and says which cannot.

    Raises InputError with file, line, field, rule and value for whatever breaks a rule; every run
    that is wanted is posed as a problem once, so that a mistake in any of them shows at once.
    """
    source = read_campaign_file(Path(path))
    if only is not None:
        return bound(source, only=(only,))
    return bound(source, only=tuple(asked), compared=True) if asked else bound(source)


def bound(
    source: CampaignFile, *, only: Collection[str] | None = None, compared: bool = False
) -> Campaign:
    """The campaign of a file that was read, with the tables of its runs, or of the runs `only`,
    `compared` with the others.  Raises InputError.
    """
    only = source.names if only is None else only
    study: Study
    tables: Mapping[str, Run]
    if source.curve is not None:
        study, tables = read_curve_study(source, source.curve, only=only)
    else:
        rolling, read = RollingStudy(source), _read_runs(source, only, compared)
        study = rolling
        tables = {
            name: _with_fact(run, parts_fact(source, rolling.levels(name)))
            for name, run in read.items()
        }
    tables = {
        name: _with_fact(tables[name], source.out_of_folder(source.files[name]))
        for name in source.files
        if name in tables
    }
    campaign = Campaign(
        source,
        MappingProxyType(tables),
        study,
        read_derived(source.derived, source.places),
        read_truth(source),
    )
    for name in campaign.run_names:
        study.check(name, campaign.tables)
    if campaign.derived and campaign.run_names:
        campaign.problem(campaign.run_names)
    return campaign


def _read_runs(source: CampaignFile, only: Collection[str], compared: bool) -> Mapping[str, Run]:
    read = {
        run.name: _read(source, source.file_of(i), run)
        for i, run in enumerate(source.runs)
        if run.name in only
    }
    others, unread = dict[str, Run](), list[str]()
    if compared and any(is_timed_track(run) for run in read.values()):
        for i, run in enumerate(source.runs):
            try:
                others |= (
                    {} if run.name in read else {run.name: _read(source, source.file_of(i), run)}
                )
            except InputError:
                unread.append(run.name)
    runs = compare_intervals(
        {
            run.name: {**read, **others}[run.name]
            for run in source.runs
            if run.name in read or run.name in others
        }
    )
    fact = (
        phrase(
            "its frame rate was not compared with that of {runs}, because their files cannot be "
            "read",
            runs=listed(unread),
        )
        if unread
        else None
    )
    return {
        name: _with_fact(runs[name], fact if is_timed_track(runs[name]) else None) for name in read
    }


def _read(source: CampaignFile, path: Path, run: RunTable) -> Run:
    levels = (
        (("runs", source.runs.index(run)), run),
        (("bodies", run.body), source.bodies[run.body]),
        (("shared",), source.shared),
    )
    dialect = dialect_of(
        levels[:1] if is_tracker_file(path) or run.choices is not None else levels, source.places
    )
    with source.reading(path, COLUMNS):
        table = read_run(path, name=run.name, choices=run.choices, dialect=dialect)
    if not run.leave_out_s:
        return table
    try:
        return table.without(run.leave_out_s)
    except InputError as error:
        raise source.places.error(
            error.rule, ("runs", source.runs.index(run), "leave_out_s"), value=error.value
        ) from None


def _with_fact(run: Run, said: str | None) -> Run:
    """A run with one more fact, where there is one."""
    return run if said is None else replace(run, facts=(*run.facts, said))
