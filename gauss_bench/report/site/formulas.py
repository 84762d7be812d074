"""Convert plain-text formulas of tables, such as "J^- g", to MathML, with indices, exponents, primes and Greek letters.

A formula becomes several pieces, between which a line may break, so that the formula fits the screen of a phone. A cell whose text
contains words is no formula and is not converted.
"""

import re

from markupsafe import Markup

GREEK = {"th": "θ", "theta": "θ", "phi": "φ", "tau": "τ", "lambda": "λ", "pi": "π"}
GREEK |= {"alpha": "\N{GREEK SMALL LETTER ALPHA}", "gamma": "\N{GREEK SMALL LETTER GAMMA}"}
NAMES = {*GREEK, "sin", "cos", "diag", "rank", "sum"}
WORD = re.compile(r"[A-Za-z]+")
TOKEN = re.compile(r"(?P<number>\d+(?:\.\d+)?)|(?P<name>[A-Za-z]+)(?P<index>\d+[A-Z]?)?|(?P<space> +)|(?P<sign>.)")
RAISED = re.compile(r"\^(?:\(([^()]*)\)|(-\d|[A-Za-z\d]+|[-+]))")
LOWERED, PRIMES = re.compile(r"_([A-Za-z\d]+)"), re.compile("'+")
BREAK = re.compile(r" (?=[=+-] )|(?<=,) ")


def is_formula(text: str) -> bool:
    """Tell whether a text is a formula: it has an operator, and no words except functions, Greek letters and symbols."""
    words = WORD.findall(text)
    return bool(words and re.search(r"[=^']", text)) and all(x in NAMES or len(x) < 3 for x in words) and "_" not in text[:1]


def mathml(text: str) -> Markup:
    """Return the MathML of a formula, in pieces between which a line may break."""
    return Markup(" ").join(Markup("<math>{}</math>").format(_piece(x)) for x in BREAK.split(text))


def _piece(text: str) -> Markup:
    """Return the MathML of a piece of a formula: each symbol with its index, primes and exponent, in this order."""
    parts, at = [], 0
    while at < len(text):
        found = TOKEN.match(text, at)
        assert found is not None, "any character is a sign"
        at = found.end()
        if found["space"]:
            parts.append(Markup('<mspace width="0.2em"></mspace>'))
            continue
        base = _atom(found)
        if lowered := LOWERED.match(text, at):
            base, at = Markup("<msub>{}<mi>{}</mi></msub>").format(base, lowered[1]), lowered.end()
        above = Markup("")
        if primes := PRIMES.match(text, at):
            above, at = Markup("<mo>{}</mo>").format("\N{PRIME}" * len(primes[0])), primes.end()
        if raised := RAISED.match(text, at):
            above, at = above + _piece(raised[1] or raised[2]), raised.end()
        parts.append(Markup("<msup>{}<mrow>{}</mrow></msup>").format(base, above) if above else base)
    return Markup("").join(parts)


def _atom(found: re.Match[str]) -> Markup:
    """Return the MathML of a token: a number, a name, which may end in an index, or a sign."""
    if found["number"]:
        return Markup("<mn>{}</mn>").format(found["number"])
    if found["name"]:
        name = Markup("<mi>{}</mi>").format(GREEK.get(found["name"], found["name"]))
        return Markup("<msub>{}<mn>{}</mn></msub>").format(name, found["index"]) if found["index"] else name
    sign = "\N{MINUS SIGN}" if found["sign"] == "-" else found["sign"]
    return Markup('<mo stretchy="false">{}</mo>').format(sign)
