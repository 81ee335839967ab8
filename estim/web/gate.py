"""Who may ask: every request passes here before it reaches a page.

A page on this machine can be reached by every site that its user has open.  So the Host header must
be the bound address (DNS rebinding), a POST must come from the page itself (Origin), and all but
the style and the script need the cookie that the address with the token gave, or the passphrase.
"""

from __future__ import annotations

import asyncio
import hmac
import re
import secrets
from typing import TYPE_CHECKING

from starlette.datastructures import MutableHeaders
from starlette.requests import Request
from starlette.responses import RedirectResponse, Response

from estim.common import spoken
from estim.web.listening import ALL, At
from estim.web.page_template import closed, language_of
from estim.web.store import MOST_BYTES

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

_HEADERS = {
    "content-security-policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self' data:; connect-src 'self'; form-action 'self'; frame-ancestors 'none'; "
    "base-uri 'none'",
    "x-content-type-options": "nosniff",
    # "no-referrer" would have browsers send forms with the Origin "null"
    "referrer-policy": "same-origin",
    "cache-control": "no-store",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
}
_MOST_OF_A_FORM = 64 * 1024  # bytes, but for files
_LOCAL = r"127\.0\.0\.1|localhost|\[::1\]"
_NUMBER = r"[\d.]+|\[[\da-f:]+\]"  # for which no foreign name can stand


class Gate:
    """The pages of `app` for those who know the token or the passphrase.

    address : host and port as a browser names them.
    """

    def __init__(self, app: ASGIApp, *, address: str, token: str, at: At) -> None:
        self._app, self._token, self._passphrase = app, token, at.passphrase
        host, _, port = address.rpartition(":")
        names = _LOCAL if at.is_local else re.escape(host)
        names += f"|localhost|{_NUMBER}" * (at.host in ALL)
        self._hosts = re.compile(f"({names}):{port}" + f"|{names}" * (port == "80"), re.IGNORECASE)
        self._cookie = f"estim-{port}"  # cookies do not distinguish ports
        self._session = secrets.token_urlsafe(32)
        self._guessing = asyncio.Lock()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def sending(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in _HEADERS.items():
                    headers.setdefault(name, value)
            await send(message)

        request = Request(scope, receive)
        with spoken(language_of(request)):
            answer = await self._in_place(request) or self._app
            await answer(scope, receive, sending)

    async def _in_place(self, request: Request) -> Response | None:
        """What is answered in place of a page; None where the page may answer."""
        host, path = request.headers.get("host", ""), request.url.path
        if self._hosts.fullmatch(host) is None:
            return closed(421)
        if request.method == "POST":
            length = request.headers.get("content-length", "")
            if request.headers.get("origin") != f"http://{host}":
                return closed(403)
            if not re.fullmatch(r"[0-9]{1,12}", length):
                return closed(411)
            if int(length) > _MOST_OF_A_FORM + MOST_BYTES * (path == "/files"):
                return closed(413)
        if path.startswith("/static/"):
            return None
        if path == "/" and _same(request.query_params.get("token", ""), self._token):
            return self._let_in()
        if _same(request.cookies.get(self._cookie, ""), self._session):
            return None
        if not self._passphrase or path != "/enter" or request.method != "POST":
            return closed(401, ask=bool(self._passphrase))
        passphrase = str((await request.form()).get("passphrase", "")).strip()
        async with self._guessing:  # one wrong guess a second, whoever guesses
            if _same(passphrase, self._passphrase):
                return self._let_in()
            await asyncio.sleep(1.0)
        return closed(401, passphrase, ask=True)

    def _let_in(self) -> Response:
        answer = RedirectResponse("/", 303)
        answer.set_cookie(self._cookie, self._session, httponly=True, samesite="strict")
        return answer


def _same(text: str, known: str) -> bool:
    return hmac.compare_digest(text.encode("utf-8", "replace"), known.encode())
