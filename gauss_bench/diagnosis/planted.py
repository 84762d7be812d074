"""Plant the faults of `planted.toml`: each alters a function, a limit, a linkage or a sample while its check runs.

No file is changed. While a fault is planted, the functions of a module run code that is compiled from its altered source;
afterwards they run their own code again.
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
NUMBERS = (int, float, str, tuple, dict)  # types of the module's constants that an altered source may change


@dataclass(frozen=True)
class Planted:
    """One fault and the check that must detect it.

    Attributes:
        kind: part of the suite in which the fault lies: models, formulations, metrics, references, clocks or gate.
        sentence: description of the fault.
        sound: the check without the fault, which must return None; check: the check with the fault, which must return a sentence.
    """

    kind: str
    sentence: str
    sound: Check
    check: Check


@contextmanager
def plant(file: str, text: str, mutant: str) -> Iterator[None]:
    """Let a module run, within this context, as if its source file contained `mutant` instead of `text`.

    Other modules hold references to the functions of this module. The function objects are therefore kept, and only their code
    objects are exchanged for those of the altered source. Constants of the types NUMBERS are replaced in the module.

    Raises:
        ValueError: `text` does not occur exactly once in the file.
    """
    module = import_module(file.removesuffix(".py").replace("/", "."))
    path = Path(str(module.__file__))
    source = path.read_text(encoding="utf-8")
    if source.count(text) != 1:
        raise ValueError(f"{file} does not contain {text!r} exactly once")
    spoilt: dict[str, Any] = {"__name__": module.__name__}  # names of the module that its altered source makes
    exec(compile(source.replace(text, mutant), str(path), "exec"), spoilt)
    original = vars(module)
    constants = {name: x for name, x in original.items() if type(x) in NUMBERS and not name.startswith("__")}
    # for the module itself and for each of its classes: the names in the original one and in the altered one
    pairs = [(original, spoilt), *((vars(x), vars(spoilt[name])) for name, x in original.items() if isinstance(x, type))]
    own_code, new_code = {}, {}
    for names, altered in pairs:
        for name, function in names.items():
            if type(function) is FunctionType:
                own_code[function], new_code[function] = function.__code__, altered[name].__code__
    try:
        original |= {name: spoilt[name] for name in constants}
        for function, code in new_code.items():
            function.__code__ = code
        yield
    finally:
        original |= constants
        for function, code in own_code.items():
            function.__code__ = code


def read_fault(kind: str, sentence: str, check: str, where: tuple[str, str] = checks.FOUR_BAR, **fault: Any) -> Planted:
    """Return the fault of the suite that one [[fault]] table of `planted.toml` describes, with the check that must detect it.

    Args:
        kind: the part of the suite in which the fault lies, such as metrics; sentence: description of the fault.
        check: name of the function of `checks` that must detect it.
        where: linkage and scenario that are checked; not used if `fault` has the key `file`.
        fault: if it has the key `file`, the arguments of `plant`, which alters this file while the check runs; otherwise further
            arguments of the check, by which the check itself plants the fault.
    """
    sound: Any = getattr(checks, check)  # the check, run without the fault
    if "file" in fault:

        def spoilt() -> str | None:
            """Run the check with the fault: while the source file is altered."""
            with plant(**fault):
                return sound()  # type: ignore[no-any-return]

        return Planted(kind, sentence, sound, spoilt)
    return Planted(kind, sentence, partial(sound, tuple(where)), partial(sound, tuple(where), **fault))


PLANTED = tuple(read_fault(**x) for x in TABLES["fault"])


def smallest(check: Callable[[float], str | None], sound: float = 1e-17, seen: float = 1e-2, factor: float = 1.05) -> float:
    """Return the smallest size of a fault that a check detects, by bisection on a logarithmic scale.

    Args:
        check: function that plants a fault of a given size; it returns a sentence if it detects the fault, and otherwise None.
        sound: a size of the fault that the check does not detect; seen: a size that the check detects.
        factor: the returned size is larger than the smallest detected size by at most this factor.

    Raises:
        ValueError: the check does not detect a fault of the size `seen`, or detects one of the size `sound`.
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


# kind of fault -> unit of its size, and check of a fault of this size
SIZES: dict[str, tuple[str, Callable[[float], str | None]]] = {
    "inertia": ("of the crank's inertia", lambda x: checks.check_model(alter={"of": "crank", "inertia": 1 + x})),
    "length": ("m of the coupler's length", lambda x: checks.check_model(alter={"joint": "B", "by": x})),
    "damping": ("of the brake's damping", lambda x: checks.check_model(alter={"of": "brake", "c": 1 + x})),
    "time": ("s of every sample's time", checks.check_sample_times),
}
