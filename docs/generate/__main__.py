"""Makes docs/reference anew from the code, or says what there is stale.

python docs/generate            # writes the pages (`make docs`)
python docs/generate --check    # exit code 1, and what is stale or unexplained on standard
error
"""

from __future__ import annotations

import sys
from pathlib import Path

from api_page import api_page
from command_page import commands_page
from key_page import keys_page
from schema import campaign_schema
from tables import without_words

REFERENCE = Path(__file__).resolve().parents[1] / "reference"


def made() -> dict[str, str]:
    """Every generated file: name -> text."""
    return {
        "commands.md": commands_page(),
        "campaign-keys.md": keys_page(),
        "python.md": api_page(),
        "estim-campaign-1.schema.json": campaign_schema(),
    }


def troubles() -> list[str]:
    """What is stale or has no words, a sentence each."""
    stale = [
        f"docs/reference/{name} is stale: make docs"
        for name, text in made().items()
        if (REFERENCE / name).read_text(encoding="utf-8") != text
    ]
    return stale + [f"docs/generate/key_words.toml: {key}" for key in without_words()]


if __name__ == "__main__":
    if "--check" in sys.argv[1:]:
        found = troubles()
        sys.exit("\n".join(found) if found else 0)
    for name, text in made().items():
        (REFERENCE / name).write_text(text, encoding="utf-8")
        print(REFERENCE / name)
