"""The pages of the site: every page of the documentation is in its menu, once, and nothing that is
not there.  That all links lead somewhere is what `make site` finds out.
"""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path


def test_every_page_is_in_the_menu_once(project: Path) -> None:
    menu = (project / "docs" / "site" / "mkdocs.yml").read_text().partition("\nnav:\n")[2]
    listed = re.findall(r"(?:: |- )(\S+\.(?:md|ipynb))$", menu, flags=re.M)
    assert len(listed) == len(set(listed))
    pages = {
        page.relative_to(project).as_posix()
        for pattern in ("*.md", "docs/*.md", "docs/reference/*.md", "docs/tutorials/*.*")
        for page in project.glob(pattern)
        if page.suffix in (".md", ".ipynb")
    }
    assert pages <= set(listed)
    assert all(
        (project / page).is_file()
        for page in listed
        # the source archive has no reports
        if not page.startswith("reports/") or (project / "reports").is_dir()
    )


MENU = """<div class="md-sidebar--primary"><ul>
<li class="md-nav__item"><a href="{up}index.html">Front</a></li>
<li class="md-nav__item md-nav__item--nested {section}"><label>Section</label><br><ul>
<li><a href="{up}s/first.html">First</a></li><li><a href="{up}s/second.html#a">Second</a></li>
</ul></li></ul></div>
"""


def test_clicks_are_counted_as_the_menu_shows_links(project: Path, tmp_path: Path) -> None:
    spec = importlib.util.spec_from_file_location("clicks", project / "docs" / "site" / "clicks.py")
    assert spec is not None
    assert spec.loader is not None
    hook = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(hook)
    tab = '<nav class="md-tabs"><a href="s/first.html">Section</a></nav>'
    active = MENU.format(up="../", section="md-nav__item--active")
    for name, text in {
        "index": tab + MENU.format(up="", section="") + '<a href="https://elsewhere">x</a>',
        "404": '<a href="lost.html">x</a>',
        "s/first": active + '<main><a href="../r/deep.html">deep</a></main>',
        "s/second": active,
        "r/deep": '<img src="x"><p><a href="deeper.html">deeper</a>',
        "r/deeper": '<div class="md-sidebar--secondary"><a href="../lost.html">x</a></div>',
        "lost": "",
    }.items():
        path = tmp_path / f"{name}.html"
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
    desktop, telephone = (hook.clicks(tmp_path, narrow=narrow) for narrow in (False, True))
    never = float("inf")
    assert desktop == {
        "index.html": 0,
        "s/first.html": 1,
        "s/second.html": 2,
        "r/deep.html": 2,
        "r/deeper.html": 3,
        "lost.html": never,
    }
    assert telephone == {
        "index.html": 0,
        "s/first.html": 3,  # the menu, its section, the page
        "s/second.html": 3,
        "r/deep.html": 4,
        "r/deeper.html": 5,
        "lost.html": never,
    }
