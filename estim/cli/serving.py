"""`estim serve`: a page in the browser for those who never open a terminal."""

from __future__ import annotations

import secrets
import sys
from pathlib import Path

import click

from estim.cli.options import FOLDER, Whole
from estim.cli.terminal import say
from estim.common import InputError, phrase


@click.command()
@click.argument("place", metavar="[FOLDER]", required=False, type=FOLDER)
@click.option(
    "--port",
    type=Whole(1, 65535),
    help="Port of the page.  [default: 8765, or a free one where that is taken]",
)
@click.option(
    "--host",
    default="127.0.0.1",
    show_default=True,
    help="Address that is listened on; any but that of this machine opens the page to others, who "
    "need a passphrase.",
)
@click.option("--folder", type=FOLDER, help="The same as FOLDER.")
@click.option("--browser/--no-browser", default=True, help="Open the page in the browser.")
def serve(
    place: Path | None, port: int | None, host: str, folder: Path | None, browser: bool
) -> None:
    """Serve a page on this machine: drop a file, ask, get the report (docs/serve.md).

    Files and answers are kept in FOLDER, estim-answers where none is named; a later server goes on
    with them.  Needs the extra `web`.  Ctrl-C ends it.
    """
    from estim.web import At, missing_packages
    from estim.web import serve as serve_page

    if missing := missing_packages():
        raise InputError(
            f'needs the packages {", ".join(missing)}: pip install "estim[web]"', field="serve"
        )
    if place and folder:
        raise InputError(f"names the folder a second time, after {place}", field="--folder")
    folder = place or folder or Path("estim-answers")
    at = At(host, port, folder)
    if not at.is_local:
        at = At(host, port, folder, _passphrase())
        say(phrase("Others who reach {host} can use this page with the passphrase.", host=host))
        say(
            phrase(
                "They see all files and answers in {folder}, and what they send is not "
                "encrypted: use it in a network that you trust.",
                folder=folder,
            )
        )
        say(phrase("passphrase: {passphrase}", passphrase=at.passphrase))
    serve_page(
        at, lambda url: say(phrase("page: {url} (Ctrl-C ends it)", url=url)), browser=browser
    )


def _passphrase() -> str:
    """What the user types, or one that is made."""
    typed = ""
    if sys.stdin.isatty():
        words = "Passphrase of the page (empty: one is made)"
        typed = click.prompt(words, default="", show_default=False).strip()
    return typed or secrets.token_hex(6)
