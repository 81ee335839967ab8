"""A model, a reader, a law of the errors and a section of reports for estim."""

import math

from scipy import stats

from estim import Model

# U. Fano, Phys. Rev. 124, 1866 (1961), eq. (21): (q + e)^2/(1 + e^2), e = (x - center)/(width/2)
FANO = Model(
    name="fano",
    expression="height*(q + 2*(x - center)/width)**2/(1 + (2*(x - center)/width)**2)",
    parameters=("height", "center", "width", "q"),
    limits={"height": (0.0, None), "width": (0.0, None)},
)

# of standard deviation 1: u_y is that of a reading, whose tails are heavier than normal ones
LOGISTIC = stats.logistic(scale=math.sqrt(3.0) / math.pi)


def read_sweep(data: bytes) -> str:
    """The table of a .sweep file: a tab between cells, and each line where it was.

    Such a file has lines "key: value", then "[points]", then lines "f|U|u_U|flag" in Hz and mV.
    Raises ValueError where it has not as many points as it says.
    """
    head, mark, rows = data.decode("ascii").partition("[points]\n")
    facts = dict(line.split(": ", 1) for line in head.splitlines())
    points = [line.split("|")[:3] for line in rows.splitlines()]
    if not mark or len(points) != int(facts["points"]):
        raise ValueError("the file is cut off: it has fewer points than it says")
    lines = [f"# {line}" for line in head.splitlines()]
    lines.append("f [Hz]\tU [mV]\tu_U [mV]")
    lines += ["\t".join(cells) for cells in points]
    return "\n".join(lines)


def quality(result: dict) -> str:
    """The section of a report about a resonance: its quality factor.

    `result` is what result.json holds.
    """
    parameters = result["parameters"]
    if result["status"] != "ok" or not {"center", "width"} <= set(parameters):
        return "No resonance was fitted, so no quality factor is given."
    center, width = (parameters[name] for name in ("center", "width"))
    factor = center["mean"] / width["mean"]
    u = factor * width["sd"] / width["mean"]  # the center is known far better
    return f"The quality factor center/width is {factor:.1f} ± {u:.1f}."
