"""Damage linkage files at random: in their bytes, in their words, or in their content."""

import copy
import random
import tomllib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from gauss_bench.exchange.toml import toml as write_toml
from gauss_bench.linkage.load import built_in
from tests.drawn_linkages import random_linkage

DATA = Path(__file__).parents[1] / "data"
DRAWN = 12  # number of random linkages among the sources
NUMBERS: tuple[Any, ...] = (
    0, -1, 1, 2, 3, 7, 1000, 10**6, 10**9, 10**12, 10**18, 10**30, 10**400, -(10**9), 0.0, -0.0, 1e-300, 5e-324, 1e-160,
    1e-30, 1e-12, 1e-6, 0.5, 90.0, 1e3, 1e6, 1e7, 1e9, 1e12, 1e15, 1e16, 1e22, 1e60, 1e100, 1e155, 1e160, 1e300, 1.7e308,
    -1e-9, -1e3, -1e7, -1e12, -1e160, float("inf"), float("-inf"), float("nan"),
)  # fmt: skip
TEXTS = (
    "", " ", ".", "..", "ground", "ground.", ".A", "ground.A", "crank", "crank.A", "a.b.c", "A"*70000, "x"*300, "\x00",
    "\x1b[31mred\x1b[0m", "\r\n\t\b\x7f", "\u202eevil", "\ufffe\uffff", "\U0001f600", "<script>alert(1)</script>", "&amp;",
    "]]>", "'; --", '"quoted"', "nan", "inf", "%s%n", "{0}", "../../etc/passwd", "constant", "sine", "table", "revolute",
    "prismatic", "planar-linkage/1", "planar-linkage/2", "é", "ß", "none",
)  # fmt: skip
TOKENS = (
    b"nan", b"inf", b"-inf", b"1e400", b"1e-400", b"0x7fffffffffffffff", b"9"*5000, b"["*3000, b"{ a = "*300, b'"""', b"'''",
    b"\x00", b"\xff\xfe", b"\xef\xbb\xbf", b"\x1b[2J", b"\r", b"1979-05-27T07:32:00Z", b"07:32:00", b"true", b"= =",
    b"[[links]]", b"[links]", b"[]", b"{}", b"\\u0000", b"\\ud800", b"#", b'"', b"'", b".", b",", b"=",
    b"a."*400 + b"b = 1\n", b"[" + b"a."*60 + b"b]\n", b"-", b"e", b"_",
)  # fmt: skip


@cache
def sources() -> tuple[tuple[str, bytes], ...]:
    """Return name and content of sound files: those of the suite and of its tests, and random linkages."""
    files = [*built_in().values(), *sorted(DATA.glob("*.toml"))]
    drawn = [random_linkage(seed) for seed in range(DRAWN)]
    return (*((x.stem, x.read_bytes()) for x in files), *((x["name"], toml(x)) for x in drawn))


def damaged_file(seed: int, index: int) -> tuple[str, bytes]:
    """Return name (without ending) and content of the damaged file with this number; equal numbers give equal files."""
    rng = random.Random(f"file {seed} {index}")
    name, content = rng.choice(sources())
    if rng.random() < 0.3:
        for _ in range(rng.choice((1, 1, 2, 4))):
            content = damage_bytes(content, rng)
        return name, content
    document = tomllib.loads(content.decode())
    for _ in range(rng.choice((1, 1, 1, 2, 3, 6))):
        rng.choice(CHANGES)(document, rng)
    return name, toml(document)


def damage_bytes(content: bytes, rng: random.Random) -> bytes:
    """Replace a part of a file by nothing, by a hostile token, or by another part of the file, once or many times."""
    a, c = rng.randrange(len(content) + 1), rng.randrange(len(content) + 1)
    b = rng.choice((a, a + 1, a + rng.randrange(1, 40), len(content)))
    part = content[c : c + rng.choice((1, 40, 300))] * rng.choice((1, 1, 2, 500))
    return content[:a] + rng.choice((b"", rng.choice(TOKENS), bytes([rng.randrange(256)]), part)) + content[b:]


def _places(item: Any) -> list[tuple[Any, Any]]:
    """Return every (container, key) of a document."""
    found: list[tuple[Any, Any]] = []
    waiting = [item]
    while waiting:
        holder = waiting.pop()
        pairs = holder.items() if isinstance(holder, dict) else enumerate(holder)
        for key, value in pairs:
            found.append((holder, key))
            if isinstance(value, (dict, list)):
                waiting.append(value)
    return found


