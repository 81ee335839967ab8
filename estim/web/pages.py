"""The pages: a file, a question about it, the answer.  Each works without JavaScript.

No name that comes from a browser is a path: ids are looked up among the records, files of a report
among those that are there.
"""

from __future__ import annotations

import asyncio
import io
import json
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import replace
from importlib.resources import files
from importlib.util import find_spec
from itertools import pairwise
from mimetypes import guess_type
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlencode, urlsplit

from starlette.applications import Starlette
from starlette.datastructures import UploadFile
from starlette.exceptions import HTTPException
from starlette.responses import JSONResponse, RedirectResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from estim.common import LANGUAGES, EstimError, InputError, language, phrase
from estim.reading import read_suffixes
from estim.web.job_queue import Job, JobQueue
from estim.web.labels import REFITS
from estim.web.page_template import LANGUAGE, closed, page
from estim.web.preview import picture_name, preview_name, start_name
from estim.web.question import (
    MODELS,
    NAMED,
    Fields,
    arguments_of,
    command_line,
    field_of,
    fields_of,
    lines_of,
    with_columns,
)
from estim.web.rows import answers_of, rows_of, summary_of
from estim.web.store import MOST_BYTES, MOST_FILES, Answer, Batch, Kept, Shelf, Store, Upload

if TYPE_CHECKING:
    from starlette.requests import Request

_SECONDS, _PREVIEW_SECONDS = 600, 60
_PATIENCE = 20.0  # s that a page waits for a preview
_LOOKS = 10  # s between two looks at the table of a batch
_REPORT_POLICY = (
    "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'none'"
)
# a choice -> fields with which it cannot be combined, or has been made
_AGAINST = {"robust": {"robust"}, "correlated": {"robust", "jitter", "u-x"}}
EXAMPLES = {  # name of a table in examples/ -> fields with which its question begins
    "cooling": {"formula": "room + excess*exp(-t/tau)", "kind": "synthetic"},
    "spring": {"asked": "line"},
}


