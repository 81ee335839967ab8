"""Memory that arrays give back stays with the process: commands do not ask the system for the same pages again and again."""

from __future__ import annotations

import os
import platform
import subprocess
import sys

import pytest

from estim.kept_memory import THRESHOLDS

COUNT = """
import resource, sys
import numpy as np
from estim.kept_memory import keep_memory
if sys.argv[1] == "keep": keep_memory()
def pages():
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt
a = np.ones(250_000); b = a + a; del b
before = pages()
for _ in range(200): b = a + a; c = b + a; del b, c
print(pages() - before)
"""


def faults(word: str, **environment: str) -> int:
    plain = {name: value for name, value in os.environ.items() if name not in THRESHOLDS}
    done = subprocess.run([sys.executable, "-c", COUNT, word], env=plain | environment, capture_output=True, text=True, check=True)
    return int(done.stdout)


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="of glibc alone")
def test_arrays_of_some_megabytes_reuse_their_pages_unless_the_environment_says_otherwise() -> None:
    kept = faults("keep")
    assert kept < 5_000  # 976 of two arrays, once; 195,000 if every array were new
    assert faults("keep", MALLOC_MMAP_THRESHOLD_="131072") > 20 * kept
