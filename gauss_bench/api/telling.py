"""The output of commands: an object on stdout, as JSON or as text, and progress on stderr.

The text comes from a template `text/VERB.txt`, in which x is the object that `--json` prints.
"""

import contextlib
import json
import math
import sys
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeVar

from gauss_bench.untrusted import harmless

LONG = 2.0  # [s] time after which `tell_if_long` prints its sentence
HIDDEN = {"shown": "never"}  # metadata of a field that dictionaries leave out
UNLESS_EMPTY = {"shown": "unless empty"}  # metadata of a field that dictionaries leave out if it is empty
Told = Callable[[str], None]  # a function that is called with each sentence of progress
Data = TypeVar("Data")
_pending: list[threading.Timer] = []  # timers of sentences that are not printed yet


class Result:
    """The base of dataclasses that public functions return: fields are read by attribute, by key, as a dictionary or as JSON.

    Attributes:
        computed: names of properties that are part of the dictionary.
        text: text that the command line prints; with None the text is made from the command's template.
        succeeded: whether the command ends with exit code 0.
        notices: sentences that are printed on stderr.
        data: the object that `--json` prints.
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
        """Return name -> field, in order, as plain data and arrays, then the properties in `computed`.

        A field is left out if it is marked HIDDEN, or if it is empty and marked UNLESS_EMPTY.
        """
        by_name = {}
        for field in fields(self):  # type: ignore[arg-type]
            value, shown = getattr(self, field.name), field.metadata.get("shown")
            if shown is None or (shown == "unless empty" and value):
                by_name[field.name] = _as_data(value)
        return by_name | {name: getattr(self, name) for name in self.computed}

    def to_json(self) -> str:
        """Return the JSON that `--json` prints; numbers that are not finite, which JSON lacks, become null."""
        return json.dumps(plain(self))

    def __getitem__(self, key: str) -> Any:
        return self.as_dict()[key]


@dataclass(frozen=True)
class Answer(Generic[Data]):
    """The result of a command that is no public function of the package.

    Attributes:
        data: object that --json prints; None prints nothing. The type of this object is published as the command's JSON schema.
        succeeded: whether the command ends with exit code 0.
        text: text that is printed without --json; with None the text is made from the command's template.
        notices: sentences that are printed on stderr.
    """

    data: Data
    succeeded: bool = True
    text: str | None = None
    notices: tuple[str, ...] = ()


def _as_data(item: Any, convert: Callable[[Any], Any] = lambda x: x) -> Any:
    """Return an item with dataclasses and mappings as dictionaries, tuples as lists, and paths as texts, at all depths.

    `convert` is applied to every other value, such as a number or an array; by default these stay as they are.
    """
    if isinstance(item, Result):
        item = item.as_dict()
    elif is_dataclass(item) and not isinstance(item, type):
        item = {x.name: getattr(item, x.name) for x in fields(item)}
    if isinstance(item, Mapping):
        return {str(k): _as_data(x, convert) for k, x in item.items()}
    if isinstance(item, (list, tuple)):
        return [_as_data(x, convert) for x in item]
    return str(item) if isinstance(item, (str, Path)) else convert(item)


def plain(item: Any) -> Any:
    """Return JSON data: arrays and tuples become lists, dataclasses dictionaries, and numbers that are not finite become None."""
    return _as_data(item, _plain_number)


def _plain_number(x: Any) -> Any:
    """Return a number or an array of numbers as JSON data: arrays become lists, and numbers that are not finite become None."""
    if hasattr(x, "tolist"):
        return plain(x.tolist())
    return None if isinstance(x, float) and not math.isfinite(x) else x


def render(name: str, data: Any, **more: Any) -> str:
    """Return the text of the template `text/NAME.txt`, in which x is `data`, and the values in `more` have their own names."""
    from jinja2 import Environment, PackageLoader, StrictUndefined  # imported late: JSON output does not need it

    loader = PackageLoader("gauss_bench.api", "text")
    environment = Environment(loader=loader, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    # in templates x|f(".3g") formats a number; None stands for a number that is not finite
    environment.filters["f"] = lambda x, spec: "unknown" if x is None else format(x, spec)
    return environment.get_template(f"{name}.txt").render(x=plain(data), **more).rstrip("\n")


def tell(sentence: str) -> None:
    """Print a sentence on stderr; control characters, which names from files may contain, are escaped."""
    print(harmless(sentence), file=sys.stderr, flush=True)


def nobody(sentence: str) -> None:
    """Ignore a sentence of progress; the functions of the package have this default, so that they print nothing."""


def tell_if_long(sentence: str) -> None:
    """Print a sentence on stderr after LONG seconds, unless `cancel_sentences` is called earlier."""
    timer = threading.Timer(LONG, tell, (sentence,))
    timer.daemon = True
    with contextlib.suppress(RuntimeError):  # no further thread can be started: the command runs without this sentence
        timer.start()
        _pending.append(timer)


def cancel_sentences() -> None:
    """Cancel the sentences that `tell_if_long` has not printed yet."""
    while _pending:
        _pending.pop().cancel()
