"""Who may ask: every request passes here before any page sees it.

A page on this machine can be reached by every site that its user has open.  So the Host header must
be the bound address (DNS rebinding), a POST must come from the page itself (Origin), and all but
the style and the script need the cookie that the address with the token gave, or the passphrase.
"""

from __future__ import annotations

import asyncio
import hmac
import secrets
from ipaddress import ip_address
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qs

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import cookie_parser
from starlette.responses import RedirectResponse, Response

from estim.common import phrase
from estim.web.listening import At
from estim.web.looks import language_of, page
from estim.web.store import MOST_BYTES

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self'; frame-src 'self'; form-action 'self'; frame-ancestors 'self'; "
    "base-uri 'none'"
)
_MULTIPART = MOST_BYTES + 64 * 1024  # with what parts the files
_PASSPHRASE_BYTES = 4096


class Gate:
    """The pages of `app` for those who know the token or the passphrase.

    address : host and port as a browser names them.
    """

    def __init__(self, app: ASGIApp, *, address: str, token: str, at: At) -> None:
        self._app, self._address, self._token, self._at = app, address, token, at
        self._port = address.rpartition(":")[2]
        self._cookie = f"estim-{self._port}"  # cookies do not tell ports apart
        self._session = secrets.token_urlsafe(32)
        self._guessing = asyncio.Lock()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            return
        headers = Headers(scope=scope)

        async def sending(message: Message) -> None:
            if message["type"] == "http.response.start":
                _add_headers(MutableHeaders(scope=message))
            await send(message)

        with language_of(headers):
            answer = await self._refusal(scope, headers, receive)
            await (answer or self._app)(scope, receive, sending)

    async def _refusal(self, scope: Scope, headers: Headers, receive: Receive) -> Response | None:
        """What is answered in place of a page; None where the page may answer."""
        host, post = headers.get("host", ""), scope["method"] == "POST"
        if scope["method"] not in ("GET", "HEAD", "POST"):
            return Response(status_code=405, headers={"Allow": "GET, HEAD, POST"})
        if not self._is_ours(host):
            return page("closed", 421, words=phrase("This is not the address of this page."))
        if post and headers.get("origin") != f"http://{host}":
            return page("closed", 403, words=phrase("This request came from another page."))
        if post and (too_much := _size_refused(headers)):
            return too_much
        if scope["path"].startswith("/static/"):
            return None
        token = parse_qs(scope["query_string"].decode("latin-1")).get("token", [""])[0]
        if scope["path"] == "/" and token and _same(token, self._token):
            return self._let_in()
        cookie = cookie_parser(headers.get("cookie", "")).get(self._cookie, "")
        if _same(cookie, self._session):
            return None
        if not self._at.passphrase:
            words = phrase("Open the address that estim serve printed when it was started.")
            return page("closed", 403, words=words)
        if post and scope["path"] == "/enter":
            return await self._entered(await _body(receive))
        return page("closed", 401, words="", ask=True)

    async def _entered(self, body: bytes) -> Response:
        given = parse_qs(body.decode("latin-1"), encoding="utf-8").get("passphrase", [""])[0]
        async with self._guessing:  # one guess a second, whoever guesses
            if _same(given.strip(), self._at.passphrase):
                return self._let_in()
            await asyncio.sleep(1.0)
        return page("closed", 401, words=phrase("This is not the passphrase."), ask=True)

    def _let_in(self) -> Response:
        answer = RedirectResponse("/", 303)
        answer.set_cookie(self._cookie, self._session, httponly=True, samesite="strict")
        return answer

    def _is_ours(self, host: str) -> bool:
        """Whether a Host header names the bound address: on all addresses of a machine also by a
        number, which no foreign name can stand for.
        """
        name, _, port = host.lower().rpartition(":")
        if port != self._port:
            return False
        if self._at.is_local:
            return name in ("127.0.0.1", "localhost", "[::1]", self._address.rpartition(":")[0])
        if name == self._address.rpartition(":")[0].lower():
            return True
        return self._at.host in ("0.0.0.0", "::") and (name == "localhost" or _is_number(name))


def _add_headers(headers: MutableHeaders) -> None:
    for name, value in (
        ("content-security-policy", POLICY),
        ("x-content-type-options", "nosniff"),
        # "no-referrer" would have browsers send forms with the Origin "null"
        ("referrer-policy", "same-origin"),
        ("cache-control", "no-store"),
        ("cross-origin-opener-policy", "same-origin"),
        ("cross-origin-resource-policy", "same-origin"),
    ):
        headers.setdefault(name, value)


def _size_refused(headers: Headers) -> Response | None:
    length = headers.get("content-length", "")
    if not length.isascii() or not length.isdigit():
        return page("closed", 411, words=phrase("A request must say how long it is."))
    if int(length) > _MULTIPART:
        most = MOST_BYTES // 1024**2
        words = phrase("That is too large: at most {most} MB at once.", most=most)
        return page("closed", 413, words=words)
    return None


async def _body(receive: Receive) -> bytes:
    """The beginning of what was sent, enough for a passphrase."""
    data = b""
    while True:
        message: Any = await receive()
        data = (data + message.get("body", b""))[:_PASSPHRASE_BYTES]
        if not message.get("more_body"):
            return data


def _same(given: str, known: str) -> bool:
    return hmac.compare_digest(given.encode("utf-8", "replace"), known.encode())


def _is_number(name: str) -> bool:
    try:
        ip_address(name.strip("[]"))
    except ValueError:
        return False
    return True
