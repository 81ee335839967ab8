"""The pages: a file, a question about it, the answer.  Each works without JavaScript.

No name that comes from a browser is a path: ids are looked up among the records, files of a report
among those that are there.
"""

from __future__ import annotations

import asyncio
import io
import json
import zipfile
from collections.abc import Mapping
from dataclasses import replace
from importlib.resources import files
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Any
from urllib.parse import quote, urlencode, urlsplit, urlunsplit

from starlette.applications import Starlette
from starlette.datastructures import UploadFile
from starlette.exceptions import HTTPException
from starlette.responses import JSONResponse, RedirectResponse, Response
from starlette.routing import Route

from estim.common import KINDS as DATA
from estim.common import LANGUAGES, EstimError, InputError, language, later, phrase, shorten
from estim.web.looks import LANGUAGE, page, static
from estim.web.preview import picture_name, preview_name
from estim.web.question import (
    KINDS,
    MODELS,
    OPTIONS,
    arguments_of,
    arguments_of_propagation,
    command_line,
    fields_of,
)
from estim.web.store import ENDINGS, MOST_BYTES, MOST_FILES, Answer, Store, Upload
from estim.web.work import Job, Workers

if TYPE_CHECKING:
    from starlette.requests import Request
    from starlette.types import ASGIApp

_SECONDS, _PREVIEW_SECONDS = 600, 30
_PATIENCE = 20.0  # s that a page waits for a preview
_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".md": "text/markdown; charset=utf-8",
    ".csv": "text/csv; charset=utf-8",
    ".json": "application/json",
    ".png": "image/png",
    ".pdf": "application/pdf",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
}
_REPORT_POLICY = (
    "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'self'"
)
EXAMPLES: Mapping[str, tuple[str, Mapping[str, str]]] = {
    "cooling": (
        later("A cup of tea that cools: a curve"),
        {"kind": "formula", "formula": "room + excess*exp(-t/tau)", "data": "synthetic"},
    ),
    "spring": (later("A spring and its load: a straight line"), {"kind": "line"}),
}