class Pages:
    """What is shown of a store, and requested of workers."""

    def __init__(self, store: Store, fits: JobQueue, previews: JobQueue) -> None:
        self._store, self._fits, self._previews = store, fits, previews
        self._jobs = dict[str, Job]()  # id of an answer -> while it is under way
        self._being_made = dict[tuple[Path, str], Future[None]]()
        self._taking = asyncio.Lock()  # one upload after the other is in memory

    def app(self) -> Starlette:
        post = ["POST"]
        return Starlette(
            routes=[
                Route("/", self.start),
                Route("/files", self.take_in, methods=post),
                Route("/examples/{id}", self.example, methods=post),
                Route("/together", self.together, methods=post),
                Route("/files/{id}", self.question),
                Route("/files/{id}", self.ask, methods=post),
                Route("/files/{id}/points-{x:int}-{y:int}.png", self.points),
                Route("/files/{id}/start-{n:int}.png", self.start_picture),
                Route("/propagate", self.question),
                Route("/propagate", self.ask, methods=post),
                Route("/answers/{id}", self.answer),
                Route("/answers/{id}/state", self.state),
                Route("/answers/{id}/cancel", self.cancel, methods=post),
                Route("/answers/{id}/all.zip", self.everything),
                Route("/answers/{id}/report.pdf", self.on_paper),
                Route("/answers/{id}/report/{path:path}", self.report_file),
                Route("/answers/{id}/batch", self.set_batch, methods=post),
                Route("/batches/{id}", self.batch),
                Route("/batches/{id}/table", self.table),
                Route("/batches/{id}/summary.csv", self.summary),
                Route("/language/{to}", self.speak),
                Mount("/static", StaticFiles(packages=[("estim.web", "static")])),
            ],
            exception_handlers={HTTPException: _in_words, EstimError: _in_words, 500: _in_words},
        )

    # ---- the file ----

    async def start(self, request: Request, status: int = 200, error: str = "") -> Response:
        return page(
            "file",
            status,
            answers=self._store.answers.records,
            uploads=self._store.uploads.records,
            batches=self._store.batches.records,
            endings=read_suffixes(),
            most=MOST_BYTES // 1024**2,
            error=error,
        )

    async def take_in(self, request: Request) -> Response:
        """Keeps what is handed in, for a question that follows, or for that of a batch."""
        async with self._taking, request.form(max_files=MOST_FILES, max_fields=3) as form:
            fields = fields_of(form.multi_items())
            batch = (
                _record_of(self._store.batches, request, fields["batch"])
                if "batch" in fields
                else None
            )
            row = self._row(fields, batch)
            handed = [
                value
                for value in form.getlist("files")
                if isinstance(value, UploadFile) and value.filename
            ]
            contents = {
                (file.filename or "").replace("\\", "/").rpartition("/")[2]: await file.read()
                for file in handed
            }
            try:
                if not contents:
                    raise InputError(phrase("Choose a file first."))
                if batch and "who" not in fields:
                    raise InputError(phrase("Write your name, or that of your group."))
                if len(contents) < len(handed):
                    raise InputError(phrase("Two files have the same name: rename one of them."))
                who = fields["who"] if batch else None
                uploads = await asyncio.to_thread(self._store.take_in, contents, who)
                if batch is not None:
                    return self._answered(batch, uploads, row)
                if len(uploads) > 1:
                    uploads = [await asyncio.to_thread(self._store.together, uploads)]
            except InputError as error:
                if batch is not None:
                    return self._hand_in(batch, row, 422, error.rule)
                return await self.start(request, 422, error.rule)
        return _to(f"/files/{uploads[0].id}")

    async def together(self, request: Request) -> Response:
        """One question about several of the files that are there."""
        async with request.form(max_files=0) as form:
            ids = dict.fromkeys(map(str, form.getlist("ids")))
        known = self._store.uploads.records
        # each of them one table
        parts = [
            upload
            for at in ids
            if (upload := known.get(at)) and not (upload.parts or upload.file.endswith(".toml"))
        ]
        try:
            if not 2 <= len(parts) <= MOST_FILES:
                words = phrase("Tick two files or more, at most {most}.", most=MOST_FILES)
                raise InputError(words)
            upload = await asyncio.to_thread(self._store.together, parts)
        except InputError as error:
            return await self.start(request, 422, error.rule)
        return _to(f"/files/{upload.id}")

    async def example(self, request: Request) -> Response:
        if (name := request.path_params["id"]) not in EXAMPLES:
            raise HTTPException(404)
        data = files("estim.web").joinpath("examples", f"{name}.csv").read_bytes()
        (upload,) = self._store.take_in({f"{name}.csv": data})
        self._store.uploads.keep(replace(upload, asked=EXAMPLES[name]), {})
        return _to(f"/files/{upload.id}")

    # ---- the question: about a file, or about a formula of named values ----

    async def question(self, request: Request) -> Response:
        """The form, empty, or as it was filled in: for an answer that was refused, or in the
        address (a click on a model without JavaScript, or on what shows the start).
        """
        upload = self._upload(request)
        fields = fields_of(request.query_params.multi_items())
        previous = self._store.answers.records.get(fields.pop("answer", ""))
        if (row := self._row(fields, upload)) is not None:
            return await self._form(upload, row.fields, row.error, row.field, row=row)
        if previous is not None:
            return await self._form(upload, previous.fields, previous.error, previous.field)
        if "model" in fields:
            fields["formula"] = fields.pop("model")
        if upload and fields.pop("show", ""):
            return await self._form_with_start(upload, fields)
        return await self._form(upload, fields or (upload.asked if upload else {}))

    async def _form_with_start(self, upload: Upload, fields: Fields) -> Response:
        """The form with the curve at which the search begins."""
        question = json.dumps({"formula": "", **fields}, sort_keys=True)
        name = start_name(language(), question)
        data = await self._preview_file(upload, f"{name}.json", "start", question)
        result: dict[str, Any] = {"busy": data is None}
        if data == b"":
            result["error"] = phrase(
                "The search for starting values was ended after {seconds} s. State one or more of "
                "them below, under More about the curve; or get the report, which may search for "
                "{most} s.",
                seconds=_PREVIEW_SECONDS,
                most=_SECONDS,
            )
        result |= json.loads(data or b"{}")
        return await self._form(
            upload,
            fields,
            result.get("error", ""),
            result.get("field"),
            start=result | {"name": name},
        )

    async def _form(
        self,
        upload: Upload | None,
        fields: Fields,
        error: str = "",
        wrong: str | None = None,
        status: int = 200,
        start: Mapping[str, Any] = {},
        row: Answer | None = None,
    ) -> Response:
        if upload is None:
            return page("propagate", status, fields=fields, error=error)
        preview = await self._preview(upload)
        if not upload.parts:  # of several files each keeps the name that tells it from the others
            error = error.replace(upload.file, upload.given)
            preview |= {"error": preview.get("error", "").replace(upload.file, upload.given)}
        known = self._store.uploads.records
        fields = {"asked": "formula", **fields}
        return page(
            "question",
            status,
            upload=upload,
            parts={n: known[at].given if at in known else n for n, at in upload.parts.items()},
            preview={**preview, "busy": preview.get("busy") or start.get("busy")},
            start=start,
            seconds=_PREVIEW_SECONDS,
            row=row,
            fields=fields,
            models=MODELS,
            error=error,
            wrong=field_of(wrong or "", fields["asked"]),
        )

    async def ask(self, request: Request) -> Response:
        """Begins the command.  Its answer is kept whole when it ends, whether or not the page is
        still open.
        """
        upload = self._upload(request)
        fields = fields_of((await request.form(max_files=0)).multi_items())
        if upload and upload.parts:
            fields["asked"] = "formula"
        row = self._row(fields, upload)
        try:
            if row is not None:
                fields = with_columns(self._store.batches.records[row.batch].fields, fields)
            if upload and upload.parts and "how" not in fields:
                raise InputError(phrase("Choose: all files together, or each by itself."))
            if upload and upload.parts and fields["how"] == "each":
                known, ids = self._store.uploads.records, upload.parts
                parts = [known[ids[name]] for name in _ticked(upload, fields) if ids[name] in known]
                arguments_of(fields, upload.file, "")  # a question that is none begins nothing
                batch = self._store.set_batch(fields, fields.get("title", ""))
                return self._answered(batch, parts, None)
            answer = self._begin(upload, fields, row.batch if row else "", row)
        except InputError as error:
            return await self._form(upload, fields, error.rule, error.field, 422, row=row)
        return _to(f"/answers/{answer.id}")

    def _begin(
        self, upload: Upload | None, fields: Fields, batch: str, row: Answer | None
    ) -> Answer:
        """A new answer, whose command waits for its turn; in a batch it may stand in the place of a
        row.  Raises InputError for the page.
        """
        if self._fits.is_full:
            raise HTTPException(503)
        file, title = (upload.file, upload.given.rpartition(".")[0]) if upload else ("", "")
        file, *others = _ticked(upload, fields) if upload and upload.parts else [file]
        arguments = arguments_of(fields, file, title, others)
        instead = row.id if row else ""
        answer = self._store.begin(upload, fields, arguments, batch=batch, instead=instead)
        folder = self._store.answers.folder / answer.id
        job = self._jobs[answer.id] = Job(folder, ["run", *arguments], seconds=_SECONDS)

        def keep() -> None:
            ended = replace(
                answer,
                state=job.state,
                code=job.code,
                said=tuple(job.lines),
                error=job.error,
                field=job.field,
            )
            try:
                self._store.answers.keep(ended, {})
            finally:
                del self._jobs[answer.id]

        self._fits.submit(job, keep)
        return answer

    async def _preview(self, upload: Upload) -> dict[str, Any]:
        """What is known of a file; "busy" where that takes too long, "failed" where its process
        did.
        """
        data = await self._preview_file(upload, preview_name(language()), "preview")
        return {"busy": True} if data is None else dict(json.loads(data or b'{"failed": true}'))

    async def _made_once(self, shelf: Shelf[Kept], at: str, name: str, *task: str) -> bytes | None:
        """A file of the folder of an id, which a process makes once; None where it is not there
        yet, b"" where it could not be made.
        """
        place = shelf.folder / at
        future = self._being_made.get((place, name))
        if (data := shelf.read(at, name)) is None and (future or not self._previews.is_full):
            if future is None:
                job = Job(place, task, seconds=_PREVIEW_SECONDS)
                future = self._being_made[place, name] = self._previews.submit(job, lambda: None)
            # a later request waits for the same process
            await asyncio.wait([asyncio.wrap_future(future)], timeout=_PATIENCE)
            data = shelf.read(at, name)
            if future.done():
                self._being_made.pop((place, name), None)
                data = data or b""
        return data

    async def _preview_file(self, upload: Upload, name: str, task: str, *more: str) -> bytes | None:
        """A part of what is shown of a file before an answer."""
        words = (task, language(), upload.file, *more)
        return await self._made_once(self._store.uploads, upload.id, name, *words)

    async def points(self, request: Request) -> Response:
        """The picture of two columns, by their numbers."""
        upload = _record_of(self._store.uploads, request)
        numbers = request.path_params["x"], request.path_params["y"]
        data = None
        if max(numbers) < len((await self._preview(upload)).get("columns", [])):
            x, y = map(str, numbers)
            others = list(upload.parts)[1:]
            data = await self._preview_file(upload, picture_name(x, y), "preview", x, y, *others)
        return _picture(data)

    async def start_picture(self, request: Request) -> Response:
        """The picture of a start that was shown, by its number."""
        upload = _record_of(self._store.uploads, request)
        name = f"start-{request.path_params['n']}.png"
        return _picture(self._store.uploads.read(upload.id, name))

    # ---- the answer ----

    async def answer(self, request: Request) -> Response:
        answer = _record_of(self._store.answers, request)
        if answer.standing == "refused" and not answer.batch:
            place = f"/files/{answer.upload}" if answer.upload else "/propagate"
            return _to(f"{place}?answer={answer.id}")
        result = json.loads(self._store.answers.read(answer.id, "report/result.json") or b"{}")
        return page(
            "answer",
            answer=answer,
            progress=self._progress(answer),
            ended=result.get("status", ""),
            refits=_refits(answer, result.get("choices", [])),
            files=self._store.report_files(answer),
            pdf=find_spec("weasyprint") is not None,
            command=command_line(answer.arguments),
        )

    async def state(self, request: Request) -> Response:
        return JSONResponse(self._progress(_record_of(self._store.answers, request)))

    def _progress(self, answer: Answer) -> dict[str, object]:
        job = self._jobs.get(answer.id)
        if job is None:
            return {"ended": True}
        waits = job.state == "waiting"
        doing = phrase("waits for its turn") if waits else job.doing or phrase("reads the points")
        return {"ended": False, "percent": job.percent, "doing": doing}

    async def cancel(self, request: Request) -> Response:
        answer = _record_of(self._store.answers, request)
        if job := self._jobs.get(answer.id):
            self._fits.cancel(job)
        while answer.id in self._jobs:  # until its record is written
            await asyncio.sleep(0.05)
        return _to(f"/answers/{answer.id}")

    async def report_file(self, request: Request) -> Response:
        answer, path = _record_of(self._store.answers, request), request.path_params["path"]
        if path not in self._store.report_files(answer):
            raise HTTPException(404)
        data = self._store.answers.read(answer.id, f"report/{path}")
        headers = {"Content-Security-Policy": _REPORT_POLICY} if path.endswith(".html") else {}
        if "download" in request.query_params or not path.endswith((".html", ".png")):
            headers["Content-Disposition"] = "attachment"
        kind = guess_type(path)[0] or "application/octet-stream"
        return Response(data, media_type=kind, headers=headers)

    async def on_paper(self, request: Request) -> Response:
        """The report as PDF, made when it is first requested."""
        answer = _record_of(self._store.answers, request)
        if answer.id in self._jobs:  # its report is not whole yet
            raise HTTPException(404)
        lang = dict(pairwise(answer.arguments)).get("--lang", "en")
        data = await self._made_once(self._store.answers, answer.id, "report.pdf", "paper", lang)
        if not data:
            words = phrase("The PDF could not be made: print the report.")
            return closed(503, words)
        return _download(data, "application/pdf")

    async def everything(self, request: Request) -> Response:
        """The report, what it was made of and the command that repeats it, as a zip."""
        answer = _record_of(self._store.answers, request)
        upload = self._store.uploads.records.get(answer.upload)
        names = [f"report/{path}" for path in self._store.report_files(answer)]
        words = phrase("In this folder, with the same version of estim, this repeats the answer:")
        packed = io.BytesIO()
        with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("command.txt", f"{words}\n\n{command_line(answer.arguments)}\n")
            for name in (*names, *(upload.names if upload else ())):
                archive.writestr(name, self._store.answers.read(answer.id, name) or b"")
        return _download(packed.getvalue(), "application/zip")

    # ---- the batch: one question, many files ----

    async def set_batch(self, request: Request) -> Response:
        """The question of an answer, for other files."""
        answer = _record_of(self._store.answers, request)
        if not answer.is_curve:
            raise HTTPException(404)
        fields = fields_of((await request.form(max_files=0)).multi_items())
        return _to(f"/batches/{self._store.set_batch(answer.fields, fields.get('title', '')).id}")

    async def batch(self, request: Request) -> Response:
        batch = _record_of(self._store.batches, request)
        fields = fields_of(request.query_params.multi_items())
        return self._hand_in(batch, self._row(fields, batch))

    def _hand_in(
        self, batch: Batch, row: Answer | None, status: int = 200, error: str = ""
    ) -> Response:
        return page("batch", status, batch=batch, row=row, endings=read_suffixes(), error=error)

    def _answered(self, batch: Batch, uploads: Sequence[Upload], row: Answer | None) -> Response:
        """Begins the answer of each file, in the place of a row where one is given, and shows the
        only one or the table.
        """
        answers = [self._begin(upload, batch.fields, batch.id, row) for upload in uploads]
        single = len(answers) == 1
        return _to(f"/answers/{answers[0].id}" if single else f"/batches/{batch.id}/table")

    async def table(self, request: Request) -> Response:
        batch = _record_of(self._store.batches, request)
        answers = answers_of(self._store, batch.id)
        rows, spreads = await asyncio.to_thread(rows_of, self._store, answers)
        still = "still" in request.query_params
        answer = page(
            "table",
            batch=batch,
            shown=list(zip(answers, rows, strict=True)),
            before=self._store.answers.records,
            spreads=spreads,
            still=still,
            looks=_LOOKS,
        )
        if not still:
            answer.headers["Refresh"] = str(_LOOKS)
        return answer

    async def summary(self, request: Request) -> Response:
        answers = answers_of(self._store, _record_of(self._store.batches, request).id)
        data = await asyncio.to_thread(summary_of, self._store, answers)
        return _download(data, "text/csv")

    # ---- the rest ----

    async def speak(self, request: Request) -> Response:
        """Back to the page on which the language was chosen."""
        if (name := request.path_params["to"]) not in LANGUAGES:
            raise HTTPException(404)
        answer = _to("/" + urlsplit(request.headers.get("referer", "")).path.lstrip("/\\"))
        answer.set_cookie(LANGUAGE, name, samesite="strict", httponly=True, max_age=31_536_000)
        return answer

    def _row(self, fields: Fields, of: Batch | Upload | None) -> Answer | None:
        """The row that is to be replaced, if the fields name one, in the batch `of`, or of that
        file.
        """
        row = self._store.answers.records.get(fields.get("row", ""))
        if row is None or of is None or row.batch not in self._store.batches.records:
            return None
        return row if of.id in (row.batch, row.upload) else None

    def _upload(self, request: Request) -> Upload | None:
        """The file that a question is about; None on the page that has none."""
        return _record_of(self._store.uploads, request) if "id" in request.path_params else None


