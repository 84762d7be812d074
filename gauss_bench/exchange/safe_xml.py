"""Read XML that may be hostile: limit its size, and refuse document types, entities, other files and plug-ins."""

from collections.abc import Iterator
from functools import partial
from math import prod
from pathlib import Path
from xml.etree.ElementTree import Element, ParseError, fromstring
from xml.parsers import expat

from gauss_bench.exchange.errors import ExchangeError
from gauss_bench.untrusted import read_bytes

MAX_BYTES, ELEMENTS, DEEPEST = 4_194_304, 50_000, 100  # limits: bytes of a file, elements, depth of nesting
NUMBERS = 1 << 24  # limit of the numbers that MuJoCo allocates for a model: the pixels of a picture of 4096 by 4096
COUNTS = (  # attributes of one element; MuJoCo allocates as many numbers as the product of their values
    "nrow ncol",
    "width height",
    "params params",
    "actdim",
    "dim",
    "nsample",
    "num",
    "resolution resolution",
)
# attribute of <size> -> (factor, power): MuJoCo allocates factor * value**power numbers
ARENA = {"njmax": (6.5, 2), "nconmax": (80.0, 1), "nstack": (1.0, 1)}
UNITS = "KMGTPE"  # suffixes of <size memory>: 1024, 1024^2, ... bytes
# elements that open other files, run code, or make bodies that a linkage does not have
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
    except ExchangeError:  # a ValueError too
        raise
    except (expat.ExpatError, ParseError, LookupError, ValueError) as error:
        raise ExchangeError(f"{path}: no XML that can be read: {error}") from error


def _inspect(content: bytes, path: Path) -> None:
    """Raise ExchangeError, with the line number, for refused content. No tree is built, so a hostile file needs little memory."""
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
    """Return the tag of an element, with its name if it has a name, for messages."""
    name = node.get("name")
    return f"<{node.tag}>" if name is None else f'<{node.tag} name="{name}">'


def refuse_files(root: Element, path: Path) -> None:
    """Raise ExchangeError if an element of a model reads another file or loads a plug-in."""
    for node in root.iter():
        tag = str(node.tag)
        if tag in OPENS or ":" in tag or "{" in tag:
            raise ExchangeError(f"{path}: {describe(node)}: includes, plug-ins, flexible and composed bodies are not read")
        for key, x in node.items():
            if key.startswith("file") or key == "content_type":
                raise ExchangeError(f"{path}: {describe(node)}: {key}={x!r}: other files are not read")


def refuse_bulk(root: Element, path: Path) -> None:
    """Check that a short file does not ask for a huge model.

    Raises:
        ExchangeError: the model has more than ELEMENTS elements, including the copies that <replicate> makes, or MuJoCo would
            allocate more than NUMBERS numbers; the message names the element that asks for them.
    """
    elements = _count_elements(root, path)
    for node in root.iter("size"):
        for key in ("memory", *ARENA):
            arena = _count_arena(key, node.get(key, ""))
            if arena > NUMBERS:
                reason = f"{key}={node.get(key)!r} asks for {arena:.3g} numbers of memory, more than {NUMBERS}"
                raise ExchangeError(f"{path}: <size>: {reason}")
    numbers = 0.0
    for node in root.iter():
        for keys, count in _list_arrays(node, elements):
            numbers += count
            if numbers > NUMBERS:
                given = " ".join(f'{key}="{node.get(key)}"' for key in dict.fromkeys(keys))
                raise ExchangeError(f"{path}: {describe(node)}: {given} makes more than {NUMBERS} numbers")


def _list_arrays(node: Element, elements: float) -> Iterator[tuple[list[str], float]]:
    """Yield, for each array that MuJoCo sizes by attributes of a node, the names of these attributes and the array's length.

    `elements` is the number of elements in the document.
    """
    for keys in map(str.split, COUNTS):
        if any(key in node.attrib for key in keys):
            yield keys, prod(_read_largest(node.get(key, "")) for key in keys)
    for key, value in node.items():
        if node.tag == "size" and key.startswith(("nuser", "nkey")):
            # <size nuser_body="3"> allocates three numbers for every body: the count of all elements bounds the count of bodies
            yield [key], _read_largest(value) * elements


def _count_elements(root: Element, path: Path) -> float:
    """Return the number of elements, at most ELEMENTS, including the copies that <replicate> makes."""
    elements = 0.0
    waiting = [(root, 1.0)]  # elements to count, each with its number of copies, a float because a file may ask for any number
    while waiting:
        node, copies = waiting.pop()
        elements += copies
        copies_inside = copies * (_read_largest(node.get("count", "")) if node.tag == "replicate" else 1.0)
        if max(elements, copies_inside) > ELEMENTS:  # so that the message names the <replicate> and not its first child
            raise ExchangeError(f"{path}: {describe(node)}: more than {ELEMENTS} elements, copies counted, are not read")
        waiting += ((child, copies_inside) for child in reversed(node))  # `pop` then follows the order of the file
    return elements


def _count_arena(key: str, value: str) -> float:
    """Return how many numbers MuJoCo allocates for the attribute `key` of <size>."""
    if key == "memory":
        text = value.strip().upper()
        power = UNITS.find(text[-1]) + 1 if text else 0  # 0 if the text ends with no unit
        return _read_largest(text[:-1] if power else text) * 1024.0**power / 8  # a number has 8 bytes
    factor, power = ARENA[key]
    return float(factor * _read_largest(value) ** power)


def _read_largest(text: str) -> float:
    """Return the largest number in a text, but at least 1; also 1 if the text has anything but numbers, which MuJoCo refuses."""
    try:
        return max((x for x in map(float, text.split()) if x > 1), default=1.0)
    except ValueError:
        return 1.0
