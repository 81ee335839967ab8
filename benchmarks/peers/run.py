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
        print(
            f"{item.name:34} {good} {status!s:12} max {far:.4f} sd, ratios {' '.join(wide)}  {time.process_time() - begin:.2f} s",
            flush=True,
        )
        if good == "BAD":
            for r in rows:
                print(
                    f"      {r.name:14} {r.ours[0]:.6g} ± {r.ours[1]:.4g} | {r.shown} | {r.apart:.4f} {r.ratio:.4f}"
                )
            print(
                "      ours:",
                {k: (float(f"{v[0]:.5g}"), float(f"{v[1]:.4g}")) for k, v in ours.items()},
            )


MISSING = """## What is not here

These examples ask for what `fit_curve` and `fit_curves` do not have yet:

| example | asks for |
|---|---|
| kafe2 011_multifit/01_fit_with_parameter_constraints.py | priors given as a matrix |
| kafe2 012_custom_fit; iminuit generic_least_squares.ipynb; bumps constraints/inequality.py | a cost function or a penalty of one's own (a log density of each observation is `LogDensity`) |
| lmfit example_reduce_fcn.py, example_detect_outliers.py; iminuit cost_functions.ipynb, soft_l1 | soft losses (`robust=` is a law of errors with room for outliers, which is another thing) |
| iminuit template_fits.ipynb, weighted_histograms.ipynb | templates with errors of their own, weighted events |
| scipy.odr test_explicit, test_implicit, test_multi | errors of x of unknown size, implicit curves, several y for one x |
| RadVel k2-131.py | a quasi-periodic Gaussian process |
"""

HEAD = """# Examples of other programs, solved with estim

{count} examples from the documentation of {peers}, each by the lines that a user of estim writes, beside
the numbers of the program that it comes from. {agree} of {count} agree within what is stated below each table, {near} of them
to a twentieth of a standard deviation and 2 % of it; where the others differ for a reason, it is given. `benchmarks/peers/run.py` writes this page; `tests/test_peers.py` holds estim to it.

Numbers that a program prints in its documentation are given as printed; others are those that it says when it is run with the
data of the example. Differences of values are in standard deviations of the peer; ratios are estim's standard deviation over the peer's.
Data that an example draws at random are drawn with its seed, or with one where it has none. Measured values are
re-tabulated; the code of kafe2 is GPL, that of lmfit and scipy BSD, of iminuit and GTC MIT, of bumps public domain: none of it is copied here.

A fit that estim calls `poor-fit` has values and standard deviations like any other (`fit.values`, `fit.sds`); it is printed without ±, because tests say
that the curve or the stated errors do not explain the points.

| example | asks for | largest difference | ratios | status |
|---|---|---|---|---|
"""


def page() -> str:
    kept, rows, sections, agree, near = cases.stored(), [], [], 0, 0
    items = load()
    for number, item in enumerate(items, 1):
        solved = item.solve()
        found = cases.differences(item, cases.numbers_of(solved), kept.get(item.name, {}))
        agrees = bool(found) and all(row.agrees for row in found)
        agree += agrees
        status = str(getattr(solved, "status", ""))
        far = max(row.apart for row in found)
        ratios = [row.ratio for row in found if not math.isnan(row.ratio)]
        near += far <= 0.05 and all(abs(ratio - 1.0) <= 0.02 for ratio in ratios)
        span = f"{min(ratios):.3f} to {max(ratios):.3f}" if ratios else ""
        title = f"{item.peer}: {item.page}"
        rows.append(f"| {number} {title} | {item.needs} | {far:.2g} | {span} | {status or '-'} |")
        source = "printed there" if item.printed else "run: " + kept[item.name]["by"]
        table = [
            f"| {r.name} | {shown(*r.ours)} | {r.shown[0]} ± {r.shown[1] or '?'} | {r.apart:.2g} | {r.ratio:.3f} |"
            for r in found
        ]
        verdict = f" estim's verdict: `{status}`." if status else ""
        advice = "; ".join(getattr(solved, "reasons", ())) if status not in ("", "ok") else ""
        sections += [
            f"## {number}. {title}", "",
            f"Asks for: {item.needs}. Numbers of {item.peer}: {source}.{verdict}{' ' + advice if advice else ''}", "",
            "```text", item.lines(), "```", "",
            f"| | estim | {item.peer} | difference, sd | ratio of sds |", "|---|---|---|---|---|", *table, "",
            f"Held to {item.within:g} sd and {100 * item.spread:g} % of the sd, and half a unit of the last printed digit."
            + ("" if agrees else " **They differ.**") + (f" {item.why}" if item.why else ""), "",
        ]  # fmt: skip
    peers = sorted({item.peer for item in items}, key=str.lower)
    head = HEAD.format(
        count=len(items), agree=agree, near=near, peers=", ".join(peers[:-1]) + " and " + peers[-1]
    )
    return head + "\n".join(rows) + "\n\n" + "\n".join(sections).rstrip() + "\n\n" + MISSING


def shown(value: float, sd: float) -> str:
    digits = max(0, 3 - math.floor(math.log10(sd))) if sd > 0 else 6
    return f"{value:.{digits}f} ± {sd:.3g}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--run", nargs="+", default=[], choices=PEERS)
    parser.add_argument("--show", action="store_true", help="write no page")
    parser.add_argument("--only", nargs="+", default=[])
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    if options.run:
        run_peers(options.run)
    elif options.only or options.show:
        show(options.only)
    else:
        (HERE.parents[1] / "docs/peers.md").write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    main()
