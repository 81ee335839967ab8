"""What the runs of a campaign are about: one protocol, kept by the rolling body (`bodies`) and a
user's own curve (`own_curve`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

from estim.campaign.campaign_file import NoiseTable
from estim.campaign.curve_models import CurveModel
from estim.campaign.levels import Path
from estim.campaign.noise_models import Candidate
from estim.common import InputError
from estim.explanation import Suspects
from estim.problem import Problem
from estim.reading import Run


class Study(Protocol):
    """Poses the problems of runs and knows what may be asked of them; every
    method may raise InputError with its place.
    """

    @property
    def formula(self) -> str | None:
        """The curve as the user wrote it, None where it is the project's own."""

    def columns(self, name: str, tables: Mapping[str, Run]) -> str:
        """Which columns of a run's file are x and y, in words; "" where their names are fixed."""

    def problem(
        self,
        names: Sequence[str],
        tables: Mapping[str, Run],
        *,
        noise: NoiseTable | None = None,
        usual: bool = False,
    ) -> Problem:
        """The joint problem of the runs `names` with their tables.

        noise : in place of the noise tables of the campaign.
        usual : with errors that nobody stated, where a usual size is known.
        """

    def suspects(self, names: Sequence[str], tables: Mapping[str, Run]) -> Suspects:
        """The runs `names` as stated, and with what they may have beside it."""

    def check(self, name: str, tables: Mapping[str, Run]) -> None:
        """Raises InputError where the data of a run cannot be what the campaign says of them."""

    def body_of(self, name: str) -> str | None:
        """The name of the body of a run, None where there is none."""

    def unit_of(self, argument: str, name: str) -> str:
        """The unit of an argument of the curve of a run, "1" where nobody said one."""

    def noise_models(self, name: str, table: Run) -> tuple[Candidate, ...]:
        """The models of the noise that the data of a run allow, two at least."""

    def curve_models(
        self, names: Sequence[str], tables: Mapping[str, Run]
    ) -> tuple[CurveModel, ...]:
        """The models of the runs `names` that can be compared, two at least."""

    def placed(self, error: InputError, problem: Problem, tables: Mapping[str, Run]) -> InputError:
        """An error of the fit of a problem with its place in the campaign, where it has one."""

    def refuse_discrepancy(self, command: str) -> None:
        """Raises InputError where a curve of the user's own may lack something, which `command`
        does not foresee.
        """

    def place_of_unknowns(self, name: str) -> Path:
        """Where in the file the unknowns of a run are declared."""

    def require_body(self) -> None:
        """Raises InputError where there is no rolling body to speak of."""

    def require_draws(self, problem: Problem) -> None:
        """Raises InputError where a prior cannot be drawn from."""

    def require_complete(self, names: Sequence[str], command: str) -> None:
        """Raises InputError where an unmodelled force was asked for, which `command` does not
        know.
        """

    def require_speeds(self, names: Sequence[str], command: str) -> None:
        """Raises InputError where a run is not fit as speeds with normal errors, which is what
        `command` knows.
        """
