"""Fixtures shared by all tests."""

from __future__ import annotations

import gc
import os
import signal
from contextlib import nullcontext
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from stand_ins import write as write_stand_ins

if TYPE_CHECKING:
    from xdist.remote import Producer
    from xdist.scheduler import LoadScopeScheduling

    from estim.studies.reanalysis import Reanalysis

# a shell's background job ignores it, and so would what the tests start
signal.signal(signal.SIGINT, signal.default_int_handler)

PROJECT = Path(__file__).resolve().parents[1]
SHARED = Path(os.environ.get("ESTIM_SHARED_DATA", PROJECT.parent / "shared" / "data"))
REAL = SHARED / "tracker"


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20140328)


@pytest.fixture
def project() -> Path:
    return PROJECT


@pytest.fixture(scope="session")
def reports() -> Path:
    """The committed reports, which the source archive leaves out."""
    folder = PROJECT / "reports"
    if not folder.is_dir():
        pytest.skip("the committed reports are in the repository, not in the source archive")
    return folder


@pytest.fixture
def replica() -> Path:
    return PROJECT / "data" / "replica"


@pytest.fixture(scope="session")
def reanalysed() -> Reanalysis:
    """The replica reanalysed as `estim reanalyse --seed 2` does.  One process has it
    (`REANALYSED`).
    """
    from estim.campaign import load_campaign
    from estim.sampling import Target
    from estim.studies.reanalysis import reanalyse

    return reanalyse(
        load_campaign(PROJECT / "data" / "replica" / "campaign.toml"),
        seed=2,
        target=Target(),
        progress_of=lambda what: nullcontext(lambda step, message: None),
    )


@pytest.fixture(scope="session")
def stand_ins(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Files of the program Tracker that are made here (tests/stand_ins.py)."""
    return write_stand_ins(tmp_path_factory.mktemp("tracker"))


@pytest.fixture(params=["stand-ins", *(["real files"] if REAL.is_dir() else [])])
def tracker_folder(request: pytest.FixtureRequest) -> Path:
    """Files of Tracker: those made here and, where they are present, the real ones, which are the
    only data outside the project.
    """
    return REAL if request.param == "real files" else request.getfixturevalue("stand_ins")


@pytest.fixture
def real_files() -> list[Path]:
    """All real files of Tracker; none in a plain clone."""
    return sorted(path for path in REAL.rglob("*") if path.is_file())


REANALYSED = (
    "tests/test_replica.py",
    "tests/test_reanalysis.py::test_committed_report",
    "tests/test_reanalysis.py::test_story_without_truths",
    "tests/test_certify.py::test_chain_and_certificate_agree_for_the_runs",
)


@cache
def _one_process(file: str) -> bool:
    """Whether tests of a file share something that is made once for the file."""
    text = (PROJECT / file).read_text()
    return 'scope="module"' in text or "\n@cache\n" in text


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> LoadScopeScheduling:
    """Tests that share something costly run in one process, all others wherever there is room."""
    from xdist.scheduler import LoadScopeScheduling

    class Together(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            if nodeid.startswith(REANALYSED):
                return "reanalysed"
            file = nodeid.partition("::")[0]
            return file if _one_process(file) else nodeid

    return Together(config, log)


def pytest_collection_finish() -> None:
    """Thousands of tests stay to the end: no need to look for garbage among them after every few
    hundred objects.
    """
    gc.set_threshold(10_000, 20, 20)


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, config: pytest.Config
) -> None:
    if config.option.markexpr == "slow or statistics":
        count = sum(path.is_file() for path in REAL.rglob("*"))
        terminalreporter.write_line(
            f"real files of the program Tracker, read beside their stand-ins: {count} ({REAL})"
        )


@pytest.fixture
def few_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    """A quarter of the effective draws in every command: for tests of statuses, files and words,
    not of numbers.
    """
    from estim.sampling import Target

    monkeypatch.setattr("estim.sampling.Target", partial(Target, ess=1000.0))


PIXEL = (
    b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\1\0\0\0\1\x08\0\0\0\0:~\x9bU"
    b"\0\0\0\nIDATx\x9cc\xf8\x0f\0\1\1\1\0\x1b\xb6\xeeV"
    b"\0\0\0\0IEND\xaeB`\x82"
)


@pytest.fixture
def unrendered(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are made and not turned into pixels, half of the time of a report: for tests of
    numbers and text, whatever the figures have to show.
    """
    monkeypatch.setattr("estim.drawing.as_png", lambda _: PIXEL)


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """A pixel in place of every figure, most of the time of a report: for tests of files, streams
    and words on the terminal.
    """
    monkeypatch.setattr("estim.reports.pages.png", lambda *_: PIXEL)
