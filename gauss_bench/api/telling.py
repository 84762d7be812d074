"""How verbs answer: an object as JSON or in words on stdout; progress, told at once or once it takes long, on stderr.

The words for people are templates, `text/VERB.txt`, which are given the very object that `--json` prints.
"""

import contextlib
import json
import math
import sys
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any, ClassVar

from gauss_bench.untrusted import harmless

LONG = 2.0  # [s] after which what takes so long says what it is
HIDDEN = {"told": "never"}  # metadata of a field that dictionaries leave out
UNLESS_EMPTY = {"told": "unless empty"}
Told = Callable[[str], None]
_later: list[threading.Timer] = []


class Result:
    """The answer of a public function, a dataclass: read by attribute, by key, as a dictionary and as JSON.

    Attributes:
        computed: properties that dictionaries have too.
        succeeded: whether the command ends with exit code 0.
        notices: sentences for stderr.
    """

    computed: ClassVar[tuple[str, ...]] = ()
    text: ClassVar[None] = None

    @property
    def succeeded(self) -> bool:
        return True

    @property
    def notices(self) -> tuple[str, ...]:
        return ()

    @property
    def data(self) -> Any:
        return self.as_dict()

    def as_dict(self) -> dict[str, Any]:
        """The fields by name, in order; what they hold is plain but for arrays."""
        by_name = {}
        for x in fields(self):  # type: ignore[arg-type]
            value, told = getattr(self, x.name), x.metadata.get("told")
            if told is None or (told == "unless empty" and value):
                by_name[x.name] = _as_data(value)
        return by_name | {name: getattr(self, name) for name in self.computed}

    def to_json(self) -> str:
        """As `--json` prints it; what is not finite becomes null, because JSON has no word for it."""
        return json.dumps(plain(self))

    def __getitem__(self, key: str) -> Any:
        return self.as_dict()[key]


@dataclass(frozen=True)
class Answer:
    """The answer of a verb that is no public function; `data` is what --json prints, None where nothing is printed.

    Attributes:
        text: for people, where the verb's template does not say it.
    """

    data: Any
    succeeded: bool = True
    text: str | None = None
    notices: tuple[str, ...] = ()


def _as_data(item: Any) -> Any:
    if isinstance(item, Result):
        return item.as_dict()
    if is_dataclass(item) and not isinstance(item, type):
        return {x.name: _as_data(getattr(item, x.name)) for x in fields(item)}
    if isinstance(item, Mapping):
        return {str(k): _as_data(x) for k, x in item.items()}
    if isinstance(item, (list, tuple)):
        return [_as_data(x) for x in item]
    return str(item) if isinstance(item, (str, Path)) else item


def plain(item: Any) -> Any:
    """Return what JSON knows: arrays and tuples as lists, dataclasses as dictionaries, None for what is not finite."""
    item = _as_data(item)
    if hasattr(item, "tolist"):
        item = item.tolist()
    if isinstance(item, dict):
        return {k: plain(x) for k, x in item.items()}
    if isinstance(item, list):
        return [plain(x) for x in item]
    return None if isinstance(item, float) and not math.isfinite(item) else item


def render(name: str, data: Any, **more: Any) -> str:
    """Return the words of the template `text/NAME.txt` for data, which the template calls x."""
    from jinja2 import Environment, PackageLoader, StrictUndefined  # which JSON does without

    loader = PackageLoader("gauss_bench.api", "text")
    environment = Environment(loader=loader, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters["f"] = lambda x, spec: "unknown" if x is None else format(x, spec)
    return environment.get_template(f"{name}.txt").render(x=plain(data), **more).rstrip("\n")


def tell(sentence: str) -> None:
    """Tell people; names of theirs may hold what drives a terminal."""
    print(harmless(sentence), file=sys.stderr, flush=True)


def nobody(sentence: str) -> None:
    """Tell nobody."""


def tell_if_long(sentence: str) -> None:
    """Tell people, unless `no_longer` is called within LONG seconds: what ends soon needs no words."""
    timer = threading.Timer(LONG, tell, (sentence,))
    timer.daemon = True
    with contextlib.suppress(RuntimeError):  # a machine that has no thread left can still do what was asked for
        timer.start()
        _later.append(timer)


def no_longer() -> None:
    """Withdraw a message that was to be told only if it took long."""
    while _later:
        _later.pop().cancel()
