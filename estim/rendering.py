"""Templates of `templates/` filled in."""

from __future__ import annotations


def render(template: str, **values: object) -> str:
    """A template of `templates/` filled in."""
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("estim"), undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True,
        keep_trailing_newline=True, autoescape=False,
    )
    environment.filters["number"] = lambda v, digits=3: "n/a" if v is None else f"{v:.{digits}g}"
    environment.filters["cell"] = lambda text: str(text).replace("|", "\\|")
    return environment.get_template(template).render(**values)
