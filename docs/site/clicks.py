"""When the site is built: how many clicks each page is from the front page, on a desktop and on a
telephone; too many are an error.

A hook of MkDocs (`hooks` in mkdocs.yml).  A link in text, in a tab or at the foot is one click.  On
a desktop the menu at the side shows the pages of the section that is read.  On a telephone the menu
opens with a click and shows that section, or all of them, each of which opens with one more.
"""

from __future__ import annotations

from collections.abc import Mapping
from heapq import heappop, heappush
from html.parser import HTMLParser
from pathlib import Path
from posixpath import dirname, join, normpath
from urllib.parse import unquote, urlsplit

MOST = 3
VOID = {
    "area",
    "base",
    "br",
    "col",
    "embed",
    "hr",
    "img",
    "input",
    "link",
    "meta",
    "source",
    "track",
    "wbr",
}


class _Links(HTMLParser):
    """Links of a page, each with the classes of everything around it."""

    def __init__(self) -> None:
        super().__init__()
        self.around: list[tuple[str, list[str]]] = []
        self.links: list[tuple[str, list[list[str]]]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        attributes = dict(attrs)
        if tag not in VOID:
            self.around.append((tag, (attributes.get("class") or "").split()))
        if tag == "a" and attributes.get("href"):
            self.links.append((attributes["href"], [classes for _, classes in self.around]))

    def handle_endtag(self, tag: str) -> None:
        if any(tag == open_tag for open_tag, _ in self.around):
            while self.around.pop()[0] != tag:
                pass


def _clicks(around: list[list[str]], *, narrow: bool, in_section: bool) -> int | None:
    """Clicks that a link takes with the classes `around` it; None for one that cannot be seen."""
    marks = {mark for classes in around for mark in classes}
    if "md-sidebar--secondary" in marks:
        return None  # of this page alone
    if "md-sidebar--primary" not in marks:
        return None if narrow and "md-tabs" in marks else 1
    closed = sum(
        "md-nav__item--nested" in classes and "md-nav__item--active" not in classes
        for classes in around
    )
    opened = any(
        {"md-nav__item--nested", "md-nav__item--active"} <= set(classes) for classes in around
    )
    if narrow:
        return 2 + closed + (in_section and not opened)
    return None if closed else 1


def clicks(site: Path, *, narrow: bool) -> dict[str, float]:
    """Page of the built `site` -> the fewest clicks from the front page to it."""
    pages = {path.relative_to(site).as_posix() for path in site.rglob("*.html")} - {"404.html"}
    fewest, waiting = (
        dict.fromkeys(sorted(pages), float("inf")) | {"index.html": 0},
        [(0, "index.html")],
    )
    while waiting:
        so_far, page = heappop(waiting)
        parser = _Links()
        parser.feed((site / page).read_text(encoding="utf-8"))
        in_section = any(
            {"md-nav__item--nested", "md-nav__item--active"} <= set(classes)
            for _, around in parser.links
            for classes in around
        )
        for link, around in parser.links:
            address, cost = urlsplit(link), _clicks(around, narrow=narrow, in_section=in_section)
            target = normpath(join(dirname(page), unquote(address.path)))
            if (
                cost is None
                or address.netloc
                or not address.path
                or so_far + cost >= fewest.get(target, -1)
            ):
                continue
            fewest[target] = so_far + cost
            heappush(waiting, (so_far + cost, target))
    return fewest


def on_post_build(config: Mapping[str, str]) -> None:
    """Raises PluginError where a page is too far from the front page."""
    from mkdocs.exceptions import PluginError

    for narrow, where in ((False, "on a desktop"), (True, "on a telephone")):
        far = [
            f"{page} ({n})"
            for page, n in clicks(Path(config["site_dir"]), narrow=narrow).items()
            if n > MOST
        ]
        if far:
            raise PluginError(
                f"more than {MOST} clicks from the front page {where}: {', '.join(far)}"
            )
