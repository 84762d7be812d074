"""The context that all tasks of a run share: where references are kept, and what their answers depend on."""

import hashlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

from gauss_bench.bench.tasks import LIMIT, Tables, Task, patient, place_of
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.runs.apart import Alteration, is_unaltered
from gauss_bench.suites.schema import OnLinkages

CASE_LIMIT = 120.0  # [s] the slowest case of the suites takes 10 s on a slow core


@dataclass(frozen=True)
class Context:
    """A run's surroundings.

    Attributes:
        store: folder of the references.
        stamp: digest of the code, the libraries and the certificates.
        alter: a fault that is planted in what engines are given.
        until, steps: [s] what a user asks for instead of the suite's.
        limit: [s] that one case may take.
    """

    store: str
    stamp: str
    alter: Alteration = is_unaltered
    until: float | None = None
    steps: tuple[float, ...] | None = None
    limit: float = CASE_LIMIT
    _loaded: dict[tuple[str, str], Mechanism] = field(default_factory=dict, repr=False, compare=False)

    def mechanism(self, linkage: str, scenario: str) -> Mechanism:
        """A linkage, read once in a run: hundreds of tasks ask for the same few."""
        if (linkage, scenario) not in self._loaded:
            self._loaded[linkage, scenario] = load(linkage, scenario or None)
        return self._loaded[linkage, scenario]

    def each(self, parts: Iterable[OnLinkages], table: str, function: Callable[..., Tables]) -> list[Task]:
        """A task function(linkage, scenario, part) for each linkage of some parts of a suite."""
        tasks = []
        for part in parts:
            asked = part.model_copy(update={"linkages": {}})
            for place in part.linkages.items():
                task = self.task(table, function, (*place, asked), *place)
                races = getattr(part, "processes", 0)  # of those that race, one after the other
                tasks.append(patient(task, races) if races else task)
        return tasks

    def task(
        self,
        table: str,
        function: Callable[..., Tables],
        arguments: tuple[Any, ...],
        linkage: str = "",
        scenario: str = "",
        seen: str = "",
        **names: Any,
    ) -> Task:
        """A task that fills a table; `names` begin the row that tells of its failure, `seen` is what else it depends on.

        What every task is given besides, the store, the alteration and the limit, does not name it.
        """
        told = [repr(x) for x in arguments if not any(x is y for y in (self.store, self.alter, self.limit))]
        digest = hashlib.sha256("\n".join([*told, seen]).encode()).hexdigest()[:16]
        start: dict[str, Any] = dict(names)
        stamp = self.stamp
        if linkage:
            mechanism = self.mechanism(linkage, scenario)
            start = place_of(mechanism) | start
            stamp = f"{stamp}.{mechanism.sha256[:16]}"
        key = "|".join([table, function.__name__, linkage, scenario, *map(str, names.values()), digest])
        limit = self.limit if table == "results" else LIMIT
        return Task(key, function, arguments, stamp, table, start, limit)
