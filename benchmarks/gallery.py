"""The gallery: real experiments with published results, each analysed by the ordinary command, and
an index of what came out.

    python benchmarks/gallery.py [--only muon,hubble,es/filament] [--index]

`data/gallery/gallery.toml` names the experiments; reports go to reports/gallery/NAME, the index to
reports/gallery/README.md, samples in Spanish to reports/es/NAME.  Every number of the index is read
from a result.json.  --index: nothing is computed anew.  Figures are made smaller (fewer points and
colours), so that all reports together stay below 3 MB.
"""

from __future__ import annotations

import argparse
import io
import json
import math
import re
import shutil
import subprocess
import sys
import textwrap
import tomllib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from estim.cli.origin import ORIGIN, read_origin
from estim.common import Quantity, as_json, e_n, format_quantity, signed

PROJECT = Path(__file__).resolve().parents[1]
DATA, REPORTS = PROJECT / "data" / "gallery", PROJECT / "reports" / "gallery"
IN_SPANISH = {
    "replica-light-01": "fit data/replica/campaign.toml --run light-01 --lang es",
    "filament": "fit data/gallery/filament.toml --lang es",
}
HEAD = """\
Real data ([whose they are](../../data/gallery/README.md)), each analysed by the commands above its figure. `make gallery` makes this page; the
numbers of its tables are read from the `result.json` of the reports.

± is one standard uncertainty. E_n = (reanalysed − published)/√(U₁² + U₂²) with U = 2 u (ISO 13528): between −1 and +1 the two agree. Where no
uncertainty is published, E_n counts that of the reanalysis alone. A published value that comes from *the same data* is no second measurement: its E_n
only compares two analyses. A dash stands where the status of a result is not `ok`: there is no number to quote, and the report says why."""
_COLOURS, _SHRUNK, _SHRUNK_TRACES = 96, 0.64, 0.45


def experiments() -> list[dict[str, Any]]:
    """The experiments of data/gallery/gallery.toml, in order."""
    return list(tomllib.loads((DATA / "gallery.toml").read_text(encoding="utf-8"))["experiment"])


def run(experiment: Mapping[str, Any]) -> None:
    """Runs the commands of an experiment."""
    for step in experiment["step"]:
        make(step["command"], folder_of(step))
        if "collect" in step:
            (DATA / step["collect"]["file"]).write_text(collected(step), encoding="utf-8")
    if "overview" in experiment:
        (REPORTS / experiment["figure"]).write_bytes(overview(experiment["overview"]))


def make(command: str, folder: Path) -> None:
    """The report of a command, small; exit code 3, a result that is not to be trusted, is a
    result.
    """
    shutil.rmtree(folder, ignore_errors=True)  # its figures are no longer as they were written
    words = [
        sys.executable,
        "-m",
        "estim",
        *command.split(),
        "--out",
        str(folder.relative_to(PROJECT)),
    ]
    code = subprocess.run(words, cwd=PROJECT, check=False).returncode
    if code not in (0, 3):
        raise SystemExit(f"{command}: exit code {code}")
    for draws in folder.rglob("draws.nc"):
        draws.unlink()
    for figure in folder.rglob("*.png"):
        figure.write_bytes(
            smaller(figure.read_bytes(), _SHRUNK_TRACES if figure.stem == "traces" else _SHRUNK)
        )
    for origin in folder.rglob("origin.json"):
        describe_anew(origin.parent)


def folder_of(step: Mapping[str, Any]) -> Path:
    return REPORTS / str(step["name"])


def describe_anew(folder: Path) -> None:
    """The files that describe a report, after its figures were made smaller: `estim verify`
    compares text and numbers only.
    """
    origin = read_origin(folder)
    outputs = {
        name: digest
        for name, digest in origin.outputs.items()
        if name != "draws.nc" and not name.endswith(".png")
    }
    (folder / ORIGIN).write_bytes(as_json(replace(origin, outputs=outputs)))


def smaller(png: bytes, scale: float) -> bytes:
    """The same picture with fewer points and colours."""
    from PIL import Image

    picture = Image.open(io.BytesIO(png)).convert("RGB")
    picture = picture.resize(
        (round(scale * picture.width), round(scale * picture.height)), Image.Resampling.LANCZOS
    )
    buffer = io.BytesIO()
    picture.quantize(_COLOURS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE).save(
        buffer, "PNG", optimize=True
    )
    return buffer.getvalue()


def result_of(step: str, run: str = "") -> dict[str, Any]:
    """The result.json of a report, or of one of its runs."""
    return dict(json.loads((REPORTS / step / run / "result.json").read_text(encoding="utf-8")))


def found(step: str, place: str) -> tuple[str, Quantity | None, str]:
    """Status, value and unit of "parameter", "run:parameter" (a report of its own) or
    "run/parameter" (a run of a joint fit, derived).

    The value is None where the status allows none.
    """
    run, _, name = place.rpartition(":")
    result = result_of(step, run)
    inside, _, name = name.rpartition("/")
    tables = (
        [result["runs"][inside]["derived"]]
        if inside
        else [result["parameters"], *(r["derived"] for r in result["runs"].values())]
    )
    entry = next(
        table[key] for table in tables for key in table if name in (key, key.partition("[")[0])
    )
    mean = entry["mean"]
    return (
        result["status"],
        None if mean is None else Quantity(mean, entry["sd"]),
        "" if entry["unit"] == "1" else entry["unit"],
    )


def published(number: Mapping[str, Any], value: Quantity) -> Quantity:
    """The published value with the standard uncertainty on the side of `value`; 0 where none is
    stated.
    """
    sides = number.get("u", 0.0)
    if isinstance(sides, list):
        sides = sides[1] if value.value > number["value"] else sides[0]
    return Quantity(number["value"], sides)


