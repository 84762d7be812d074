"""Read XML that may be hostile: limited in size, without document types or entities, and unable to open files or run code."""

from functools import partial
from math import prod
from pathlib import Path
from xml.etree.ElementTree import Element, ParseError, fromstring
from xml.parsers import expat

from gauss_bench.exchange.errors import ExchangeError
from gauss_bench.untrusted import read_bytes

MAX_BYTES, ELEMENTS, DEEPEST = 4_194_304, 50_000, 100
NUMBERS = 1 << 24  # that MuJoCo may allocate for short attributes: those of a picture of 4096 by 4096
COUNTS = (  # attributes of one element whose product is a number of numbers
    "nrow ncol",
    "width height",
    "params params",
    "actdim",
    "dim",
    "nsample",
    "num",
    "resolution resolution",
)
ARENA = {"njmax": (6.5, 2), "nconmax": (80.0, 1), "nstack": (1.0, 1)}  # attribute of <size> -> factor and power: numbers allocated
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
    """Parse a file without building a tree, so that a hostile file costs no memory.

    Raises:
        ExchangeError: the file contains something that is refused; the message names it and its line.
    """
    parser = expat.ParserCreate()
    elements = depth = 0

    def refuse(what: str, *_: object) -> None:
        raise ExchangeError(f"{path}: line {parser.CurrentLineNumber}: {what} is not read")

    def begin(name: str, _: object) -> None:
        nonlocal elements, depth
        elements += 1
        depth += 1
        if elements > ELEMENTS:
            refuse(f"more than {ELEMENTS} elements")
        if depth > DEEPEST:
            refuse(f"<{name}>, elements more than {DEEPEST} deep,")

    def end(_: str) -> None:
        nonlocal depth
        depth -= 1

    parser.StartDoctypeDeclHandler = partial(refuse, "a document type")
    parser.EntityDeclHandler = partial(refuse, "an entity")
    parser.ProcessingInstructionHandler = partial(refuse, "a processing instruction")
    parser.StartElementHandler = begin
    parser.EndElementHandler = end
    parser.Parse(content, True)


def describe(node: Element) -> str:
    """Return an element as a message names it: its tag, and its name if it has one."""
    name = node.get("name")
    return f"<{node.tag}>" if name is None else f'<{node.tag} name="{name}">'


def refuse_files(root: Element, path: Path) -> None:
    """Refuse a model that needs other files or plug-ins.

    Raises:
        ExchangeError: an element reads another file or loads a plug-in.
    """
    for node in root.iter():
        tag = str(node.tag)
        if tag in OPENS or ":" in tag or "{" in tag:
            raise ExchangeError(f"{path}: {describe(node)}: includes, plug-ins, flexible and composed bodies are not read")
        for key, x in node.items():
            if key.startswith("file") or key == "content_type":
                raise ExchangeError(f"{path}: {describe(node)}: {key}={x!r}: other files are not read")


def refuse_bulk(root: Element, path: Path) -> None:
    """Refuse a short file that makes a huge model.

    Raises:
        ExchangeError: the model has more than ELEMENTS elements, all copies of <replicate> counted, or more than NUMBERS numbers
            that the file does not contain; the message names the element that asks for them.
    """
    elements = _count_elements(root, path)
    for node in root.iter("size"):
        for key in ("memory", *ARENA):
            arena = _arena(node, key)
            if arena > NUMBERS:
                asked = f"{key}={node.get(key)!r} asks for {arena:.3g} numbers of memory"
                raise ExchangeError(f"{path}: <size>: {asked}, more than {NUMBERS}")
    numbers = 0.0
    for node in root.iter():
        per_element = [[key] for key in node.attrib if node.tag == "size" and key.startswith(("nuser", "nkey"))]
        for keys in (*map(str.split, COUNTS), *per_element):
            if any(key in node.attrib for key in keys):
                numbers += prod(_largest(node, key) for key in keys) * (elements if keys in per_element else 1.0)
            if numbers > NUMBERS:
                asked = " ".join(f'{key}="{node.get(key)}"' for key in dict.fromkeys(keys))
                raise ExchangeError(f"{path}: {describe(node)}: {asked} makes more than {NUMBERS} numbers")


def _count_elements(root: Element, path: Path) -> float:
    """Return the number of elements with all copies of <replicate>; more than ELEMENTS are refused."""
    elements, waiting = 0.0, [(root, 1.0)]  # (element, its copies), as floats: a file may ask for any count
    while waiting:
        node, copies = waiting.pop()
        elements += copies
        copies_inside = copies * (_largest(node, "count") if node.tag == "replicate" else 1.0)
        if max(elements, copies_inside) > ELEMENTS:  # at the <replicate>, before its first child
            raise ExchangeError(f"{path}: {describe(node)}: more than {ELEMENTS} elements, copies counted, are not read")
        waiting += ((child, copies_inside) for child in reversed(node))  # taken from the end: in the order of the file
    return elements


def _arena(node: Element, key: str) -> float:
    """Return the number of numbers that MuJoCo allocates for an attribute of <size>."""
    text = node.get(key, "").strip().upper()
    if key == "memory":
        power = UNITS.find(text[-1:]) + 1 if text else 0
        node = Element("size", memory=text[:-1] if power else text)
        return _largest(node, key) * 1024.0**power / 8
    each, power = ARENA[key]
    return float(each * _largest(node, key) ** power)


def _largest(node: Element, key: str) -> float:
    """Return the largest number of an attribute, at least 1; for an attribute that is no number 1, because MuJoCo reports it."""
    try:
        return max((x for x in map(float, node.get(key, "").split()) if x > 1), default=1.0)
    except ValueError:
        return 1.0
