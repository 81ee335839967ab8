"""A campaign: its file and the tables of its runs.

What its runs measure is either a rolling body (`bodies`) or a curve of the user's own
(`curve_campaign`): both are classes of `Campaign`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from estim.campaign.campaign_file import CampaignFile, NoiseTable
from estim.campaign.curve_models import CurveModel
from estim.campaign.derived import with_derived
from estim.campaign.noise_models import NoiseModel
from estim.common import InputError, code, kind_words, later, markdown, phrase, table
from estim.curves import SoughtQuantity
from estim.explanation import Suspects
from estim.problem import Problem
from estim.reading import KeyPath, Run

_HEADS = (later("run"), later("body"), later("file"), later("fitted points"), later("unknowns"))


@dataclass(frozen=True, eq=False)
class Campaign(ABC):
    """A campaign and the tables of its runs, read and checked.  `problem` poses the inference for
    some of its runs.

    source : the file as read, with its lines.  tables : run -> its table.
    derived : what is to be computed from the parameters.
    truth : parameter -> true value, of synthetic data where it is known; no fit uses it.

    >>> from estim import load_campaign
    >>> campaign = load_campaign("data/replica/campaign.toml", only="heavy-04")
    >>> campaign.run_names, campaign.kind
    (('heavy-04',), 'synthetic')
    >>> problem = campaign.problem(["heavy-04"], usual=True)
    >>> problem.parameters[0].name, problem.parameters[0].unit
    ('gamma[heavy]', '1')
    """

    source: CampaignFile
    tables: Mapping[str, Run]
    derived: tuple[SoughtQuantity, ...] = ()
    truth: Mapping[str, float] = field(default_factory=dict)

    @property
    def title(self) -> str:
        """As the file states it."""
        return self.source.title

    @property
    def kind(self) -> str:
        """What its numbers are, "measured" or another word of the file."""
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
        return None

    def assumed(self, name: str) -> tuple[str, ...]:
        """How the table of the run `name` was read, in words."""
        return self.tables[name].assumed

    def columns(self, names: Sequence[str]) -> str:
        """Which columns of the files of the runs `names` are x and y, in words; "" where their
        names are fixed.
        """
        return ""

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
        """Its runs whose tables were read, in the order of the file."""
        return tuple(name for name in self.source.names if name in self.tables)

    def problem(
        self, names: Sequence[str], *, noise: NoiseTable | None = None, usual: bool = False
    ) -> Problem:
        """The joint problem of the runs `names`: what they share is one parameter.  Raises
        InputError.

        noise : in place of the noise tables of the campaign.
        usual : with the usual errors of length scale and clock where nothing is stated of them, as
            an analysis has them.
        """
        if not names or len(set(names)) < len(names):
            raise InputError(
                "must name one run or several, each once",
                field="run",
                value=", ".join(names),
                file=self.source.places.file,
            )
        for name in names:
            if name not in self.run_names:
                raise InputError(
                    f"must name one of the runs ({', '.join(self.run_names)})",
                    field="run",
                    value=name,
                    file=self.source.places.file,
                )
        try:
            return with_derived(
                self._posed(names, noise=noise, usual=usual),
                self.derived,
                self._bodies,
                self._unit_of,
            )
        except InputError as error:
            if error.file is not None or error.field not in {
                quantity.name for quantity in self.derived
            }:
                raise
            raise self.source.error(
                error.rule, ("derived", error.field), value=error.value
            ) from None

    @property
    def _bodies(self) -> dict[str, str | None]:
        return {name: self.body_of(name) for name in self.source.names}

    @contextmanager
    def placing(self, problem: Problem) -> Iterator[None]:
        """While a problem of this campaign is fit: an error has its place in the files."""
        try:
            yield
        except InputError as error:
            raise error if error.file is not None else self._placed(error, problem) from None

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
                    self.body_of(name) or "",
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

    def require_unknowns(self, problem: Problem) -> None:
        """Raises InputError where every quantity of a problem of this campaign is exact."""
        if not problem.parameters:
            rule = (
                "leaves nothing to fit: every quantity is exact; give at least one an "
                "uncertainty or a prior"
            )
            name = problem.runs[0].name
            raise self.source.error(rule, self._path_of_unknowns(name), field=f"run {name}")

    @abstractmethod
    def _posed(
        self, names: Sequence[str], *, noise: NoiseTable | None = None, usual: bool = False
    ) -> Problem:
        """`problem` of runs that are there, without what is derived."""

    @abstractmethod
    def check(self, name: str) -> None:
        """Raises InputError where the data of a run contradict what the campaign states of them."""

    def body_of(self, name: str) -> str | None:
        """The name of the body of a run, None where there is none."""
        return None

    @abstractmethod
    def _unit_of(self, argument: str, name: str) -> str:
        """The unit of an argument of the curve of a run, "1" where none is stated."""

    @abstractmethod
    def suspects(self, names: Sequence[str]) -> Suspects:
        """The runs `names` as stated, and with each effect that they may have in addition."""

    @abstractmethod
    def noise_models(self, name: str) -> tuple[NoiseModel, ...]:
        """The models of the noise that the data of a run allow.  Raises InputError where there is
        only one.
        """

    def curve_models(self, names: Sequence[str]) -> tuple[CurveModel, ...]:
        """The models of the runs `names`, fit together, that can be compared, the simplest first.
        Raises InputError where there is only one.
        """
        self.problem(names)
        raise self.source.error(
            "is a formula of your own; estim compare-models compares models of a rolling body",
            ("curve",),
        )

    @abstractmethod
    def _placed(self, error: InputError, problem: Problem) -> InputError:
        """An error of the fit of a problem with its place in the campaign, where it has one."""

    @abstractmethod
    def _path_of_unknowns(self, name: str) -> KeyPath:
        """Where in the file the unknowns of a run are declared."""

    @abstractmethod
    def require_draws(self, problem: Problem, *, of_priors: bool) -> None:
        """Raises InputError where data cannot be simulated, or (`of_priors`) true values cannot be
        drawn.
        """

    def require_body(self) -> None:
        """Raises InputError where there is no rolling body."""
        if self.formula is not None:
            raise self.source.error("has no rolling body, which this command is about", ("curve",))

    def require_complete(self, names: Sequence[str], command: str) -> None:
        """Raises InputError where there is no rolling body, or an unmodelled force was requested,
        which `command` does not support.
        """
        self.require_body()

    def require_speeds(self, names: Sequence[str], command: str) -> None:
        """Raises InputError where there is no rolling body, or a run is not fit as speeds with
        normal errors, which is what `command` supports.
        """
        self.require_body()

    @abstractmethod
    def refuse_discrepancy(self, command: str) -> None:
        """Raises InputError where the campaign allows for a discrepancy of the user's own curve,
        which `command` does not support.
        """