def _any(document: dict[str, Any], rng: random.Random, kind: type | tuple[type, ...] = object) -> tuple[Any, Any] | None:
    places = [(x, key) for x, key in _places(document) if isinstance(x[key], kind)]
    return rng.choice(places) if places else None


def _another_number(document: dict[str, Any], rng: random.Random) -> None:
    if place := _any(document, rng, (int, float)):
        holder, key = place
        old = holder[key] if abs(holder[key]) < 1e300 else 1.0
        scaled = (old * 10.0 ** rng.choice((-12, -6, -3, 3, 6, 9, 12)), -old, old + rng.gauss(0, 1) * (abs(old) + 0.1))
        holder[key] = rng.choice((*NUMBERS, *scaled * 8))


def _many_numbers(document: dict[str, Any], rng: random.Random) -> None:
    """Multiply every number under one key of all tables, such as all masses, by one factor."""
    keys = sorted({key for x, key in _places(document) if isinstance(x, dict) and isinstance(x[key], (int, float))})
    if not keys:
        return
    chosen, factor = rng.choice(keys), rng.choice((*(x for x in NUMBERS if abs(x) < 1e308), 1e-6, 1e6, 1e9))
    for holder, key in _places(document):
        if isinstance(holder, dict) and key == chosen and isinstance(holder[key], (int, float)):
            holder[key] = float(holder[key]) * float(factor) if abs(holder[key]) < 1e300 else factor


def _another_value(document: dict[str, Any], rng: random.Random) -> None:
    """Replace a value of any kind by a hostile one, or by a text of the same file."""
    if place := _any(document, rng, rng.choice((str, object))):
        known = [x[key] for x, key in _places(document) if isinstance(x[key], str)]
        others = ([], {}, [[]], [{}], {"a": {}}, True, False, [1.0, 2.0], ["x"], [[1.0, 2.0]] * 3)
        place[0][place[1]] = rng.choice(rng.choice((known or TEXTS, TEXTS, NUMBERS, others)))


def _without(document: dict[str, Any], rng: random.Random) -> None:
    if place := _any(document, rng):
        del place[0][place[1]]


def _borrowed(document: dict[str, Any], rng: random.Random) -> None:
    """Replace a value by one from elsewhere in the same file, or from another file."""
    if place := _any(document, rng):
        other = document if rng.random() < 0.7 else tomllib.loads(rng.choice(sources())[1].decode())
        if found := _any(other, rng):
            place[0][place[1]] = copy.deepcopy(found[0][found[1]])


def _multiplied(document: dict[str, Any], rng: random.Random) -> None:
    """Repeat an entry many times."""
    if place := _any(document, rng):
        holder, key = place
        for i in range(rng.choice((1, 2, 10, 100, 2000))):
            if isinstance(holder, dict):
                holder[f"{str(key)[:40]}_{i}"] = holder[key]
            else:
                holder.insert(key, holder[key])


def _wrapped(document: dict[str, Any], rng: random.Random) -> None:
    """Add a random override to a scenario."""
    scenarios = document.get("scenarios")
    if isinstance(scenarios, dict) and scenarios and isinstance(one := rng.choice([*scenarios.values()]), dict):
        part = copy.deepcopy({k: v for k, v in document.items() if k != "scenarios"})
        for _ in range(rng.choice((1, 5))):
            rng.choice((_another_number, _without, _another_value))(part, rng)
        one["override"] = {k: v for k, v in part.items() if rng.random() < 0.4}


def _chained(document: dict[str, Any], rng: random.Random) -> None:
    """Add many points that follow from each other, perhaps in a circle."""
    ground = document.setdefault("ground", {})
    if isinstance(ground, dict):
        count = rng.choice((3, 30, 300, 1200))
        chain: dict[str, Any] = {f"p{i}": {"from": f"p{i + 1}", "r": 0.1} for i in range(count)}
        chain[f"p{count}"] = rng.choice(([0.0, 0.0], {"from": "p0", "xy": [1.0, 0.0]}))
        points = ground.get("points")
        ground["points"] = chain | (points if isinstance(points, dict) else {})


CHANGES: tuple[Callable[[dict[str, Any], random.Random], None], ...] = (
    *(_another_number,) * 6,
    *(_many_numbers,) * 2,
    *(_another_value,) * 5,
    *(_without,) * 2,
    _borrowed,
    _multiplied,
    _wrapped,
    _chained,
)


def toml(document: dict[str, Any]) -> bytes:
    return write_toml(document, []).encode("utf-8", "replace")
