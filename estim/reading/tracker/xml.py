"""The XML of a .trk file as a tree of named properties with their lines, and the .trk inside a
.trz; nothing is trusted.

Tracker writes ``<property name="delta_t" type="double">33.367</property>`` and objects that hold
such properties.  Document types are refused, and with them every entity that could expand or reach
out; elements, depth and sizes are limited.  A member of a .trz is read into memory: its name is
never used as a path.
"""

from __future__ import annotations

import re
import zipfile
from dataclasses import dataclass

from estim.common import InputError, listed
from estim.reading.archive import opened, unpacked
from estim.reading.input_file import decoded
from estim.reading.markup import Attributes, parse_xml

_MAX_ELEMENTS = 300_000
_MAX_DEPTH = 100
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_LIMIT = 1e9


@dataclass(frozen=True, eq=False)
class Element:
    """A `property` or an `object` of the file: its name or class, text, parts and line."""

    line: int
    tag: str
    name: str
    kind: str
    text: str
    parts: list[Element]

    def error(self, rule: str, *, value: object = None) -> InputError:
        return InputError(rule, field=self.name or self.tag, value=value, line=self.line)

    def find(self, name: str) -> Element | None:
        """The property `name` of this object; None where there is none."""
        return next(
            (part for part in self.parts if part.tag == "property" and part.name == name), None
        )

    def object(self, name: str) -> Element | None:
        """The object that is the value of property `name`."""
        element = self.find(name)
        return (
            None
            if element is None
            else next((part for part in element.parts if part.tag == "object"), None)
        )

    def need(self, name: str) -> Element:
        """The property `name`; raises InputError where it is missing."""
        element = self.find(name)
        if element is None:
            raise InputError("is missing", field=name, line=self.line)
        return element

    def number(self, name: str, default: float | None = None) -> float:
        """The finite number that property `name` holds.  Raises InputError."""
        element = self.find(name)
        if element is None and default is not None:
            return default
        element = self.need(name)
        value = (
            float(element.text)
            if len(element.text) < 50 and _NUMBER.fullmatch(element.text)
            else float("inf")
        )
        if not abs(value) <= _LIMIT:
            raise element.error(f"must be a number within ±{_LIMIT:g}", value=element.text)
        return value

    def integer(self, name: str, default: int) -> int:
        """The whole number that property `name` holds.  Raises InputError."""
        value = self.number(name, float(default))
        if value != round(value):
            raise self.need(name).error("must be a whole number", value=value)
        return round(value)

    def indexed(self) -> dict[int, Element]:
        """The objects of an array of properties [0], [1], ..., by index; raises InputError for any
        other content.
        """
        objects: dict[int, Element] = {}
        for part in self.parts:
            index = re.fullmatch(r"\[(\d{1,7})\]", part.name, re.ASCII)
            if index is None or not part.parts or part.parts[0].tag != "object":
                raise part.error("must be an object with an index like [0]")
            if int(index[1]) in objects:
                raise part.error("stands twice")
            objects[int(index[1])] = part.parts[0]
        return objects


def parse_tracker_xml(data: bytes) -> Element:
    """The root object of the XML text `data`.  The encoding may be UTF-8, UTF-16 or Windows-1252,
    whatever the file declares: only names of tracks hold characters that differ between them.
    Raises InputError with the line.
    """
    written, _ = decoded(data)
    top: list[Element] = []
    stack = [(0, top)]  # line and parts of each element that has begun
    count = 0

    def on_start(tag: str, _: Attributes, line: int) -> None:
        nonlocal count
        count += 1
        if count > _MAX_ELEMENTS:
            raise InputError(f"must hold at most {_MAX_ELEMENTS} elements", field="XML", line=line)
        if len(stack) > _MAX_DEPTH:
            raise InputError(f"must be nested at most {_MAX_DEPTH} deep", field="XML", line=line)
        if tag not in ("object", "property"):
            rule = "must hold nothing but <object> and <property>, as Tracker writes it"
            raise InputError(rule, field="XML", value=tag, line=line)
        stack.append((line, []))

    def on_end(tag: str, attributes: Attributes, text: str) -> None:
        line, parts = stack.pop()
        kind = attributes.get("class" if tag == "object" else "type", "")
        element = Element(line, tag, attributes.get("name", ""), kind, text.strip(), parts)
        stack[-1][1].append(element)

    parse_xml(written, on_end, on_start)
    return top[0]


def unpack_trz(data: bytes, track: str | None) -> tuple[bytes, str | None]:
    """The .trk inside the .trz archive `data`, at most 64 MiB, and the name of the track in it.

    Where there are several, `track` is "NAME.trk" or "NAME.trk/mass A".  Raises InputError.
    """
    with opened(data) as archive:
        members = [
            i
            for i in archive.infolist()
            if i.filename.lower().endswith(".trk") and not i.filename.startswith("__MACOSX/")
        ]
        if not members:
            raise InputError("must hold a .trk", field="archive", quoted="it holds none")
        info, track = _member(members, track)
        return unpacked(archive, info), track


def _member(
    members: list[zipfile.ZipInfo], track: str | None
) -> tuple[zipfile.ZipInfo, str | None]:
    """The .trk that `track` begins with, or the only one, and the rest of `track`.  Raises
    InputError.
    """
    for info in members:
        if track is not None and (track == info.filename or track.startswith(f"{info.filename}/")):
            return info, track[len(info.filename) + 1 :] or None
    if len(members) == 1:
        return members[0], track
    raise InputError(
        'must say which of several .trk: "NAME.trk", or "NAME.trk/mass A" where that holds '
        "several tracks",
        field="track",
        quoted=f"it holds {listed([info.filename for info in members])}",
    )