class Pages:
    """What is shown of a store, and asked of workers."""

    def __init__(self, store: Store, fits: Workers, previews: Workers) -> None:
        self._store, self._fits, self._previews = store, fits, previews
        self._jobs = dict[str, Job]()  # id of an answer -> while it is under way
        self._taking = asyncio.Lock()  # one upload after the other is in memory

    def app(self) -> ASGIApp:
        post = ["POST"]
        return Starlette(
            routes=[
                Route("/", self.start),
                Route("/files", self.take_in, methods=post),
                Route("/examples/{name}", self.example, methods=post),
                Route("/files/{id}", self.question),
                Route("/files/{id}", self.ask, methods=post),
                Route("/files/{id}/points.png", self.points),
                Route("/propagate", self.propagate),
                Route("/propagate", self.ask_propagate, methods=post),
                Route("/answers/{id}", self.answer),
                Route("/answers/{id}/state", self.state),
                Route("/answers/{id}/cancel", self.cancel, methods=post),
                Route("/answers/{id}/all.zip", self.everything),
                Route("/answers/{id}/report/{path:path}", self.report_file),
                Route("/language/{to}", self.speak),
                Route("/static/{name}", self.asset),
            ],
            exception_handlers={HTTPException: _in_words, EstimError: _failed, Exception: _broken},
        )

    # ---- the file ----

    async def start(self, request: Request) -> Response:
        return self._start()

    def _start(self, status: int = 200, error: str = "") -> Response:
        answers = list(self._store.answers.values())[::-1]
        return page(
            "file",
            status,
            answers=[(answer, _standing(answer)) for answer in answers[:50]],
            uploads=list(self._store.uploads.values())[:-21:-1],
            examples={name: phrase(words) for name, (words, _) in EXAMPLES.items()},
            endings=ENDINGS,
            most=MOST_BYTES // 1024**2,
            error=error,
        )

    async def take_in(self, request: Request) -> Response:
        async with self._taking, request.form(max_files=MOST_FILES, max_fields=0) as form:
            given: dict[str, bytes] = {}
            for _, value in form.multi_items():
                if isinstance(value, UploadFile) and value.filename:
                    name = PurePosixPath(value.filename.replace("\\", "/")).name
                    given[name] = await value.read()
            if not given:
                return self._start(422, phrase("Choose a file first."))
            try:
                uploads = await asyncio.to_thread(self._store.take_in, given)
            except InputError as error:
                return self._start(422, error.rule)
        return _to(f"/files/{uploads[0].id}" if len(uploads) == 1 else "/#files-here")

    async def example(self, request: Request) -> Response:
        name = request.path_params["name"]
        if name not in EXAMPLES:
            raise HTTPException(404)
        data = files("estim.web").joinpath("examples", f"{name}.csv").read_bytes()
        (upload,) = self._store.take_in({f"{name}.csv": data})
        self._store.keep(replace(upload, asked=dict(EXAMPLES[name][1])))
        return _to(f"/files/{upload.id}")

    # ---- the question ----

    async def question(self, request: Request) -> Response:
        """The form, empty, or as it was filled in: for an answer that was refused, or in the
        address (a click on a model without JavaScript).
        """
        upload = self._upload(request)
        refused = self._store.answers.get(request.query_params.get("answer", ""))
        if refused is not None and refused.upload == upload.id:
            return await self._form(upload, refused.fields, refused.error, refused.field)
        fields = fields_of(request.query_params.multi_items()) or upload.asked
        if model := request.query_params.get("model"):
            fields = fields | {"formula": model, "kind": "formula"}
        return await self._form(upload, fields)

    async def _form(
        self,
        upload: Upload,
        fields: Mapping[str, str],
        error: str = "",
        field: str = "",
        status: int = 200,
    ) -> Response:
        seen = await self._preview(upload)
        columns = seen.get("columns", [])
        names = [column["name"] for column in columns]
        numbers = [
            names.index(fields[key]) if fields.get(key) in names else seen.get(key, 0)
            for key in ("x", "y")
        ]
        return page(
            "question",
            status,
            upload=upload,
            seen=seen,
            columns=columns,
            chosen=numbers,
            fields={"kind": "formula", **fields},
            kinds=KINDS,
            models=MODELS,
            data=DATA,
            error=error,
            wrong=_field_of(field),
        )

    async def ask(self, request: Request) -> Response:
        upload = self._upload(request)
        form, fields = await request.form(max_files=0), dict[str, str]()
        try:
            fields = fields_of(form.multi_items())
            arguments = arguments_of(
                fields, upload.file, PurePosixPath(upload.given).stem, language()
            )
            return self._asked(upload, fields, arguments)
        except InputError as error:
            return await self._form(upload, fields, error.rule, error.field or "", 422)

    async def propagate(self, request: Request) -> Response:
        refused = self._store.answers.get(request.query_params.get("answer", ""))
        if refused is not None and not refused.upload:
            return _propagation(refused.fields, refused.error)
        return _propagation({})

    async def ask_propagate(self, request: Request) -> Response:
        form, fields = await request.form(max_files=0), dict[str, str]()
        try:
            fields = fields_of(form.multi_items())
            return self._asked(None, fields, arguments_of_propagation(fields, language()))
        except InputError as error:
            return _propagation(fields, error.rule, 422)

    def _asked(
        self, upload: Upload | None, fields: Mapping[str, str], arguments: list[str]
    ) -> Response:
        """Begins the command.  Its answer is kept whole when it ends, whoever still looks."""
        if self._fits.is_full:
            return _busy()
        answer = self._store.begin(upload, fields, arguments, language())
        job = Job(self._store.folder(answer), ["run", *arguments], seconds=_SECONDS)

        def keep() -> None:
            ended = replace(
                answer,
                state=job.state,
                code=job.code,
                said=tuple(job.said),
                error=job.error,
                field=job.field,
            )
            self._store.keep(ended)
            del self._jobs[answer.id]

        self._jobs[answer.id] = job
        self._fits.submit(job, keep)
        return _to(f"/answers/{answer.id}")

    async def _preview(self, upload: Upload) -> dict[str, Any]:
        """What is known of a file; made once."""
        if (data := self._store.read(upload, preview_name())) is None:
            if not await self._previewed(upload):
                return {"busy": True}
            data = self._store.read(upload, preview_name())
        return dict(json.loads(data or b'{"error": ""}'))

    async def _previewed(self, upload: Upload, *numbers: int) -> bool:
        task = ["preview", language(), upload.file, *map(str, numbers)]
        job = Job(self._store.folder(upload), task, seconds=_PREVIEW_SECONDS)
        ended = self._previews.submit(job, lambda: None)
        if ended is None:
            return False
        try:
            await asyncio.wait_for(asyncio.shield(asyncio.wrap_future(ended)), _PATIENCE)
        except TimeoutError:
            return False
        return True

    async def points(self, request: Request) -> Response:
        """The picture of two columns, by their numbers."""
        upload = self._upload(request)
        try:
            x, y = (int(request.query_params.get(key, "-1")) for key in ("x", "y"))
        except ValueError:
            raise HTTPException(404) from None
        seen = await self._preview(upload)
        if not 0 <= max(x, y) < len(seen.get("columns", [])) or min(x, y) < 0:
            raise HTTPException(404)
        name = picture_name(x, y)
        if self._store.read(upload, name) is None:
            await self._previewed(upload, x, y)
        data = self._store.read(upload, name)
        if data is None:
            raise HTTPException(404)
        return Response(data, media_type="image/png", headers={"Cache-Control": "private"})

    # ---- the answer ----

    async def answer(self, request: Request) -> Response:
        answer = self._answer(request)
        if answer.code == 2 and answer.state == "done":
            place = f"/files/{answer.upload}" if answer.upload else "/propagate"
            return _to(f"{place}?{urlencode({'answer': answer.id})}")
        return page(
            "answer",
            answer=answer,
            standing=_standing(answer),
            progress=self._progress(answer),
            files=self._store.report_files(answer) if answer.ended else [],
            upload=self._store.uploads.get(answer.upload),
            command=command_line(answer.arguments),
        )

    async def state(self, request: Request) -> Response:
        return JSONResponse(self._progress(self._answer(request)))

    def _progress(self, answer: Answer) -> dict[str, object]:
        job = self._jobs.get(answer.id)
        if job is None or answer.ended:
            return {"ended": True, "percent": 100, "doing": ""}
        if job.state == "waiting":
            n = self._fits.ahead(job)
            return {"ended": False, "percent": 0, "doing": phrase("waits for {n} others", n=n)}
        doing = job.doing or phrase("reads the points")
        return {"ended": False, "percent": job.percent, "doing": doing}

    async def cancel(self, request: Request) -> Response:
        answer = self._answer(request)
        job = self._jobs.get(answer.id)
        if job is not None:
            self._fits.cancel(job)
            while answer.id in self._jobs:  # until its record is written
                await asyncio.sleep(0.05)
        return _to(f"/answers/{answer.id}")

    async def report_file(self, request: Request) -> Response:
        answer, path = self._answer(request), request.path_params["path"]
        if path not in self._store.report_files(answer):
            raise HTTPException(404)
        data = self._store.read(answer, f"report/{path}")
        ending = PurePosixPath(path).suffix
        headers = {"Content-Security-Policy": _REPORT_POLICY} if ending == ".html" else {}
        if "download" in request.query_params or ending not in (".html", ".png"):
            headers["Content-Disposition"] = _attached(answer, PurePosixPath(path).name)
        kind = _TYPES.get(ending, "application/octet-stream")
        return Response(data or b"", media_type=kind, headers=headers)

    async def everything(self, request: Request) -> Response:
        """The report, what it was made of and the command that repeats it, as a zip."""
        answer = self._answer(request)
        data = await asyncio.to_thread(self._zipped, answer)
        headers = {"Content-Disposition": _attached(answer, "estim.zip")}
        return Response(data, media_type="application/zip", headers=headers)

    def _zipped(self, answer: Answer) -> bytes:
        upload = self._store.uploads.get(answer.upload)
        names = [f"report/{path}" for path in self._store.report_files(answer)]
        names += [] if upload is None else upload.names
        words = phrase("In this folder, with the same version of estim, this repeats the answer:")
        packed = io.BytesIO()
        with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("command.txt", f"{words}\n\n{command_line(answer.arguments)}\n")
            for name in names:
                archive.writestr(name, self._store.read(answer, name) or b"")
        return packed.getvalue()

    # ---- the rest ----

    async def speak(self, request: Request) -> Response:
        name = request.path_params["to"]
        if name not in LANGUAGES:
            raise HTTPException(404)
        back = urlsplit(request.headers.get("referer", ""))
        here = back.netloc == request.headers["host"] and not back.path.startswith("//")
        answer = _to(urlunsplit(("", "", back.path or "/", back.query, "")) if here else "/")
        answer.set_cookie(LANGUAGE, name, samesite="strict", httponly=True, max_age=31_536_000)
        return answer

    async def asset(self, request: Request) -> Response:
        name = request.path_params["name"]
        if (data := static(name)) is None:
            raise HTTPException(404)
        kind = _TYPES[PurePosixPath(name).suffix]
        return Response(data, media_type=kind, headers={"Cache-Control": "no-cache"})

    def _upload(self, request: Request) -> Upload:
        if (upload := self._store.uploads.get(request.path_params["id"])) is None:
            raise HTTPException(404)
        return upload

    def _answer(self, request: Request) -> Answer:
        if (answer := self._store.answers.get(request.path_params["id"])) is None:
            raise HTTPException(404)
        return answer


