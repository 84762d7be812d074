"""Edits of an MJCF file that change the values of named attributes and leave every other byte as it is."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from xml.parsers import expat
from xml.sax.saxutils import quoteattr

from gauss_bench.exchange.errors import ExchangeError

TAG = re.compile(rb"""<(?:"[^"]*"|'[^']*'|[^"'>])*+>""")  # within quotes a ">" ends nothing
SETS = re.compile(rb"""\s([\w.:-]+)\s*=\s*("[^"]*"|'[^']*')""")  # an attribute and its value within a start tag


@dataclass(frozen=True)
class Tag:
    """A start tag in the bytes of a file.

    Attributes:
        path: names of the elements from the root to this one, joined by "/".
        begin, end: the bytes content[begin:end] are the tag, from "<" to ">".
    """

    path: str
    begin: int
    end: int


def list_tags(content: bytes, file: str) -> list[Tag]:
    """Return the start tags of a document in the order of the file.

    Raises:
        ExchangeError: the document is not written in UTF-8, or is no XML.
    """
    tags: list[Tag] = []
    open_elements: list[str] = []
    parser = expat.ParserCreate("UTF-8")

    def begin(name: str, _: dict[str, str]) -> None:
        open_elements.append(name)
        tag = TAG.match(content, parser.CurrentByteIndex)
        assert tag is not None  # the parser has just read it
        tags.append(Tag("/".join(open_elements), *tag.span()))

    parser.StartElementHandler = begin
    parser.EndElementHandler = lambda _: open_elements.pop()
    try:
        content.decode("utf-8")
        parser.Parse(content, True)
    except (UnicodeDecodeError, expat.ExpatError) as error:
        raise ExchangeError(f"{file}: only files in UTF-8 are edited: {error}") from error
    return tags


def set_attributes(content: bytes, tag: Tag, values: Mapping[str, str]) -> bytes:
    """Return the text of a start tag with these values: of attributes that it has in their place, of others at its end."""
    text = content[tag.begin : tag.end]
    for name, value in values.items():
        written = quoteattr(value).encode()
        found = next((x for x in SETS.finditer(text) if x[1] == name.encode()), None)
        if found:
            text = text[: found.start(2)] + written + text[found.end(2) :]
            continue
        closing = b"/>" if text.endswith(b"/>") else b">"
        body = text[: -len(closing)]
        rest = body.rstrip()
        text = rest + b" " + name.encode() + b"=" + written + body[len(rest) :] + closing
    return text


def replace_tags(content: bytes, texts: Iterable[tuple[Tag, bytes]]) -> bytes:
    """Return the document with other texts in the places of these tags."""
    for tag, text in sorted(texts, key=lambda pair: -pair[0].begin):  # from the last, so that places before it stay true
        content = content[: tag.begin] + text + content[tag.end :]
    return content


def write_settings(
    content: bytes, file: str, option: Mapping[str, str], closures: Mapping[str, str], by_default: bool = False
) -> bytes:
    """Return a document with these attributes of its <option> and of every <connect> and <weld>.

    Where the document has no <option>, one is inserted after the root's start tag.

    Args:
        by_default: whether a default is changed too, or inserted, for closures that stand in included files.
    """
    tags = list_tags(content, file)
    root, texts = tags[0], list[tuple[Tag, bytes]]()
    options = [tag for tag in tags if tag.path == f"{root.path}/option"]
    inserted = b""
    if option and options:
        texts.append((options[-1], set_attributes(content, options[-1], option)))
    elif option:
        inserted += b"\n  <option" + attributes(option) + b"/>"
    ends = tuple(f"{root.path}/equality/{kind}" for kind in ("connect", "weld"))
    own = [tag for tag in tags if tag.path in ends]
    if closures:
        texts += [(tag, set_attributes(content, tag, closures)) for tag in own]
        if by_default:
            edit, more = default_closures(content, tags, closures)
            texts += edit
            inserted += more
    if inserted:
        texts.append((root, content[root.begin : root.end] + inserted))
    return replace_tags(content, texts)


def default_closures(content: bytes, tags: list[Tag], closures: Mapping[str, str]) -> tuple[list[tuple[Tag, bytes]], bytes]:
    """Return edits of the document's defaults that give closures these attributes, and the text to insert at its beginning."""
    root = tags[0].path
    written = b"<equality" + attributes(closures) + b"/>"
    for tag in tags:
        if tag.path == f"{root}/default/equality":
            return [(tag, set_attributes(content, tag, closures))], b""
    for tag in tags:
        if tag.path == f"{root}/default" and not content[tag.begin : tag.end].endswith(b"/>"):
            return [(tag, content[tag.begin : tag.end] + written)], b""
    return [], b"\n  <default>" + written + b"</default>"


def attributes(values: Mapping[str, str]) -> bytes:
    return "".join(f" {name}={quoteattr(value)}" for name, value in values.items()).encode()
