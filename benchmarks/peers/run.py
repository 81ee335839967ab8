"""Examples of other programs' documentation, solved with estim beside the numbers of those programs.

    python benchmarks/peers/run.py                    # writes docs/peers.md
    python benchmarks/peers/run.py --only lmfit       # shows differences, writes nothing
    python benchmarks/peers/run.py --run lmfit kafe2  # runs these peers beside, keeps what they say

Peers are no dependencies of estim: install those that are to be run in an environment of its own,
beside what estim needs.
"""

from __future__ import annotations

import argparse
import importlib
import math
import sys
import time
import warnings
from importlib.metadata import version
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))

import cases  # noqa: E402

PEERS = ("kafe2", "lmfit", "iminuit", "bumps", "scipy", "GTC", "suncal", "radvel")


def load(peers: tuple[str, ...] = PEERS) -> list[cases.Example]:
    """All examples, in the order of the files."""
    for peer in peers:
        if (HERE / f"of_{peer.lower()}.py").exists():
            importlib.import_module(f"of_{peer.lower()}")
    return list(cases.EXAMPLES)


def run_peers(peers: list[str]) -> None:
    """What the peers say when they are run, kept in numbers.toml."""
    kept = cases.stored()
    for item in load():
        if item.peer in peers and item.peer_run is not None:
            values = item.peer_run()
            kept[item.name] = {"by": f"{item.peer} {version(item.peer)}", "values": values}
            print(item.name, {k: f"{v[0]:.6g} ± {v[1]:.3g}" for k, v in values.items()}, flush=True)
    lines = ["# What the peers said when they were run (run.py --run): value, standard deviation"]
    for name in sorted(kept):
        lines += ["", f"[{name}]", f'by = "{kept[name]["by"]}"', f"[{name}.values]"]
        lines += [
            f'"{k}" = [{float(v[0]):.10g}, {float(v[1]):.8g}]'
            for k, v in kept[name]["values"].items()
        ]
    (HERE / "numbers.toml").write_text("\n".join(lines) + "\n")


def show(only: list[str]) -> None:
    kept = cases.stored()
    for item in load():
        if only and item.peer not in only and item.name not in only:
            continue
        begin = time.process_time()
        try:
            solved = item.solve()
            ours = cases.numbers_of(solved)
            rows = cases.differences(item, ours, kept.get(item.name, {}))
        except Exception as error:  # a table of what fails is the purpose here
            print(f"{item.name:34} {type(error).__name__}: {str(error)[:300]}", flush=True)
            continue
        far = max((r.apart for r in rows), default=math.nan)
        wide = [f"{r.ratio:.3f}" for r in rows]
        good = "ok " if rows and all(r.agrees for r in rows) else "BAD"
        status = getattr(solved, "status", "")
        print(f"{item.name:34} {good} {status!s:12} max {far:.4f} sd, ratios {' '.join(wide)}  {time.process_time() - begin:.2f} s", flush=True)
        if good == "BAD":
            for r in rows:
                print(f"      {r.name:14} {r.ours[0]:.6g} ± {r.ours[1]:.4g} | {r.shown} | {r.apart:.4f} {r.ratio:.4f}")
            print("      ours:", {k: (float(f'{v[0]:.5g}'), float(f'{v[1]:.4g}')) for k, v in ours.items()})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--run", nargs="+", default=[], choices=PEERS)
    parser.add_argument("--only", nargs="+", default=[])
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    if options.run:
        run_peers(options.run)
    else:
        show(options.only)


if __name__ == "__main__":
    main()
