"""Text of a file in other languages: escaping, comments, identifiers. Whatever a user wrote passes here on its way into a file.

A text in a comment becomes one printable line first, so that no language's end of line or end of comment is in it.
"""

import re
from collections.abc import Collection, Iterable, Mapping

from gauss_bench.trajectory import in_a_sentence

C_WORDS = """auto break case char const continue default do double else enum extern float for goto if inline int long register
restrict return short signed sizeof static struct switch typedef union unsigned void volatile while
main accelerate rollout names start end step none rows every"""


def xml_comment(lines: Iterable[str]) -> str:
    """The lines as what may stand between <!-- and -->, where two hyphens may not."""
    told = "\n".join(re.sub(r"-(?=-|$)", "- ", in_a_sentence(line)) for line in lines)
    return f"\n{told}\n"


def c_comment(lines: Iterable[str]) -> str:
    """The lines as a comment of C."""
    told = (re.sub(r"/(?=\*)", "/ ", re.sub(r"\*(?=/)", "* ", in_a_sentence(line))) for line in lines)
    return "/*\n" + "".join(f" * {line}".rstrip().rstrip("\\") + "\n" for line in told) + " */\n"


def c_string(text: str) -> str:
    """The text as a string of C: bytes outside plain letters in octal, question marks too (three letters of C begin with two)."""
    plain = frozenset(b"abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789 _.,:;()[]{}+-*/=<>!&|^~#$%'@")
    encoded = text.encode("utf-8", errors="replace")
    return '"' + "".join(chr(x) if x in plain else f"\\{x:03o}" for x in encoded) + '"'


def python_comment(lines: Iterable[str]) -> str:
    """The lines as comments of Python."""
    return "".join(f"# {in_a_sentence(line)}".rstrip() + "\n" for line in lines)


def toml_string(text: str) -> str:
    """The text as a basic string of TOML; what cannot be printed by its number."""
    plain = text.encode("utf-8", errors="replace").decode("utf-8")
    return '"' + "".join(c if c.isprintable() and c not in '"\\' else f"\\U{ord(c):08x}" for c in plain) + '"'


def heading(name: str) -> str:
    """A name without what would end a column of a table."""
    return "".join(c if c.isalnum() or c in "._- " else "_" for c in name)


def unique(base: str, taken: Collection[str]) -> str:
    """The name, with a number where it is taken."""
    k, chosen = 1, base
    while chosen in taken:
        k += 1
        chosen = f"{base}_{k}"
    return chosen


def identifiers(names: Iterable[str], reserved: str = "") -> Mapping[str, str]:
    """Name -> an identifier of C and Python, each once, and none of the reserved words (blanks between them)."""
    by_name: dict[str, str] = {}
    taken = set(reserved.split())
    for name in names:
        base = re.sub(r"[^A-Za-z0-9_]", "_", name)
        base = base if re.match("[A-Za-z]", base) else f"n{base}"
        by_name[name] = unique(base, taken)
        taken.add(by_name[name])
    return by_name
