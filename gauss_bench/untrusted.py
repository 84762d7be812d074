"""Files, TOML and words of other people: opened without waiting, measured before they are parsed, printed without harm."""

import os
import re
import stat
import tomllib
import unicodedata
from pathlib import Path
from typing import Any

DEEPEST = 20  # levels of one key, and brackets in each other; the grammar of linkage files needs 6
UNPRINTABLE = ("Cc", "Cs", "Cn", "Zl", "Zp")
TURNING = ("LRE", "RLE", "LRO", "RLO", "PDF", "LRI", "RLI", "FSI", "PDI")

# Strings and comments are skipped whole. A quote that nothing closes ends the search: the parser refuses it too.
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
    """What the user can mend: a faulty file, an unknown name, a number that cannot be used, a folder that cannot be written."""


class TooDeep(tomllib.TOMLDecodeError):
    """Tables or lists that lie deeper in each other than any file of this suite needs."""


def read_bytes(path: Path, most: int) -> bytes:
    """Return the bytes of a regular file. Nothing is waited for.

    Raises:
        OSError: it cannot be opened, is a folder, a pipe, a socket or a device, or longer than `most`.
    """
    # a pipe that nobody writes would be waited for, and a terminal would become this process's own
    with open(os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC), "rb") as file:
        if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            raise OSError(None, "no regular file", str(path))
        content = file.read(most + 1) or b""  # nothing at all where a file of the system has nothing to say yet
    if len(content) > most:
        raise OSError(None, f"larger than {most} bytes", str(path))
    return content


def read_start(path: Path, most: int) -> bytes:
    """Return the first bytes of a file, `most` at most."""
    with path.open("rb") as file:
        return file.read(most)


def parse_toml(text: str, parse_float: Any = float) -> dict[str, Any]:
    """Return the document of a TOML text.

    Raises:
        TOMLDecodeError: it is none; TooDeep before it is parsed, since the parser takes memory by the square of the depth.
    """
    check_depth(text)
    return tomllib.loads(text, parse_float=parse_float)


def check_depth(text: str) -> None:
    """Let a text pass whose keys have at most DEEPEST dots and whose brackets lie at most DEEPEST deep.

    Raises:
        TooDeep: naming the line.
    """
    dots = brackets = 0
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
            case "quote" | "open_string":
                return
        if dots > DEEPEST or brackets > DEEPEST:
            line = text.count("\n", 0, token.start()) + 1
            raise TooDeep(f"tables or lists lie more than {DEEPEST} deep (at line {line})")


def unprintable(x: str) -> bool:
    """Tell whether a character drives a terminal, turns the direction of what follows, or stands for none."""
    return x not in "\n\t" and (unicodedata.category(x) in UNPRINTABLE or unicodedata.bidirectional(x) in TURNING)


def harmless(text: str) -> str:
    """Return a text for people, with what drives a terminal written out."""
    return "".join(x.encode("unicode_escape").decode() if unprintable(x) else x for x in text)