def _propagation(fields: Mapping[str, str], error: str = "", status: int = 200) -> Response:
    return page("propagate", status, fields=fields, error=error)


def _standing(answer: Answer) -> tuple[str, str]:
    """How an answer stands, for a style and in words."""
    if not answer.ended:
        return "running", phrase("under way")
    if answer.state == "cancelled":
        return "gone", phrase("cancelled")
    if answer.state == "interrupted":
        return "gone", phrase("interrupted: the page was stopped before it was done; ask again")
    if answer.state == "stopped":
        return "gone", phrase("stopped: it took longer, or more memory, than this page allows")
    words = {
        0: ("ok", phrase("done")),
        2: ("gone", phrase("not understood: something in the question must be changed")),
        3: ("doubtful", phrase("not reliable as it stands: the report says why")),
    }
    return words.get(answer.code or 0, ("gone", phrase("failed")))


def _field_of(option: str) -> str:
    """The field of a form that an option stands for; "" where none does."""
    return {word: key for key, word in OPTIONS.items()}.get(option, "")


def _attached(answer: Answer, name: str) -> str:
    stem = PurePosixPath(answer.given).stem or "estim"
    return f"attachment; filename*=UTF-8''{quote(shorten(f'{stem}-{name}', 80), safe='')}"


def _to(place: str) -> Response:
    return RedirectResponse(place, 303)


def _busy() -> Response:
    words = phrase("Too many questions wait at the moment. Try again in a minute.")
    answer = page("closed", 503, words=words)
    answer.headers["Retry-After"] = "30"
    return answer


async def _in_words(_request: Request, error: Exception) -> Response:
    status = error.status_code if isinstance(error, HTTPException) else 500
    words = {
        404: phrase("There is no such page."),
        400: phrase("This could not be understood, or it held too many files."),
    }
    return page("closed", status, words=words.get(status, phrase("This cannot be done here.")))


async def _failed(_request: Request, error: Exception) -> Response:
    """What estim says itself: a disk that is full, say."""
    return page("closed", 500, words=str(error))


async def _broken(_request: Request, _error: Exception) -> Response:
    return page("closed", 500, words=phrase("Something went wrong here. Please report it."))
