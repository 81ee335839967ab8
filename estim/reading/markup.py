"""XML that other programs write, element by element; nothing is trusted.

Document types are refused, and with them every entity that could expand or reach out.
"""

from __future__ import annotations

from collections.abc import Callable
from xml.parsers import expat

from estim.common import InputError

Attributes = dict[str, str]


def parse_xml(
    text: str | bytes,
    on_end: Callable[[str, Attributes, str], None],
    on_start: Callable[[str, Attributes, int], None] | None = None,
) -> None:
    """Calls `on_start(tag, attributes, line)` and `on_end(tag, attributes, text)` for each element,
    tags without their prefix.  Raises InputError where the XML is not whole, or is not what they
    look for.
    """
    parser = expat.ParserCreate()
    parser.buffer_text = True
    stack: list[tuple[str, Attributes, list[str]]] = []

    def start(tag: str, attributes: Attributes) -> None:
        stack.append((tag.rpartition(":")[2], attributes, []))
        if on_start is not None:
            on_start(stack[-1][0], attributes, parser.CurrentLineNumber)

    def end(_: str) -> None:
        tag, attributes, texts = stack.pop()
        on_end(tag, attributes, "".join(texts))

    def characters(text: str) -> None:
        stack[-1][2].append(text)

    def doctype(*_: object) -> None:
        rule = "must not hold a document type or entities"
        raise InputError(rule, field="XML", line=parser.CurrentLineNumber)

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler, parser.StartDoctypeDeclHandler = characters, doctype
    try:
        parser.Parse(text, True)
    except InputError:
        raise
    except expat.ExpatError as error:
        rule = f"is not a whole XML text ({expat.ErrorString(error.code)})"
        raise InputError(rule, field="XML", line=error.lineno) from None
    except (LookupError, StopIteration, ValueError) as error:
        raise InputError("cannot be read", field="XML", quoted=str(error)) from None
