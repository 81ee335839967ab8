"""What installed packages add by entry points: models by name (`estim.curves.models`), readers of
files (`estim.reading.source`), laws of the errors (`estim.problem.installed_tails`) and sections of
reports (`estim.reports.sections`).  `docs/extending.md` explains them to their authors.

A campaign can name what is there and brings no code of its own.  Packages are looked through when
a name is met that is not estim's own, and each is imported when it is used.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, TypeVar

from estim.common import InputError, listed
from estim.shadowed_modules import working_folder
from estim.versions import USED

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

T = TypeVar("T")


@dataclass(frozen=True)
class Plugin:
    """An entry point, and the installed package that has it."""

    point: EntryPoint
    package: str
    version: str

    @property
    def name(self) -> str:
        return self.point.name

    @property
    def owner(self) -> str:
        return f"{self.package} {self.version}"

    def make(self, step: Callable[[Any], object], kind: type[T]) -> T:
        """What `step` makes of the object behind the entry point.  The package then counts among
        those that were used.

        Raises InputError in one line, whatever goes wrong in the package.
        """
        try:
            result = step(self.point.load())
            if not isinstance(result, kind):
                raise TypeError(f"this is {type(result).__name__} and not {kind.__name__}")
        except (Exception, SystemExit) as error:  # other people's code
            raise self.error("does not work", f"{type(error).__name__}: {error}") from None
        USED.set(USED.get({}) | {self.package: self.version})
        return result

    def error(self, rule: str, why: str = "") -> InputError:
        """An InputError that names the package and the entry point."""
        point = f"{self.point.group}: {self.name} = {self.point.value}"
        message = f"of the package {self.owner} (entry point {point}) {rule}"
        return InputError(message, field=self.name, quoted=why)


@cache
def plugins(group: str) -> tuple[Plugin, ...]:
    """What installed packages offer in a group of entry points, by name.  What lies in the working
    folder came with the data, and is not installed.
    """
    from importlib import metadata

    working = os.path.realpath(working_folder())
    path = [place for place in sys.path if os.path.realpath(place or working) != working]
    by_name: dict[tuple[str, str], Plugin] = {}
    for package in metadata.distributions(path=path):
        for point in package.entry_points.select(group=group):
            plugin = Plugin(point, package.name, package.version)
            by_name.setdefault((point.name, package.name), plugin)  # the first on the path
    return tuple(by_name[key] for key in sorted(by_name))


def plugin_called(group: str, name: str) -> Plugin | None:
    """The one that has this name.  Raises InputError where several packages offer it."""
    matching = [plugin for plugin in plugins(group) if plugin.name == name]
    if len(matching) > 1:
        raise InputError(
            "is offered by several installed packages: uninstall all but one",
            field=name,
            quoted=listed([plugin.owner for plugin in matching]),
        )
    return matching[0] if matching else None


def plugin_asked(group: str, name: str, *, field: str) -> Plugin:
    """The same, where nothing else has the name.  Raises InputError where there is none."""
    plugin = plugin_called(group, name)
    if plugin is None:
        offered = listed([plugin.name for plugin in plugins(group)]) or "there is none"
        rule = f"must name a {field} of an installed package"
        raise InputError(rule, field=field, value=name, quoted=offered)
    return plugin


def told(group: str, describe: Callable[[Plugin], str]) -> Iterator[str | InputError]:
    """A description of each plugin of a group, or why it cannot be used."""
    for plugin in plugins(group):
        try:
            plugin_called(group, plugin.name)
            yield f"{describe(plugin)}  ({plugin.owner})"
        except InputError as error:
            yield error
