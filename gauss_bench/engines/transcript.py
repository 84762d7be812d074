"""Record an adapter's calls as a script: the adapter builds its model with a stand-in for the library that records every call.

The recorded calls, in order, are a script that builds the model without the adapter. Its model equals the one that the adapter
has compared with the linkage, because the same calls build both.

    mbs = Script({"AddNode": "node_"}).stand_in("mbs")
    mbs.AddNode(items.NodePoint(name="A"))                       records: node_1 = mbs.AddNode(items.NodePoint(name='A'))
"""

import re
from collections.abc import Mapping
from itertools import count
from typing import Any

import numpy as np

from gauss_bench.mechanism.model import Mechanism
from gauss_bench.trajectory import in_a_sentence

# first words of the names of functions whose results are not used: setName matches, but FixedOffsetFrame does not
COMMAND = re.compile("(?i:(re)?set|add|append|change|disable|override|finalize|weld|connect|fix|assemble)(?![a-z])")


class Script:
    """A Python script under construction; `lines` are the lines of Python source recorded so far."""

    def __init__(self, statements: Mapping[str, str]):
        """Begin an empty script.

        A call of a function whose name matches COMMAND becomes a line without a variable. A call of any other function that is
        not in `statements` becomes part of the expression that uses its result.

        Args:
            statements: name of a function or method whose calls become lines of the script -> variable to which the line assigns
                the result. A variable that ends with an underscore gets a number.
        """
        self.lines: list[str] = []
        self._statements, self._counts = dict(statements), {prefix: count(1) for prefix in statements.values()}

    def stand_in(self, source: str) -> "StandIn":
        """Return a stand-in for an object, such as a module; `source` is the object's name in the script."""
        return StandIn(self, source)

    def comment(self, text: str) -> None:
        self.lines.append(f"# {in_a_sentence(text)}")

    def record_call(self, source: str, text: str) -> "StandIn":
        """Record a call by the rules of `__init__`, and return the stand-in for its result.

        Args:
            source: the expression for the function.
            text: the expression for the whole call.
        """
        name = source.rpartition(".")[2]
        if name not in self._statements:
            if not COMMAND.match(name):
                return StandIn(self, text)
            self.lines.append(text)
            return StandIn(self, "None")
        prefix = self._statements[name]
        variable = f"{prefix}{next(self._counts[prefix])}" if prefix.endswith("_") else prefix  # such as node_1, node_2, ...
        self.lines.append(f"{variable} = {text}")
        return StandIn(self, variable)


class StandIn:
    """A substitute for an object of the library, which records calls; `_source` is the expression for the object in the script."""

    _script: Script
    _source: str

    def __init__(self, script: Script, source: str):
        # not `self._script = script`, which __setattr__ would record
        object.__setattr__(self, "_script", script)
        object.__setattr__(self, "_source", source)

    def __getattr__(self, name: str) -> "StandIn":
        if name.startswith("__"):  # numpy looks for such attributes; a stand-in has none of them
            raise AttributeError(name)
        return StandIn(self._script, f"{self._source}.{name}")

    def __setattr__(self, name: str, value: Any) -> None:
        self._script.lines.append(f"{self._source}.{name} = {python(value)}")

    def __call__(self, *positional: Any, **named: Any) -> "StandIn":
        """Record a call, and return the stand-in for its result."""
        arguments = [*map(python, positional), *(f"{key}={python(x)}" for key, x in named.items())]
        return self._script.record_call(self._source, f"{self._source}({', '.join(arguments)})")

    def __getitem__(self, index: Any) -> "StandIn":
        return StandIn(self._script, f"{self._source}[{python(index)}]")

    def __add__(self, other: Any) -> "StandIn":
        return StandIn(self._script, f"{self._source} + {python(other)}")

    def __mul__(self, other: Any) -> "StandIn":
        return StandIn(self._script, f"{self._source} * {python(other)}")

    def __rtruediv__(self, other: Any) -> "StandIn":
        return StandIn(self._script, f"{python(other)} / {self._source}")

    def __repr__(self) -> str:
        return self._source


def python(x: Any) -> str:
    """Return a value as Python source in ASCII; a TypeError for a value without source, such as a function."""
    if isinstance(x, StandIn):
        return x._source
    if isinstance(x, np.ndarray):
        return f"np.array({python(x.tolist())})"
    if isinstance(x, (list, tuple)):
        return f"[{', '.join(map(python, x))}]"
    x = x.item() if isinstance(x, np.generic) else x
    if x is None or isinstance(x, (str, bool, int, float)):
        return ascii(x)
    raise TypeError(f"a script cannot hold {type(x).__name__}")


def name_laws(mechanism: Mechanism) -> dict[int, StandIn]:
    """Return id() of a driver's motion law -> the script's function for it: law_1, law_2, ..., in the order of the drivers."""
    return {id(d.law): Script({}).stand_in(f"law_{k}") for k, d in enumerate(mechanism.drivers, 1)}
