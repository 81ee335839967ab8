"""One class a kind of mistake.

Raise ``InputError`` for anything a person wrote (a file, an argument): it names the place, the
field, the rule and the value, and the command line turns it into one line and exit code 2.  A
numerical failure is not an exception: it is a sentence in the record of the stage that met it
(``Fit.message``, ``Diagnosis.reasons``).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import Concatenate, ParamSpec, TypeVar

from estim.common.escaping import one_line

P = ParamSpec("P")
T = TypeVar("T")
_MOST_LISTED = 20


class EstimError(Exception):
    """Base of every error that estim raises on purpose; its text is one line for a person.

    >>> from estim import EstimError, InputError
    >>> issubclass(InputError, EstimError)
    True
    """

    def __init__(self, text: str) -> None:
        super().__init__(one_line(text))


class InputError(EstimError, ValueError):
    """A value breaks a rule.  Reads ``FILE:LINE: 'field' rule (quoted): value``; each part that is
    unknown is left out.

    What a file holds stands in `value`, in `quoted` (what is listed whole) or in `field` (a name),
    never in `rule`.
    index : of the value in an array `field`, for a reader that knows on which line it stands; else
        it reads ``(value number 3)``.

    >>> from estim import InputError, fit_curve
    >>> try:
    ...     fit_curve("a*x", [1, 2, 3], [1, 2, 3], u_y=-1.0)
    ... except InputError as error:
    ...     print(error)
    'u_y' must be > 0: -1.0
    """

    def __init__(
        self,
        rule: str,
        *,
        field: str | None = None,
        value: object = None,
        file: str | Path | None = None,
        line: int | None = None,
        quoted: str = "",
        index: int | None = None,
    ) -> None:
        self.rule, self.field, self.value, self.quoted, self.index = (
            rule,
            field,
            value,
            quoted,
            index,
        )
        self.file, self.line = None if file is None else str(file), line
        place = "" if file is None else f"{file}: " if line is None else f"{file}:{line}: "
        subject = "" if field is None else f"'{field}' "
        value_text = "" if value is None else f": {shorten(value)}"
        detail = (
            f" ({quoted})" if quoted else "" if index is None else f" (value number {index + 1})"
        )
        super().__init__(f"{place}{subject}{rule}{detail}{value_text}")

    def at(self, file: str | Path, line: int | None = None) -> InputError:
        """The same mistake with its place, for a reader that learns the place later than the
        rule.
        """
        return InputError(
            self.rule,
            field=self.field,
            value=self.value,
            file=file,
            line=self.line if line is None else line,
            quoted=self.quoted,
        )

    def without_quotes(self, fields: Collection[str]) -> InputError:
        """The same mistake without the contents of the file: no value, and the field only if it is
        one of `fields`.
        """
        rule = f"{self.rule} (a file outside the campaign's folder is not quoted)"
        return InputError(
            rule, field=self.field if self.field in fields else None, file=self.file, line=self.line
        )


def require_one_of(value: object, choices: Iterable[object], *, field: str) -> None:
    """Raises InputError where a value is none of the choices."""
    known = [*choices]
    if value not in known:
        raise InputError(f"must be one of {', '.join(map(str, known))}", field=field, value=value)


@contextmanager
def in_file(file: str | Path) -> Iterator[None]:
    """While a file is read: a mistake without a place is in `file`."""
    try:
        yield
    except InputError as error:
        raise error if error.file is not None else error.at(file) from None


def in_its_file(reader: Callable[Concatenate[Path, P], T]) -> Callable[Concatenate[Path, P], T]:
    """A reader of the file that is its first argument, which need not name it in its errors."""

    @wraps(reader)
    def read(path: Path, /, *args: P.args, **kwargs: P.kwargs) -> T:
        with in_file(path):
            return reader(path, *args, **kwargs)

    return read


class NumericalError(EstimError):
    """A computation cannot go on at all, though the input breaks no rule; a computation that can go
    on states the problem in its record instead.

    rule : what stops it; at : where, "" where the place does not matter.
    """

    def __init__(self, rule: str, *, at: str = "") -> None:
        self.rule, self.at = rule, at
        super().__init__(f"{rule} at {at}" if at else rule)


class Interrupted(BaseException):
    """A person or the system asked to stop (not an error: nothing that handles errors may take it
    for one).  Its argument: how to go on.
    """


def shorten(value: object, limit: int = 60) -> str:
    """``value`` as text of at most ``limit`` characters."""
    text = value if isinstance(value, str) else repr(value)
    return text if len(text) <= limit else text[: limit - 3] + "..."


def listed(names: Sequence[str]) -> str:
    """Names one by one, each of them short; of a long list the first 20 and how many more there
    are.
    """
    more = f" and {len(names) - _MOST_LISTED} more" if len(names) > _MOST_LISTED else ""
    return ", ".join(map(shorten, names[:_MOST_LISTED])) + more
