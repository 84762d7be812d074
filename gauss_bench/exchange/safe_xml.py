"""Read XML that may be hostile: limited in size, without document types or entities, and unable to open files or run code."""

from collections.abc import Callable
from math import prod
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, ParseError, fromstring
from xml.parsers import expat

from gauss_bench.exchange.errors import ExchangeError
from gauss_bench.untrusted import read_bytes

MAX_BYTES, ELEMENTS, DEEPEST = 4_194_304, 50_000, 100
MADE = 1 << 24  # numbers that a short attribute may make MuJoCo allocate: those of a picture of 4096 by 4096
COUNTS = ("nrow ncol", "width height", "params params", "actdim", "dim", "nsample", "num", "resolution resolution")  # multiplied
ARENA = {"njmax": (6.5, 2), "nconmax": (80.0, 1), "nstack": (1.0, 1)}  # attribute of <size> -> (factor, power): numbers allocated
UNITS = "KMGTPE"  # suffixes of <size memory> in bytes, each 1024 times the one before
OPENS = frozenset(("include", "extension", "plugin", "attach", "model", "composite", "flexcomp", "flex", "skin", "deformable"))


def read_xml(path: Path) -> Element:
    """Return the root element of a file.

    Raises:
        ExchangeError: the file cannot be read, is not XML, is too large, or declares a document type or entities.
    """
    try:
        content = read_bytes(path, MAX_BYTES)
    except OSError as error:
        raise ExchangeError(f"{path}: cannot be read: {error.strerror}") from error
    try:
        _inspect(content, path)
        return fromstring(content)
    except (expat.ExpatError, ParseError, LookupError, ValueError) as error:
        if isinstance(error, ExchangeError):
            raise
        raise ExchangeError(f"{path}: no XML that can be read: {error}") from error


def _inspect(content: bytes, path: Path) -> None:
    """Go through a file without building a tree, so that a hostile file costs no memory.

    Raises:
        ExchangeError: the file holds something that is refused; the message names it and its line.
    """
    parser = expat.ParserCreate()
    counts = {"elements": 0, "depth": 0}

    def refuse(what: str) -> Callable[..., Any]:
        def handler(*_: object) -> None:
            raise ExchangeError(f"{path}: line {parser.CurrentLineNumber}: {what} is not read")

        return handler

    def begin(name: str, _: object) -> None:
        counts["elements"] += 1
        counts["depth"] += 1
        if counts["elements"] > ELEMENTS:
            refuse(f"more than {ELEMENTS} elements")()
        if counts["depth"] > DEEPEST:
            refuse(f"<{name}>, elements more than {DEEPEST} deep,")()

    parser.StartDoctypeDeclHandler = refuse("a document type")
    parser.EntityDeclHandler = refuse("an entity")
    parser.ProcessingInstructionHandler = refuse("a processing instruction")
    parser.StartElementHandler = begin
    parser.EndElementHandler = lambda _: counts.update(depth=counts["depth"] - 1)
    parser.Parse(content, True)


def call_name(node: Element) -> str:
    """Return an element as a message names it."""
    name = node.get("name")
    return f"<{node.tag}>" if name is None else f'<{node.tag} name="{name}">'


def refuse_files(root: Element, path: Path) -> None:
    """Refuse a model that needs more than one file.

    Raises:
        ExchangeError: an element reads another file or loads a plug-in.
    """
    for node in root.iter():
        tag = str(node.tag)
        if tag in OPENS or ":" in tag or "{" in tag:
            raise ExchangeError(f"{path}: {call_name(node)}: includes, plug-ins, flexible and composed bodies are not read")
        for key, x in node.items():
            if key.startswith("file") or key == "content_type":
                raise ExchangeError(f"{path}: {call_name(node)}: {key}={x!r}: other files are not read")


def refuse_bulk(root: Element, path: Path) -> None:
    """Refuse a short file that makes a huge model: more than ELEMENTS elements with all copies of <replicate>, or MADE numbers.

    Raises:
        ExchangeError: the model is too large; the message names the element that asks for it.
    """
    elements, made, left = 0.0, 0.0, [(root, 1.0)]
    while left:
        node, times = left.pop()
        elements += times
        times *= _largest(node, "count") if node.tag == "replicate" else 1.0
        if max(elements, times) > ELEMENTS:
            raise ExchangeError(f"{path}: {call_name(node)}: more than {ELEMENTS} elements, copies counted, are not read")
        left += ((child, times) for child in reversed(node))
    for node in root.iter("size"):
        for key in ("memory", *ARENA):
            if (arena := _arena(node, key)) > MADE:
                raise ExchangeError(
                    f"{path}: <size>: {key}={node.get(key)!r} asks for {arena:.3g} numbers of memory, and {MADE} are given"
                )
    for node in root.iter():
        each = [[key] for key in node.attrib if node.tag == "size" and key.startswith(("nuser", "nkey"))]  # for every element
        for keys in (*map(str.split, COUNTS), *each):
            if any(key in node.attrib for key in keys):
                made += prod(_largest(node, key) for key in keys) * (elements if keys in each else 1.0)
            if made > MADE:
                asked = " ".join(f'{key}="{node.get(key)}"' for key in dict.fromkeys(keys))
                raise ExchangeError(
                    f"{path}: {call_name(node)}: {asked} makes more than {MADE} numbers that the file does not hold"
                )


def _arena(node: Element, key: str) -> float:
    """Return how many numbers MuJoCo allocates for an attribute of <size>."""
    text = node.get(key, "").strip().upper()
    if key == "memory":
        power = UNITS.find(text[-1:]) + 1 if text else 0
        node = Element("size", memory=text[:-1] if power else text)
        return _largest(node, key) * 1024.0**power / 8
    each, power = ARENA[key]
    return float(each * _largest(node, key) ** power)


def _largest(node: Element, key: str) -> float:
    """Return the largest number of an attribute, at least 1; MuJoCo itself reports an attribute that is no number."""
    try:
        return max((x for x in map(float, node.get(key, "").split()) if x > 1), default=1.0)
    except ValueError:
        return 1.0
