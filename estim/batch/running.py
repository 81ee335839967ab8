"""The runs of a batch, each analysed as `estim fit` does it, its files written by the process that
made them.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from estim.batch.rows import RESULT, RunRow, failed, forget, keep, kept, require_places, row_of
from estim.batch.units import Unit
from estim.campaign import Campaign, load_campaign
from estim.common import (
    EstimError,
    Files,
    InputError,
    inputs_read,
    key_of,
    language,
    phrase,
    plain,
    run_parallel,
    split_level,
)
from estim.pipeline import Analysis, analyse
from estim.sampling import Target

if TYPE_CHECKING:
    from concurrent.futures import Executor

Report = Callable[[Campaign, Analysis], Files]
"""What is written of an analysis, path -> bytes; `result.json` among it.  A function that can
be pickled.
"""


@dataclass(frozen=True)
class Settings:
    """seed : of every run, as of `estim fit`.  max_step : of the sampler.  ess : required number of
    effective draws.  kind : a name for what is written.

    language : of the words in it; `spoken` chooses it.
    """

    kind: str = "result"
    seed: int = 1
    max_step: int = 20_000
    ess: float = Target().ess
    language: str = field(default_factory=language)


@dataclass(frozen=True)
class _BatchRunner:
    folder: Path
    settings: Settings
    report: Report
    resume: bool

    def __call__(self, unit: Unit) -> RunRow:
        """The row of one run.  Whatever goes wrong with it is reported in its row, and stops no
        other.
        """
        with inputs_read() as inputs:
            row = self._row(unit)
        return msgspec.structs.replace(
            row, inputs={plain(path): digest for path, digest in inputs.items()}
        )

    def _row(self, unit: Unit) -> RunRow:
        began = time.process_time()
        try:
            return self._done(unit, began)
        except EstimError as error:
            reason = str(error)
        except Exception as error:  # a fault of estim's own: the night's work goes on
            reason = phrase(
                "this is a bug in the program, please report it: {error}",
                error=f"{type(error).__name__}: {error}",
            )
        forget(self.folder, unit.place)
        return failed(unit, reason, time.process_time() - began)

    def _done(self, unit: Unit, began: float) -> RunRow:
        campaign = load_campaign(unit.campaign, only=unit.run or None)
        if not unit.run:
            raise InputError("has no [[runs]]", field="campaign", file=str(unit.campaign))
        key = key_of(campaign.digests([unit.run]), self.settings)
        interval = campaign.tables[unit.run].interval
        if self.resume and (row := kept(self.folder, unit, key, interval)) is not None:
            return row
        target = Target(max_step=self.settings.max_step, ess=self.settings.ess)
        analysis = analyse(campaign, [unit.run], seed=self.settings.seed, target=target)
        files = self.report(campaign, analysis)
        labels = {split_level(p.name)[0]: p.bare_label for p in analysis.problem.parameters}
        seconds = time.process_time() - began
        row = row_of(unit, files[RESULT], labels, key=key, seconds=seconds, interval=interval)
        keep(self.folder, row, files)
        return row


def run_batch(
    units: Sequence[Unit],
    folder: Path,
    *,
    report: Report,
    settings: Settings | None = None,
    resume: bool = False,
    jobs: int = 1,
    executor: Executor | None = None,
    progress: Callable[[int], None] | None = None,
) -> list[RunRow]:
    """A row for each unit, in their order; their files are in `folder`, which all processes must
    see.

    resume : keep the results there that were made from the same campaign, data, settings and
        versions.
    executor : does the work in place of `jobs` processes of this machine: any of
        `concurrent.futures`, `Client.get_executor()` of dask.distributed,
        `mpi4py.futures.MPIPoolExecutor`.  The results are the same to the last bit.
    progress : called with the number that is done.

    Raises EstimError, before anything is computed, where files that estim did not write stand where
    its own would go; NumericalError where processes of this machine are killed twice.
    """
    require_places(folder, units)
    return run_parallel(
        _BatchRunner(folder, settings or Settings(), report, resume),
        units,
        jobs=jobs,
        executor=executor,
        progress=progress,
    )
