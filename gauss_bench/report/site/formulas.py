"""Convert plain-text formulas of tables, such as "J^- g", to MathML, with indices, exponents, primes and Greek letters.

A formula becomes several pieces, and a line may break between two of them, so that the formula fits the screen of a phone. A cell
whose text contains words is no formula and is not converted.
"""

import re

from markupsafe import Markup

GREEK = {"th": "θ", "theta": "θ", "phi": "φ", "tau": "τ", "lambda": "λ", "pi": "π"}
GREEK |= {"alpha": "\N{GREEK SMALL LETTER ALPHA}", "gamma": "\N{GREEK SMALL LETTER GAMMA}"}
NAMES = {*GREEK, "sin", "cos", "diag", "rank", "sum"}  # words that formulas may contain
WORD = re.compile(r"[A-Za-z]+")
TOKEN = re.compile(r"(?P<number>\d+(?:\.\d+)?)|(?P<name>[A-Za-z]+)(?P<index>\d+[A-Z]?)?|(?P<space> +)|(?P<sign>.)")
RAISED = re.compile(r"\^(?:\(([^()]*)\)|(-\d|[A-Za-z\d]+|[-+]))")
LOWERED, PRIMES = re.compile(r"_([A-Za-z\d]+)"), re.compile("'+")
BREAK = re.compile(r" (?=[=+-] )|(?<=,) ")  # the space before =, + or -, or after a comma


def is_formula(text: str) -> bool:
    """Tell whether a text has one of = ^ ', only words of NAMES and symbols of one or two letters, and no underscore in front."""
    words = WORD.findall(text)
    return bool(words and re.search(r"[=^']", text)) and all(x in NAMES or len(x) < 3 for x in words) and not text.startswith("_")


def mathml(text: str) -> Markup:
    """Return the MathML of a formula, in pieces between which a line may break."""
    return Markup(" ").join(Markup("<math>{}</math>").format(_convert_piece(x)) for x in BREAK.split(text))


def _convert_piece(text: str) -> Markup:
    """Return the MathML of a piece of a formula: each symbol with its index, primes and exponent, in this order."""
    parts, start = [], 0
    while start < len(text):
        token = TOKEN.match(text, start)
        assert token is not None, "any character is a sign"
        start = token.end()
        if token["space"]:
            parts.append(Markup('<mspace width="0.2em"></mspace>'))
            continue
        base = _convert_token(token)
        if lowered := LOWERED.match(text, start):
            base, start = Markup("<msub>{}<mi>{}</mi></msub>").format(base, lowered[1]), lowered.end()
        above = Markup("")
        if primes := PRIMES.match(text, start):
            above, start = Markup("<mo>{}</mo>").format("\N{PRIME}" * len(primes[0])), primes.end()
        if raised := RAISED.match(text, start):
            above, start = above + _convert_piece(raised[1] or raised[2]), raised.end()
        parts.append(Markup("<msup>{}<mrow>{}</mrow></msup>").format(base, above) if above else base)
    return Markup("").join(parts)


def _convert_token(token: re.Match[str]) -> Markup:
    """Return the MathML of a match of TOKEN: a number, a name, which may end in an index, or a sign."""
    if token["number"]:
        return Markup("<mn>{}</mn>").format(token["number"])
    if token["name"]:
        name = Markup("<mi>{}</mi>").format(GREEK.get(token["name"], token["name"]))
        return Markup("<msub>{}<mn>{}</mn></msub>").format(name, token["index"]) if token["index"] else name
    sign = "\N{MINUS SIGN}" if token["sign"] == "-" else token["sign"]
    return Markup('<mo stretchy="false">{}</mo>').format(sign)