def shown_published(number: Mapping[str, Any], unit: str) -> str:
    if "shown" not in number and "u" in number:
        return shown(Quantity(number["value"], number["u"]), unit)
    return f"{number.get('shown', number['value'])} {unit}".strip()


def cells(step: str, number: Mapping[str, Any]) -> tuple[str, str, str, str, str]:
    """One line of a table: what, reanalysed, published, source, E_n."""
    step = number.get("step", step)
    status, value, unit = found(step, number["found"])
    if "other" in number:
        other = found(step, number["other"])[1]
        theirs = "—" if other is None else shown(other, unit)
    else:
        other = None if value is None else published(number, value)
        theirs = shown_published(number, unit)
    difference = math.nan if value is None or other is None else e_n(value, other)
    ours = f"— ({status})" if value is None else shown(value, unit)
    return (
        number["name"],
        ours,
        theirs,
        number["source"],
        signed(f"{difference:+.2f}") if math.isfinite(difference) else "",
    )


def shown(value: Quantity, unit: str) -> str:
    text = format_quantity(value.value, value.u, plus_minus=True)
    if "×" in text and 10.0 < value.u < 1000.0:  # (4.2 ± 0.4)×10²
        text = f"{value.value:.0f} ± {value.u:.0f}"
    return f"{text} {unit}".strip()


def filled(text: str) -> str:
    """`text` with {step|parameter} replaced by what was found."""

    def value(match: re.Match[str]) -> str:
        status, quantity, unit = found(match[1], match[2])
        return f"— ({status})" if quantity is None else shown(quantity, unit)

    return textwrap.fill(
        re.sub(r"\{([^|}]+)\|([^}]+)\}", value, " ".join(text.split())), 150, break_on_hyphens=False
    )


def section(experiment: Mapping[str, Any]) -> list[str]:
    """The part of the index on one experiment."""
    steps = experiment["step"]
    commands = [f"    estim {step['command']}" for step in steps]
    reports = ", ".join(f"[{step['name']}]({step['name']}/report.md)" for step in steps)
    caption = experiment["caption"]
    numbers = [cells(steps[-1]["name"], number) for number in experiment["number"]]
    return [
        f"## {experiment['title']}",
        "",
        *commands,
        "",
        f"![{caption}]({experiment['figure']})",
        "",
        f"*{caption}*",
        "",
        "| quantity | reanalysed | published | source | E_n |",
        "|---|---|---|---|---|",
        *(f"| {' | '.join(number)} |" for number in numbers),
        "",
        filled(experiment["teaches"]),
        "",
        f"Reports: {reports}.",
        "",
    ]


def overview(names: Mapping[str, str]) -> bytes:
    """A picture of a whole table with the places that were found in it, as PNG."""
    import numpy as np
    from matplotlib.figure import Figure

    x, y = np.loadtxt(DATA / names["table"], delimiter=",", skiprows=1, usecols=(0, 1), unpack=True)
    places = np.loadtxt(DATA / names["places"], delimiter=",", skiprows=1, usecols=1)
    figure = Figure(figsize=(7.2, 3.6), layout="constrained")
    axes = figure.subplots()
    axes.plot(x, y, color="#0072B2", lw=1.2, label="recorded")
    axes.plot(
        places,
        np.interp(places, x, y),
        "v",
        color="#E69F00",
        mec="#222222",
        ms=7,
        label="peaks found",
    )
    axes.set(xlabel=names["x"], ylabel=names["y"])
    axes.legend(frameon=False)
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=110, metadata={"Software": None})
    return smaller(buffer.getvalue(), 1.0)


def index() -> str:
    """reports/gallery/README.md."""
    entries = experiments()
    lines = [
        "# Gallery: real experiments, published and reanalysed",
        "",
        HEAD,
        "",
        "| experiment | quantity | reanalysed | published | E_n |",
        "|---|---|---|---|---|",
    ]
    for entry in entries:
        what, ours, theirs, _, difference = cells(entry["step"][-1]["name"], entry["number"][0])
        lines.append(
            f"| [{entry['title']}](#{anchor(entry['title'])}) | {what} | {ours} | {theirs} "
            f"| {difference} |"
        )
    return (
        "\n".join([*lines, "", *(line for entry in entries for line in section(entry))]).rstrip()
        + "\n"
    )


def anchor(title: str) -> str:
    """The name that a heading has in a link to it."""
    return re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")


def collected(step: Mapping[str, Any]) -> str:
    """A table of one parameter of all runs that are ok: number of the run, value, standard
    deviation.
    """
    names = step["collect"]
    lines = [f"{names['x']},{names['y']},{names['u']}"]
    for number, folder in enumerate(step["collect"]["runs"], 1):
        status, value, _ = found(step["name"], f"{folder}:{names['parameter']}")
        if status == "ok" and value is not None:
            lines.append(f"{number},{value.value:.4f},{value.u:.4f}")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--only", default="", help="names of steps, separated by commas")
    parser.add_argument("--index", action="store_true", help="only write the index anew")
    options = parser.parse_args()
    wanted = set(filter(None, options.only.split(",")))
    for experiment in experiments():
        if not options.index and (
            not wanted or wanted & {step["name"] for step in experiment["step"]}
        ):
            run(experiment)
    for name, command in IN_SPANISH.items():
        if not options.index and (not wanted or f"es/{name}" in wanted):
            make(command, PROJECT / "reports" / "es" / name)
    REPORTS.mkdir(parents=True, exist_ok=True)
    (REPORTS / "README.md").write_text(index(), encoding="utf-8")


if __name__ == "__main__":
    main()
