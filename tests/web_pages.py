"""A server of the page on this machine, and a browser that only knows HTTP."""

from __future__ import annotations

import http.client
import json
import re
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import urlencode

import uvicorn

from estim.web import At
from estim.web.serving import application

TOKEN = "a-token-of-the-tests"
PATIENCE = 120.0


@dataclass
class Reply:
    status: int
    headers: Mapping[str, str]
    body: bytes

    @property
    def text(self) -> str:
        return self.body.decode()

    @property
    def place(self) -> str:
        return self.headers["location"]


@dataclass
class Browser:
    """Keeps a cookie; sends the headers that a browser sends, unless told otherwise."""

    address: str
    cookies: dict[str, str] = field(default_factory=dict)

    def send(
        self, method: str, path: str, body: bytes = b"", headers: Mapping[str, str | None] = {}
    ) -> Reply:
        host, _, port = self.address.rpartition(":")
        sent = {"Host": self.address, "Content-Length": str(len(body)) if body else "0"}
        if method == "POST":
            sent["Origin"] = f"http://{self.address}"
        if self.cookies:
            sent["Cookie"] = "; ".join(f"{name}={value}" for name, value in self.cookies.items())
        connection = http.client.HTTPConnection(host, int(port), timeout=PATIENCE)
        try:
            connection.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
            for name, value in (sent | dict(headers)).items():
                if value is not None:
                    connection.putheader(name, value)
            connection.endheaders(body)
            answer = connection.getresponse()
            reply = Reply(
                answer.status,
                {name.lower(): value for name, value in answer.getheaders()},
                answer.read(),
            )
        finally:
            connection.close()
        for name, value in answer.getheaders():
            if name.lower() == "set-cookie":
                key, _, rest = value.partition("=")
                self.cookies[key] = rest.partition(";")[0]
        return reply

    def get(self, path: str, **headers: str | None) -> Reply:
        return self.send("GET", path, headers=headers)

    def fill_in(self, path: str, **fields: str) -> Reply:
        """Sends a form."""
        kind = {"Content-Type": "application/x-www-form-urlencoded"}
        return self.send("POST", path, urlencode(fields).encode(), kind)

    def hand_in(
        self, files: Mapping[str, bytes], *, fields: Mapping[str, str] = {}, **headers: str | None
    ) -> Reply:
        """Uploads files, by the names that they shall have, in a form with further fields."""
        start = '--edge\r\nContent-Disposition: form-data; name="'
        parts = "".join(f'{start}{key}"\r\n\r\n{text}\r\n' for key, text in fields.items()).encode()
        for name, data in files.items():
            quoted = name.replace("\\", "\\\\").replace('"', "%22")
            parts += (
                (
                    f'--edge\r\nContent-Disposition: form-data; name="files"; '
                    f'filename="{quoted}"\r\n'
                    "Content-Type: application/octet-stream\r\n\r\n"
                ).encode()
                + data
                + b"\r\n"
            )
        kind = {"Content-Type": "multipart/form-data; boundary=edge"}
        return self.send("POST", "/files", parts + b"--edge--\r\n", kind | headers)

    def ended(self, place: str) -> Reply:
        """The page of an answer once it has ended."""
        end = time.monotonic() + PATIENCE
        while not json.loads(self.get(f"{place}/state").body)["ended"]:
            assert time.monotonic() < end, "the answer does not end"
            time.sleep(0.1)
        return self.get(place)


@contextmanager
def served(folder: Path, *, passphrase: str = "") -> Iterator[str]:
    """The address of a server of `folder`, which ends with the block."""
    at = At("127.0.0.1", 0, folder, passphrase)
    with application(at, TOKEN) as (app, listener, address):
        config = uvicorn.Config(app, lifespan="off", ws="none", log_config=None)
        server = uvicorn.Server(config)
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]})
        thread.start()
        try:
            yield address
        finally:
            server.should_exit = True
            thread.join()


def entered(address: str) -> Browser:
    """A browser that has opened the address with the token."""
    browser = Browser(address)
    assert browser.get(f"/?token={TOKEN}").status == 303
    return browser


def words(html: str) -> str:
    """What a page says, without its tags."""
    return re.sub(r"\s+", " ", re.sub(r"<[^>]*>", " ", html))
