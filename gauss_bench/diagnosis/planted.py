"""The faults of `planted.toml`: each alters a function, a limit, a linkage or a sample while the check that must detect it runs.

No file is changed. The functions of a module get the code compiled from its altered source, and afterwards their own code again.
"""

import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path
from types import FunctionType
from typing import Any

import numpy as np

from gauss_bench.diagnosis import checks

Check = Callable[[], str | None]
TABLES: dict[str, list[dict[str, Any]]] = tomllib.loads(Path(__file__).with_name("planted.toml").read_text(encoding="utf-8"))
NUMBERS = (int, float, str, tuple, dict)


@dataclass(frozen=True)
class Planted:
    """One fault and the check that must detect it.

    Attributes:
        kind: place of the fault: models, formulations, metrics, references, clocks or gate.
        sentence: description of the fault.
        sound: the check without the fault, which must find nothing; check: the same with the fault, which must find it.
    """

    kind: str
    sentence: str
    sound: Check
    check: Check


@contextmanager
def plant(file: str, text: str, mutant: str) -> Iterator[None]:
    """Let a module run as if its file contained `mutant` instead of `text`.

    Raises:
        ValueError: the file does not contain the text exactly once.
    """
    module = import_module(file.removesuffix(".py").replace("/", "."))
    path = Path(str(module.__file__))
    source = path.read_text(encoding="utf-8")
    if source.count(text) != 1:
        raise ValueError(f"{file} does not contain {text!r} exactly once")
    spoilt: dict[str, Any] = {"__name__": module.__name__}
    exec(compile(source.replace(text, mutant), str(path), "exec"), spoilt)
    there = vars(module)
    kept = {name: x for name, x in there.items() if type(x) in NUMBERS and not name.startswith("__")}
    places = [(there, spoilt), *((vars(x), vars(spoilt[name])) for name, x in there.items() if isinstance(x, type))]
    functions = [(x, x.__code__, new[name].__code__) for own, new in places for name, x in own.items() if type(x) is FunctionType]
    try:
        there |= {name: spoilt[name] for name in kept}
        for function, _, code in functions:
            function.__code__ = code
        yield
    finally:
        there |= kept
        for function, code, _ in functions:
            function.__code__ = code


def read_fault(kind: str, sentence: str, check: str, where: tuple[str, str] = checks.FOUR_BAR, **fault: Any) -> Planted:
    """Read one entry of the file."""
    sound: Any = getattr(checks, check)
    if "file" in fault:

        def spoilt() -> str | None:
            with plant(**fault):
                return sound()  # type: ignore[no-any-return]

        return Planted(kind, sentence, sound, spoilt)
    return Planted(kind, sentence, partial(sound, tuple(where)), partial(sound, tuple(where), **fault))


PLANTED = tuple(read_fault(**x) for x in TABLES["fault"])


def smallest(check: Callable[[float], str | None], sound: float = 1e-17, seen: float = 1e-2, factor: float = 1.05) -> float:
    """Return the smallest size of a fault that a check detects, to `factor`, by bisection of its logarithm.

    Args:
        sound: a size that is not detected; seen: a size that is.

    Raises:
        ValueError: the larger is not detected, or the smaller is.
    """
    if check(seen) is None or check(sound) is not None:
        raise ValueError(f"a fault of {seen:g} is not detected, or one of {sound:g} is")
    while seen > sound * factor:
        middle = float(np.sqrt(sound * seen))
        if check(middle) is None:
            sound = middle
        else:
            seen = middle
    return seen


SIZES: dict[str, tuple[str, Callable[[float], str | None]]] = {
    "inertia": ("of the crank's inertia", lambda x: checks.model(alter={"of": "crank", "inertia": 1 + x})),
    "length": ("m of the coupler's length", lambda x: checks.model(alter={"joint": "B", "by": x})),
    "damping": ("of the brake's damping", lambda x: checks.model(alter={"of": "brake", "c": 1 + x})),
    "time": ("s of every sample's time", checks.in_time),
}
