"""docs/reference/python.md: what `estim` and `estim.model` offer to Python, from their docstrings."""

from __future__ import annotations

import inspect
import re
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any

import estim
from estim import model

_SUBJECTS = {
    "curve_fitting": "Curves",
    "curves": "Curves",
    "campaign": "Campaigns",
    "pipeline": "Campaigns",
    "line": "Straight lines",
    "means": "Means, and two values compared",
    "propagation": "Propagation of uncertainties",
    "reports": "Reports and other programs",
    "fitting": "Stages of an analysis",
    "sampling": "Stages of an analysis",
    "checks": "Stages of an analysis",
    "studies": "Stages of an analysis",
    "common": "Errors",
}
# records that no user makes: their fields, not how they are made
_MADE_BY_ESTIM = ("Analysis", "Campaign", "CurveFit", "LineFit")
_INTRODUCTION = """# What Python offers

Made by `make docs` from the docstrings. `import estim` has all names below but the last section, which is `import estim.model`: physics alone, SI units and
radians. Shapes are written `(n_obs,)`; a "mapping" goes from names to values. Start with `fit_curve` or `load_campaign`.
"""


def api_page() -> str:
    """The page in Markdown."""
    groups: dict[str, list[str]] = {subject: [] for subject in dict.fromkeys(_SUBJECTS.values())}
    # what is called before the records that it takes and gives
    for name, home in sorted(
        estim._homes().items(), key=lambda item: (item[0][0].isupper(), item[0])
    ):
        groups[_SUBJECTS[home.split(".")[1]]].append(_entry(name, getattr(estim, name)))
    groups["Physics of the rolling body: `estim.model`"] = [
        _entry(name, getattr(model, name)) for name in model.__all__
    ]
    return _INTRODUCTION + "".join(
        f"\n## {subject}\n{''.join(entries)}" for subject, entries in groups.items() if entries
    )


def _entry(name: str, thing: Any) -> str:
    if not callable(thing):
        return f"\n### {name}\n\n```python\n{name} = {thing!r}\n```\n"
    first, _, rest = (inspect.getdoc(thing) or "").partition("\n\n")
    shown = "" if name in _MADE_BY_ESTIM else f"\n```python\n{_signature(name, thing)}\n```\n"
    rest, _, example = f"\n{rest}".partition("\n>>> ")
    rest = rest.strip().removesuffix("Examples\n--------").strip()
    more = f"\n```text\n{rest}\n```\n" if rest and name not in _MADE_BY_ESTIM else ""
    more += f"\n```pycon\n>>> {example}\n```\n" if example else ""
    return (
        "\n### "
        f"{name}\n{shown}\n{_prose(first)}\n{more}{_members(name, thing) if inspect.isclass(thing) else ''}"
    )


def _prose(text: str) -> str:
    """The first paragraph as Markdown: what is no code keeps its signs."""
    line = " ".join(text.replace("``", "`").split())
    return line if "`" in line else re.sub(r"([*<\[|])", r"\\\1", line)


def _annotation(written: Any) -> str:
    return written if isinstance(written, str) else inspect.formatannotation(written)


def _default(value: Any) -> str:
    if isinstance(value, Enum):
        return str(value)
    if type(value).__repr__ is object.__repr__ or "factory" in repr(value):
        return "..."
    return getattr(value, "__name__", repr(value)) if callable(value) else repr(value)


def _signature(name: str, thing: Any) -> str:
    if inspect.isclass(thing) and issubclass(thing, Enum):
        return "\n".join(f"{name}.{member.name}" for member in thing)
    signature = inspect.signature(thing)
    parts, starred = [], False
    for parameter in signature.parameters.values():
        if parameter.kind is parameter.KEYWORD_ONLY and not starred:
            parts.append("*")
            starred = True
        mark = {parameter.VAR_POSITIONAL: "*", parameter.VAR_KEYWORD: "**"}.get(parameter.kind, "")
        starred = starred or mark == "*"
        text = (
            mark
            + parameter.name
            + (
                ""
                if parameter.annotation is parameter.empty
                else f": {_annotation(parameter.annotation)}"
            )
        )
        parts.append(
            text
            + ("" if parameter.default is parameter.empty else f" = {_default(parameter.default)}")
        )
    end = (
        ""
        if inspect.isclass(thing) or signature.return_annotation is signature.empty
        else f" -> {_annotation(signature.return_annotation)}"
    )
    line = f"{name}({', '.join(parts)}){end}"
    if len(line) <= 120:
        return line
    lines, row = [], "   "
    for part in parts:
        if len(row) + len(part) > 115:
            lines.append(row)
            row = "   "
        row += f" {part},"
    return "\n".join([f"{name}(", *lines, row, f"){end}"])


def _members(name: str, thing: Any) -> str:
    """Fields of a record that no user makes, and the properties and methods of any class."""
    rows = []
    if name in _MADE_BY_ESTIM and is_dataclass(thing):
        words = _field_words(thing)
        rows += [
            f"| `{field.name}: {_cell(_annotation(field.type))}` | {_cell(words.get(field.name, ''))} |"
            for field in fields(thing)
        ]
    for key in sorted(
        {
            key
            for kind in thing.__mro__[:-1]
            if kind.__module__.startswith("estim")
            for key in vars(kind)
        }
    ):
        member = inspect.getattr_static(thing, key)
        if key.startswith("_") or not (isinstance(member, property) or inspect.isfunction(member)):
            continue
        words = " ".join((inspect.getdoc(member) or "").partition("\n\n")[0].split())
        shown = (
            _signature(key, member).replace("(self, ", "(").replace("(self)", "()")
            if inspect.isfunction(member)
            else key
        )
        rows.append(f"| {_cell(f'`{chr(32).join(shown.split())}`')} | {_cell(words)} |")
    return "\n| | |\n|---|---|\n" + "\n".join(rows) + "\n" if rows else ""


_FIELD = r"(?:\w+, )*\w+ : "


def _field_words(thing: Any) -> dict[str, str]:
    """Field -> what the docstring says of it, in lines "name, other : words.  next : words"."""
    text = re.sub(r"\n +", " ", inspect.getdoc(thing) or "")
    said: dict[str, str] = {}
    for entry in re.split(rf"\n+|(?<=\.)  (?={_FIELD})", text):
        if re.match(_FIELD, entry):
            names, _, words = entry.partition(" : ")
            said |= dict.fromkeys(names.split(", "), words)
    return said


def _cell(text: str) -> str:
    return text.replace("|", "\\|")
