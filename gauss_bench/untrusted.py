"""Safe handling of untrusted files and texts: bounded reading without blocking, bounded depth, no control characters."""

import os
import re
import stat
import tomllib
import unicodedata
from pathlib import Path
from typing import Any

DEEPEST = 20  # largest nesting of keys or brackets; the grammar of linkage files needs 6
UNPRINTABLE = ("Cc", "Cs", "Cn", "Zl", "Zp")  # Unicode categories: controls, surrogates, unassigned, line and paragraph separators
TURNING = ("LRE", "RLE", "LRO", "RLO", "PDF", "LRI", "RLI", "FSI", "PDI")  # bidirectional classes that change the writing direction

# The tokens of TOML that matter for nesting. Strings and comments are skipped, because brackets in them do not nest. An unclosed
# quote ends the search, because the parser refuses it in any case.
TOKEN = re.compile(
    r'''
    (?P<skipped> """(?:[^"\\]|\\.|"(?!""))*+"{3,5} | \'\'\'(?:[^']|'(?!''))*+'{3,5} | \#[^\n]*+ )
    | (?P<open_string> """ | \'\'\' )
    | (?P<string> "(?:[^"\\\n]|\\.)*+" | '[^'\n]*+' )
    | (?P<quote> ["'] )
    | (?P<dot> \. ) | (?P<opening> [\[{] ) | (?P<closing> [\]}] ) | (?P<other> [=,\n] )
    ''',
    re.VERBOSE | re.DOTALL,
)


class BadInput(Exception):
    """An error that the user can correct: a faulty file, an unknown name, an unusable number, a folder that cannot be written."""


class TooDeep(tomllib.TOMLDecodeError):
    """A TOML text has tables or lists that are nested more than DEEPEST deep."""


def read_bytes(path: Path, most: int) -> bytes:
    """Return the content of a regular file of at most `most` bytes; never block, as opening a pipe would.

    Raises:
        OSError: the file cannot be opened, is not a regular file, or is larger than `most` bytes.
    """
    # O_NONBLOCK: opening a pipe without a writer would block; O_NOCTTY: a terminal would become the controlling one
    careful = os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC
    with open(path, "rb", opener=lambda name, flags: os.open(name, flags | careful)) as file:
        if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            raise OSError(None, "no regular file", str(path))
        content = file.read(most + 1) or b""  # None: some files in /proc have no data yet
    if len(content) > most:
        raise OSError(None, f"larger than {most} bytes", str(path))
    return content


def read_start(path: Path, most: int) -> bytes:
    """Return the first `most` bytes of a file, or all if it is shorter."""
    with path.open("rb") as file:
        return file.read(most)


def parse_toml(text: str, parse_float: Any = float) -> dict[str, Any]:
    """Return the document of a TOML text; `parse_float` converts the text of a number with a fraction.

    Raises:
        TOMLDecodeError: the text is not TOML.
        TooDeep: keys or brackets are nested more than DEEPEST deep.
    """
    check_depth(text)  # before parsing: the parser's memory grows with the square of the depth
    return tomllib.loads(text, parse_float=parse_float)


def check_depth(text: str) -> None:
    """Check that keys have at most DEEPEST dots and that brackets are nested at most DEEPEST deep.

    Raises:
        TooDeep: a key has more dots, or brackets are nested more deeply; the message names the line.
    """
    dots = brackets = 0  # number of dots in the key at this place, and of open brackets
    for token in TOKEN.finditer(text):
        match token.lastgroup:
            case "dot":
                dots += 1
            case "opening":
                dots, brackets = 0, brackets + 1
            case "closing":
                dots, brackets = 0, brackets - 1
            case "other":
                dots = 0
            case "quote" | "open_string":  # a string that is not closed: the text is not TOML, and the parser will refuse it
                return
        if dots > DEEPEST or brackets > DEEPEST:
            line = text.count("\n", 0, token.start()) + 1
            raise TooDeep(f"tables or lists lie more than {DEEPEST} deep (at line {line})")


def unprintable(x: str) -> bool:
    """Tell whether a character controls a terminal, changes the writing direction, or is not assigned."""
    return x not in "\n\t" and (unicodedata.category(x) in UNPRINTABLE or unicodedata.bidirectional(x) in TURNING)


def harmless(text: str) -> str:
    """Return a text in which unprintable characters are replaced by escape sequences."""
    return "".join(x.encode("unicode_escape").decode() if unprintable(x) else x for x in text)
