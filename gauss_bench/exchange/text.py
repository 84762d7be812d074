"""Escape text for other languages: strings, comments, identifiers. All text of a user in an exported file is escaped here.

A text for a comment is first made one printable line, so that it cannot end the line or the comment in any language.
"""

import re
from collections.abc import Collection, Iterable, Mapping
from itertools import count

from gauss_bench.trajectory import in_a_sentence

C_WORDS = """auto break case char const continue default do double else enum extern float for goto if inline int long register
restrict return short signed sizeof static struct switch typedef union unsigned void volatile while
main accelerate rollout names start end step none rows every"""


def xml_comment(lines: Iterable[str]) -> str:
    """Return the lines as the content of an XML comment, which must not contain two hyphens in a row."""
    text = "\n".join(re.sub(r"-(?=-|$)", "- ", in_a_sentence(line)) for line in lines)
    return f"\n{text}\n"


def c_comment(lines: Iterable[str]) -> str:
    """Return the lines as a comment of C, in which neither "/*" nor "*/" occurs."""
    safe = (re.sub(r"/(?=\*)", "/ ", re.sub(r"\*(?=/)", "* ", in_a_sentence(line))) for line in lines)
    return "/*\n" + "".join(f" * {line}".rstrip().rstrip("\\") + "\n" for line in safe) + " */\n"


def c_string(text: str) -> str:
    """Return the text as a string literal of C.

    Bytes that are not plain ASCII become octal escapes; so do question marks, because two of them begin a trigraph.
    """
    plain = frozenset(b"abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789 _.,:;()[]{}+-*/=<>!&|^~#$%'@")
    encoded = text.encode("utf-8", errors="replace")
    return '"' + "".join(chr(x) if x in plain else f"\\{x:03o}" for x in encoded) + '"'


def python_comment(lines: Iterable[str]) -> str:
    """Return the lines as comments of Python."""
    return "".join(f"# {in_a_sentence(line)}".rstrip() + "\n" for line in lines)


def toml_string(text: str) -> str:
    """Return the text as a basic string of TOML; characters that cannot be printed are escaped by their numbers."""
    plain = text.encode("utf-8", errors="replace").decode("utf-8")
    return '"' + "".join(c if c.isprintable() and c not in '"\\' else f"\\U{ord(c):08x}" for c in plain) + '"'


def unique(base: str, taken: Collection[str]) -> str:
    """Return the name, with a number after it if it is taken."""
    candidates = (f"{base}_{k}" for k in count(2))
    return base if base not in taken else next(name for name in candidates if name not in taken)


def identifiers(names: Iterable[str], reserved: str) -> Mapping[str, str]:
    """Return name -> identifier of C and Python: all are different, and none is one of the words in the text `reserved`."""
    by_name: dict[str, str] = {}
    taken = set(reserved.split())
    for name in names:
        base = re.sub(r"[^A-Za-z0-9_]", "_", name)
        base = base if re.match("[A-Za-z]", base) else f"n{base}"
        by_name[name] = unique(base, taken)
        taken.add(by_name[name])
    return by_name
