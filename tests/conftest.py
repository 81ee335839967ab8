"""Fixtures shared by all tests."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import numpy as np
import pytest

signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job ignores it, and so would what the tests start

PROJECT = Path(__file__).resolve().parents[1]
SHARED = Path(os.environ.get("ESTIM_SHARED_DATA", PROJECT.parent / "shared" / "data"))


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20140328)


@pytest.fixture
def project() -> Path:
    return PROJECT


@pytest.fixture
def replica() -> Path:
    return PROJECT / "data" / "replica"


@pytest.fixture
def shared() -> Path:
    """The folder of real measurements and published values; tests that need it are skipped where it is absent."""
    if not SHARED.is_dir():
        pytest.skip(f"no real measurements at {SHARED}")
    return SHARED


@pytest.fixture
def tracker_folder(shared: Path) -> Path:
    """Real files of the program Tracker."""
    if not (shared / "tracker").is_dir():
        pytest.skip("no files of Tracker among the real measurements")
    return shared / "tracker"
