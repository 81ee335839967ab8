"""Damaged files of every kind, read one after the other; prints what was refused, what raised
anything else, and the slowest.

    python benchmarks/fuzz.py 100000 [--seed 1] [--kind csv ...]

The inputs are shared out among the kinds of files (tests/fuzzing.py).  Each failure is printed with
its seed: `sample(kind, random.Random(seed))` makes the bytes again.  100,000 inputs take about 4
minutes on one core.
"""

from __future__ import annotations

import argparse
import random
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from fuzzing import KINDS, read, sample


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("number", type=int, help="how many inputs in total")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kind", choices=KINDS, nargs="+", default=KINDS)
    options = parser.parse_args()
    warnings.simplefilter("error")
    count: Counter[tuple[str, str]] = Counter()
    places: Counter[str] = Counter()
    slowest = dict.fromkeys(options.kind, 0.0)
    with tempfile.TemporaryDirectory() as name:
        for i in range(options.number):
            kind = options.kind[i % len(options.kind)]
            seed = options.seed * 10_000_000 + i
            data = sample(kind, random.Random(seed))
            start = time.process_time()
            try:
                refused = read(kind, data, Path(name))
                count[kind, "read" if refused is None else "refused"] += 1
                if "\n" in str(refused):
                    raise ValueError("a message of several lines")
            except Exception as error:  # whatever else it is, it is what this command looks for
                last = traceback.extract_tb(error.__traceback__)[-1]
                own = [
                    f for f in traceback.extract_tb(error.__traceback__) if "estim" in f.filename
                ]
                where = (
                    f"{own[-1].name if own else ''} "
                    f"({last.filename.rpartition('/')[2]}:{last.lineno})"
                )
                place = f"{kind}: {type(error).__name__}: {str(error)[:80]} at {where}"
                count[kind, "failed"] += 1
                places[place] += 1
                if places[place] == 1:
                    print(f"FAILED seed {seed}: {place}", flush=True)
            slowest[kind] = max(slowest[kind], time.process_time() - start)
    print("| kind | read | refused | failed | slowest, ms |\n|---|---:|---:|---:|---:|")
    for kind in options.kind:
        numbers = " | ".join(str(count[kind, what]) for what in ("read", "refused", "failed"))
        print(f"| {kind} | {numbers} | {1e3 * slowest[kind]:.0f} |")
    return 1 if places else 0


if __name__ == "__main__":
    sys.exit(main())
