"""Convert texts to string literals, comments and identifiers of C, Python, TOML and XML.

All text of a user in an exported file is escaped here; a text for a comment becomes a single line of printable characters, so that
it cannot end the comment.
"""

import re
from collections.abc import Collection, Iterable, Mapping

from gauss_bench.trajectory import in_a_sentence

# keywords of C, then the names that templates/program.c.jinja defines
C_WORDS = """auto break case char const continue default do double else enum extern float for goto if inline int long register
restrict return short signed sizeof static struct switch typedef union unsigned void volatile while
main accelerate rollout names start end step none rows every"""


def xml_comment(lines: Iterable[str]) -> str:
    """Return the lines as the content of an XML comment, which must not contain two hyphens in a row, nor end with one."""
    text = "\n".join(re.sub(r"-(?=-|$)", "- ", in_a_sentence(line)) for line in lines)
    return f"\n{text}\n"


def c_comment(lines: Iterable[str]) -> str:
    """Return the lines as one comment of C, within which neither "/*" nor "*/" occurs."""
    comment = "/*\n"
    for line in lines:
        without_ends = re.sub(r"\*(?=/)", "* ", in_a_sentence(line))
        safe = re.sub(r"/(?=\*)", "/ ", without_ends)
        comment += f" * {safe}".rstrip().rstrip("\\") + "\n"  # a backslash at the end would join two lines
    return comment + " */\n"


def c_string(text: str) -> str:
    """Return the text as a string literal of C; question marks are escaped too, because two of them begin a trigraph."""
    plain = frozenset(b"abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789 _.,:;()[]{}+-*/=<>!&|^~#$%'@")
    encoded = text.encode("utf-8", errors="replace")
    return '"' + "".join(chr(x) if x in plain else f"\\{x:03o}" for x in encoded) + '"'


def python_comment(lines: Iterable[str]) -> str:
    """Return the lines as Python comments, each line after a `#`."""
    return "".join(f"# {in_a_sentence(line)}".rstrip() + "\n" for line in lines)


def toml_string(text: str) -> str:
    """Return the text as a basic string of TOML, in which characters that cannot be printed are escaped by their numbers."""
    plain = text.encode("utf-8", errors="replace").decode("utf-8")  # lone surrogates, which UTF-8 cannot hold, become "?"
    return '"' + "".join(c if c.isprintable() and c not in '"\\' else f"\\U{ord(c):08x}" for c in plain) + '"'


def make_unique(base: str, taken: Collection[str]) -> str:
    """Return `base` or, if `base` is in `taken`, `base` with the smallest number from 2 on that makes it new."""
    name, number = base, 1
    while name in taken:
        number += 1
        name = f"{base}_{number}"
    return name


def make_identifiers(names: Iterable[str], reserved: str) -> Mapping[str, str]:
    """Return name -> identifier that C and Python accept; no identifier occurs twice or is a word in the text `reserved`."""
    by_name: dict[str, str] = {}
    taken = set(reserved.split())
    for name in names:
        base = re.sub(r"[^A-Za-z0-9_]", "_", name)
        by_name[name] = make_unique(base if re.match("[A-Za-z]", base) else f"n{base}", taken)
        taken.add(by_name[name])
    return by_name
