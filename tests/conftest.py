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
def tracker_folder() -> Path:
    """Real files of the program Tracker, the only data outside the project; tests that need them are skipped where they are absent."""
    if not (SHARED / "tracker").is_dir():
        pytest.skip(f"no files of the program Tracker at {SHARED / 'tracker'}")
    return SHARED / "tracker"
