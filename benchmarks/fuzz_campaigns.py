"""Mutated campaigns through every command of estim, judged by an oracle that shares no code with
the readers; prints what is wrong.

    python benchmarks/fuzz_campaigns.py 3000 [--seed 1] [--jobs 2]

Each case is a seed (`tests/campaign_fuzzing.py`): `--only SEED` runs one of them and shows its
files and outputs.  Wrong is a traceback, an exit code other than 0, 2 and 3, an error that is not
one line or names no file, a character that moves a cursor in any output, and a number that is used
and does not stand in the files (`tests/campaign_oracle.py`).  Doubts, where one of the two reads
what the other refuses, are counted and listed by their words: they are for a person to look at.
"""

from __future__ import annotations

import argparse
import functools
import multiprocessing
import sys
import tempfile
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from campaign_fuzzing import in_fresh_folder, make


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("number", type=int, nargs="?", default=0, help="how many campaigns")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--only", type=int, metavar="SEED", help="this one, with its files")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        if options.only is not None:
            case = make(options.only)
            print(
                *(
                    f"== {file}\n{data.decode(errors='replace')}"
                    for file, data in case.files.items()
                    if file == case.changed
                ),
                sep="\n",
            )
            print("$ estim", *case.words, "(to its end)" if case.full else "")
            outcome = in_fresh_folder(options.only, Path(name))
            print(
                f"code {outcome.code}, stopped before the fit: {outcome.stopped}\n{outcome.said!r}"
            )
            print(f"wrong: {outcome.wrong}\ndoubts: {outcome.doubts}")
            return 1 if outcome.wrong else 0
        seeds = range(options.seed * 10_000_000, options.seed * 10_000_000 + options.number)
        count: Counter[tuple[str, str]] = Counter()
        doubts: dict[str, list[int]] = {}
        n_wrong = 0
        with multiprocessing.Pool(options.jobs) as pool:
            for outcome in pool.imap_unordered(
                functools.partial(in_fresh_folder, work=Path(name)), seeds, chunksize=4
            ):
                case = outcome.case
                ended = (
                    "wrong"
                    if outcome.wrong
                    else "to its end"
                    if case.full and outcome.code != 2
                    else "refused"
                    if outcome.code == 2
                    else "read"
                )
                count[case.words[0], ended] += 1
                if outcome.wrong:
                    n_wrong += 1
                    print(
                        f"WRONG seed {case.seed}, {case.words[0]} of {case.base}: "
                        f"{'; '.join(outcome.wrong)[:400]}",
                        flush=True,
                    )
                for doubt in outcome.doubts:
                    doubts.setdefault(doubt, []).append(case.seed)
    print("\n| command | read | to its end | refused | wrong |\n|---|---:|---:|---:|---:|")
    for command in sorted({command for command, _ in count}):
        print(
            f"| {command} | "
            + " | ".join(
                str(count[command, ended]) for ended in ("read", "to its end", "refused", "wrong")
            )
            + " |"
        )
    print(
        f"\n{options.number} campaigns, {n_wrong} wrong, {sum(map(len, doubts.values()))} doubts:"
    )
    for doubt, seen in sorted(doubts.items(), key=lambda item: -len(item[1])):
        print(f"{len(seen):5d}  {doubt}  (seed {seen[0]})")
    return 1 if n_wrong else 0


if __name__ == "__main__":
    sys.exit(main())
