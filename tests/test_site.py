"""The pages of the site: every page of the documentation is in its menu, once, and nothing that is
not there.  That all links lead somewhere is what `make site` finds out.
"""

from __future__ import annotations

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
