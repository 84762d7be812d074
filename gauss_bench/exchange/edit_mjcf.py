"""Set named attributes of an MJCF file, and leave every other byte as it is."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from xml.parsers import expat
from xml.sax.saxutils import quoteattr

from gauss_bench.exchange.errors import ExchangeError

TAG = re.compile(rb"""<(?:"[^"]*"|'[^']*'|[^"'>])*+>""")  # a ">" within quotes does not end the tag
ATTRIBUTE = re.compile(rb"""\s([\w.:-]+)\s*=\s*("[^"]*"|'[^']*')""")  # in a start tag: (1) name of an attribute, (2) its value


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
    """Return the start tags of a document in the order of the file; ExchangeError if it is not XML in UTF-8."""
    tags: list[Tag] = []
    open_elements: list[str] = []
    parser = expat.ParserCreate("UTF-8")

    def begin(name: str, _: dict[str, str]) -> None:
        """Record the start tag at which the parser stands, with the path of its element."""
        open_elements.append(name)
        tag = TAG.match(content, parser.CurrentByteIndex)
        assert tag is not None  # the parser stands at the beginning of a start tag
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
    """Return the text of a start tag with attributes set to values; attributes that the tag lacks are added at its end."""
    text = content[tag.begin : tag.end]
    for name, value in values.items():
        places = [x.span(2) for x in ATTRIBUTE.finditer(text) if x[1] == name.encode()]
        if places:
            begin, end = places[0]
            text = text[:begin] + quoteattr(value).encode() + text[end:]
        else:
            end = len(text.removesuffix(b">").removesuffix(b"/").rstrip())  # before "/>" or ">" and white space
            text = text[:end] + write_attributes({name: value}) + text[end:]
    return text


def write_settings(
    content: bytes, file: str, option: Mapping[str, str], closures: Mapping[str, str], by_default: bool = False
) -> bytes:
    """Return an MJCF document in which some attributes of <option> and of every <connect> and <weld> are set.

    Args:
        file: path of the document, for messages.
        option: name -> value of the attributes to set in <option>, which is inserted if it is missing.
        closures: name -> value of the attributes to set in every <connect> and <weld>.
        by_default: whether `closures` are also set in <default><equality>, so that they apply to the closures of included files.

    Raises:
        ExchangeError: the document is not encoded in UTF-8, or is not XML.
    """
    tags = list_tags(content, file)
    root = tags[0]
    texts: dict[Tag, bytes] = {}  # start tag -> its new text, with the elements inserted after it
    inserted = b""  # after the root's start tag
    options = [tag for tag in tags if tag.path == f"{root.path}/option"]
    if option and options:
        texts[options[-1]] = set_attributes(content, options[-1], option)
    elif option:
        inserted += b"\n  <option" + write_attributes(option) + b"/>"
    for tag in tags:
        if closures and tag.path in (f"{root.path}/equality/connect", f"{root.path}/equality/weld"):
            texts[tag] = set_attributes(content, tag, closures)
    if closures and by_default:
        default = b"<equality" + write_attributes(closures) + b"/>"
        equality = [tag for tag in tags if tag.path == f"{root.path}/default/equality"]
        # a document may have several <default>; a <default/> without content is passed over, because it cannot hold an element
        defaults = [x for x in tags if x.path == f"{root.path}/default" and not content[x.begin : x.end].endswith(b"/>")]
        if equality:
            texts[equality[0]] = set_attributes(content, equality[0], closures)
        elif defaults:
            texts[defaults[0]] = content[defaults[0].begin : defaults[0].end] + default
        else:
            inserted += b"\n  <default>" + default + b"</default>"
    if inserted:
        texts[root] = content[root.begin : root.end] + inserted
    for tag in sorted(texts, key=lambda x: x.begin, reverse=True):  # from the last, so that positions of earlier tags stay valid
        content = content[: tag.begin] + texts[tag] + content[tag.end :]
    return content


def write_attributes(values: Mapping[str, str]) -> bytes:
    """Return attributes as they stand in a start tag, each after a space."""
    return "".join(f" {name}={quoteattr(value)}" for name, value in values.items()).encode()