def _record_of(shelf: Shelf[Kept], request: Request, at: str = "") -> Kept:
    """The record of the id `at`, else of that in the address."""
    if (record := shelf.records.get(at or request.path_params["id"])) is None:
        raise HTTPException(404)
    return record


def _refits(answer: Answer, choices: Iterable[Fields]) -> list[tuple[str, str]]:
    """Addresses of the question with one field changed, as a result advises, and their names;
    without those that the question would refuse.
    """
    links = []
    for choice in choices if answer.is_curve and answer.upload else ():
        fields, name, value = dict(answer.fields), choice["option"], choice["value"]
        parameter, of_one, _ = value.partition("=")
        if fields.keys() & _AGAINST.get(name, set()) or (
            name in ("robust", "correlated") and "%" in fields.get("u-y", "")
        ):
            continue
        if of_one:  # what is known of a parameter stands in the place of its start and limits
            for field in NAMED.split():
                lines = (line.partition("=") for line in lines_of(fields.get(field, "")))
                remaining = (f"{n} {mark} {text}" for n, mark, text in lines if n != parameter)
                fields[field] = "\n".join(remaining)
            value = f"{fields[name]}\n{parameter} = "
        place = f"/files/{answer.upload}?{urlencode(fields | ({name: value} if value else {}))}"
        links.append((f"{place}#{name}", REFITS[name].format(name=parameter)))
    return links


def _picture(data: bytes | None) -> Response:
    if not data:
        raise HTTPException(404)
    return Response(data, media_type="image/png", headers={"Cache-Control": "private"})


def _download(data: bytes, kind: str) -> Response:
    return Response(data, media_type=kind, headers={"Content-Disposition": "attachment"})


def _ticked(upload: Upload, fields: Fields) -> list[str]:
    """The tables of an upload that a question is about.  Raises InputError."""
    ticked = fields.get("files", "").splitlines()
    if not (names := [name for name in upload.parts if name in ticked]):
        raise InputError(phrase("Choose a file first."))
    return names


def _to(place: str) -> Response:
    return RedirectResponse(place, 303)


async def _in_words(_request: Request, error: Exception) -> Response:
    """A sentence in place of a page; a message of estim itself, of a full disk say, as it is."""
    status = error.status_code if isinstance(error, HTTPException) else 500
    return closed(status, str(error) if isinstance(error, EstimError) else "")
