"""Options that several commands have, each in the same words."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

import click

from estim.common import FIGURE_CHOICES, LANGUAGES, InputError, spoken


class Whole(click.IntRange):
    """A whole number from `least` to `most`."""

    def __init__(self, least: int, most: int | None = None) -> None:
        super().__init__(least, most)
        upper = "" if most is None else f" and at most {most}"
        self.rule = f"must be a whole number of at least {least}{upper}"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        with _rule_shown(self.rule, value, param):
            return super().convert(value, param, ctx)


class Real(click.FloatRange):
    """A number, from `low` to `high` where these are given."""

    def __init__(self, low: float | None = None, high: float | None = None) -> None:
        super().__init__(low, high)
        within = "" if low is None else f" between {low:g} and {high:g}"
        self.rule = f"must be a number{within}"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        with _rule_shown(self.rule, value, param):
            return super().convert(value, param, ctx)


@contextmanager
def _rule_shown(rule: str, value: Any, param: click.Parameter | None) -> Iterator[None]:
    """The error about a text that is no such number shows the rule."""
    try:
        yield
    except click.BadParameter:
        raise InputError(rule, field=param.opts[0] if param else None, value=value) from None


class Place(click.Path):
    """A file or a folder by its name: an empty one, as of a variable that is not set, would be the
    current folder.
    """

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if value == "":
            raise InputError("must not be empty", field=param.opts[-1] if param else None)
        return super().convert(value, param, ctx)


PATH = click.Path(path_type=Path)
FOLDER = Place(path_type=Path, file_okay=False)

CAMPAIGN = click.argument("campaign", type=PATH)
RUNS = click.option(
    "--run",
    "runs",
    multiple=True,
    metavar="NAME",
    help="This run only; may be given several times.  [default: every run]",
)
JOINT = click.option(
    "--joint", is_flag=True, help="Fit the runs jointly: each shared quantity is one unknown."
)
STEPS = click.option(
    "--max-steps",
    type=Whole(50),
    default=20_000,
    show_default=True,
    help="Hard cap on the sampler's steps.",
)
OUT = click.option(
    "--out",
    type=FOLDER,
    help="Folder for the report, made if it is not there.  [default: out/ and the name of the "
    "campaign, that of its folder where the file is called campaign.toml]",
)
OUT_MODELS, OUT_PLAN, OUT_MAP = (
    click.option(
        "--out",
        type=FOLDER,
        help="Folder for the report, made if it is not there.  [default: out/, the name of the "
        f"campaign, {part}/]",
    )
    for part in ("models", "plan", "map")
)
SEED = click.option(
    "--seed",
    type=Whole(0, 2**63 - 1),
    default=1,
    show_default=True,
    help="Seed of every random number.",
)
FIGURES = click.option(
    "--figures",
    type=click.Choice(FIGURE_CHOICES),
    default="main",
    show_default=True,
    help="The main figures of a report, all of them (of a fit also residuals, joint posterior, "
    "profiles, uncertainty budget and chains), or none.  Figures take a second or more.",
)
Command = Callable[..., Any]

JOBS = click.option(
    "--jobs",
    type=Whole(1),
    callback=lambda _context, _option, jobs: jobs or os.cpu_count() or 1,
    help="Processes.  [default: one for each core]",
)

RESUME = click.option(
    "--resume",
    is_flag=True,
    help="Go on with what an interrupted command had finished, kept in OUT/.checkpoint.",
)


def report_options(command: Command) -> Command:
    """The options of every command that writes a report with figures."""
    return SEED(FIGURES(FORMAT(LANG(command))))


def out_folder(campaign: Path, *parts: str) -> Path:
    """Where the report of a campaign goes by default, its `parts` within: two campaigns in one
    folder do not share it.
    """
    name = campaign.resolve().parent.name if campaign.stem == "campaign" else campaign.stem
    return Path("out", name, *parts)


def _speak(context: click.Context, _option: click.Parameter, name: str) -> str:
    """Sets the language of everything that the command prints from here on."""
    context.with_resource(spoken(name))
    return name


LANG = click.option(
    "--lang",
    type=click.Choice(list(LANGUAGES)),
    default="en",
    show_default=True,
    is_eager=True,
    expose_value=False,
    callback=_speak,
    help="Language of the report, its figures and the final messages.  Error messages stay "
    "English.",
)


_KEY = "estim.formats"
_BROWSER = "or print report.html with a browser"
_NEEDS = {
    "html": ("markdown_it", "pip install markdown-it-py"),
    "pdf": ("weasyprint", f'pip install "estim[pdf]"; {_BROWSER}'),
}

_LIBRARIES = "Pango: docs/reports.md says where from"


def _noted(
    context: click.Context, _option: click.Parameter, formats: tuple[str, ...]
) -> tuple[str, ...]:
    """Keeps the formats with the command, so that they need not be passed on.

    Raises InputError, before anything is computed, where one cannot be made.
    """
    for name in formats:
        module, remedy = _NEEDS[name]
        try:
            import_module(module)
        except ImportError:
            rule = f"needs the package {module}: {remedy}"
            raise InputError(rule, field=f"--format {name}") from None
        except OSError:  # of a package that calls libraries of the system
            rule = f"needs libraries that {module} does not find ({_LIBRARIES}); {_BROWSER}"
            raise InputError(rule, field=f"--format {name}") from None
    context.meta[_KEY] = formats
    return formats


FORMAT = click.option(
    "--format",
    "formats",
    type=click.Choice(list(_NEEDS)),
    multiple=True,
    expose_value=False,
    callback=_noted,
    help="Beside report.md: report.html, one file with all figures in it, or report.pdf.",
)


def chosen() -> tuple[str, ...]:
    """The formats that were requested of the command under way."""
    context = click.get_current_context(silent=True)
    return () if context is None else tuple(dict.fromkeys(context.meta.get(_KEY, ())))
