"""A model and a reader for estim."""

from estim import Model

# U. Fano, Phys. Rev. 124, 1866 (1961), eq. (21): (q + e)^2/(1 + e^2), e = (x - center)/(width/2)
FANO = Model(
    name="fano",
    expression="height*(q + 2*(x - center)/width)**2/(1 + (2*(x - center)/width)**2)",
    parameters=("height", "center", "width", "q"),
    limits={"height": (0.0, None), "width": (0.0, None)},
)


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
