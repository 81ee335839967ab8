"""Templates of `templates/` filled in."""

from __future__ import annotations

from estim.goodness import P_FLOOR
from estim.quantity import signed


def p_words(p: float) -> str:
    """A p-value for a table: '0.031', or '< 5e-05' where it is the least that simulation can tell."""
    return f"< {P_FLOOR:.1g}" if p <= P_FLOOR else f"{p:.2g}"


def render(template: str, **values: object) -> str:
    """A template of `templates/` filled in."""
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("estim"), undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True,
        keep_trailing_newline=True, autoescape=False,
    )
    environment.filters["number"] = lambda v, digits=3: "n/a" if v is None else signed(f"{v:.{digits}g}")
    environment.filters["signed"] = signed
    environment.filters["p"] = p_words
    environment.filters["cell"] = lambda text: str(text).replace("|", "\\|")
    return environment.get_template(template).render(**values)
