"""Runs a sweep: plan, folder, batches by joblib, summary. Batches already stored are not run again."""

import json
import os
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gauss_bench.bench.journal import fingerprint
from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.linkage.load import choose_scenario, document_of, load, reduce_to_scenario
from gauss_bench.runs.offers import check_budget, duration, is_isolated, offer
from gauss_bench.sweep.batch import Asked, Rows, columns_of, family, in_batches, kernel, rows_of
from gauss_bench.sweep.errors import SweepError
from gauss_bench.sweep.folder import PICTURE, SIGN, Folder, check
from gauss_bench.sweep.halving import halve
from gauss_bench.sweep.paths import number_at
from gauss_bench.sweep.plan import PLANS, Plan, plan
from gauss_bench.sweep.plots import plots
from gauss_bench.sweep.summary import summary
from gauss_bench.tables import write_text
from gauss_bench.terms import Array

FORM = "sweep/1"
BATCH, SINGLES = 512, 8  # samples of one task: of an engine that takes them in one call, and of every other
BACKENDS = ("local", "dask")
PAUSE = 5.0  # [s] between lines of progress
LIMIT = 60.0  # [s] that one sample may take in a worker
MOST_STEPS = 1e8  # of one sample
STEP = 1e-3  # [s] where none is asked for
EIGHTH_ORDER, ITS_STEP = "dop853_fixed", 2e-3  # of batches: the work of rk4 at half the step, and errors far smaller
FIRST = 3.0  # [s] to find a scheduler
Told = Callable[[str], None]


@dataclass(frozen=True)
class Where:
    """Who runs batches: "local" threads or processes, as many as `jobs`, or "dask", at a scheduler's address or on this machine."""

    backend: str = "local"
    scheduler: str | None = None
    jobs: int = 2


@dataclass(frozen=True)
class How:
    """How each sample is run; None for an engine's own defaults.

    Batches are stepped by DOP853 where no integrator is asked for, and a step is `STEP`, or with DOP853 `ITS_STEP`.
    """

    scenario: str | None = None
    settings: str | None = None
    integrator: str | None = None
    stabilization: str | None = None
    step: float | None = None
    until: float | None = None
    limit: float | None = None


def sweep(
    linkage: str,
    vary: Sequence[str],
    out: Path,
    engines: Sequence[str] = ("gauss-native",),
    samples: int | None = None,
    sampling: str = "random",
    seed: int = 0,
    how: How = How(),
    where: Where = Where(),
    tell: Told = lambda sentence: None,
) -> dict[str, Any]:
    """Run a linkage with many different numbers into a folder, and return the summary that stands there.

    Args:
        linkage: name of a built-in linkage, or a path.
        vary: PATH=VALUES, as in `plan.py`.
        out: the folder. Where it holds the same sweep, what is missing is run.
        samples, sampling, seed: of the plan.
        tell: is called with a sentence on the progress.

    Raises:
        LinkageError, SweepError, ChoiceError, KeyError: what cannot be used; before anything is written.
        Busy: another sweep writes into the folder.
    """
    for wrong, said in (
        (sampling not in PLANS, f"--sampling is one of {', '.join(PLANS)}"),
        (where.backend not in BACKENDS, f"--backend is one of {', '.join(BACKENDS)}"),
        (where.jobs < 1, f"--jobs {where.jobs}: must be at least 1"),
        (where.scheduler and where.backend != "dask", "--scheduler: is for --backend dask"),
        (not engines or len(set(engines)) < len(engines), "--engine: name each engine once"),
    ):
        if wrong:
            raise SweepError(said)
    some = plan(vary, samples, sampling, seed)
    asked = _ask(linkage, some, engines, how, where.jobs)
    nominal = family(asked).nominal
    figures = columns_of(nominal, [])
    columns = columns_of(nominal, some.paths)
    stamp = _stamp(asked, vary, some, sampling, seed)
    check(out, stamp)
    for engine in filter(in_batches, engines):
        left_open = ", ".join(kernel(asked, engine).parameters)  # compiled here, so that nobody else need
        tell(f"{engine}: generated and compiled, with {left_open or 'nothing'} left open")
    with Folder(out, stamp, columns) as folder:
        _run(folder, asked, some, engines, where, tell)
        rows = folder.read()
    tell("some samples again at half the step")
    halves = {engine: halve(asked, engine, rows[rows["engine"] == engine], some.values) for engine in engines}
    told = {"linkage": nominal.name, "scenario": asked.scenario, "samples": len(some.values), "until": asked.until}
    told |= {
        "paths": list(some.paths),
        "sampling": "sobol" if some.base else "random",
        "engines": {x: told | {"half_the_step": halves[x]} for x, told in summary(rows, some, list(figures)).items()},
    }
    write_text(out / PICTURE, plots(rows, some, list(figures)) + SIGN)
    write_text(out / "summary.json", json.dumps(told, indent=1) + "\n")
    return told


def _ask(linkage: str, some: Plan, engines: Sequence[str], how: How, jobs: int) -> Asked:
    document, _, path = document_of(linkage)
    scenario = choose_scenario(document, how.scenario, str(path), path.stem)
    mechanism, document = load(linkage, scenario), reduce_to_scenario(document, scenario)
    for name in some.paths:
        number_at(document, name)
    until = duration(mechanism.duration, None, how.until)
    if how.step is not None and not (np.isfinite(how.step) and 0 < how.step <= until * (1 + 1e-12)):
        raise SweepError(f"--step {how.step:g}: must be positive and at most the {until:g} s of a run")
    choices = tuple((name, _choice(name, how, until)) for name in engines)
    if (count := max(until / choice.step for _, choice in choices)) > MOST_STEPS:
        asked_for = f"--until {until:g}" if how.step is None else f"--step {how.step:g}"
        raise SweepError(f"{asked_for}: {count:.1e} steps a sample; {MOST_STEPS:.0e} are the most")
    for name, choice in choices:
        if not is_isolated(name) and (reason := get(name).skip(mechanism, choice)):
            raise SweepError(f"--engine {name}: {reason}")
    limit = check_budget(how.limit, LIMIT)
    return Asked(json.dumps(document), scenario, str(path), some.paths, until, choices, limit, jobs)


def _choice(engine: str, how: How, until: float) -> Choice:
    offered = offer(engine)
    integrator = EIGHTH_ORDER if in_batches(engine) and not (how.integrator or how.settings) else how.integrator
    choice = offered.choose(how.settings, integrator, how.stabilization, STEP if how.step is None else how.step)
    if not offered.usable:
        raise SweepError(f"--engine {engine}: {offered.reason}")
    if in_batches(engine) and choice.integrator == "dop853":
        raise SweepError(f"--integrator dop853: {engine} steps a batch by rk4, semi_implicit_euler or dop853_fixed")
    usual = min(until, ITS_STEP if in_batches(engine) and choice.integrator == EIGHTH_ORDER else STEP)
    return replace(choice, step=usual if how.step is None else how.step)


def _stamp(asked: Asked, vary: Sequence[str], some: Plan, sampling: str, seed: int) -> dict[str, Any]:
    """Return everything that the rows of a sweep depend on, as plain data."""
    return {
        "form": FORM,
        "linkage": family(asked).nominal.digest,
        "scenario": asked.scenario,
        "vary": [text.replace(" ", "") for text in vary],
        "samples": len(some.values),
        "sampling": sampling,
        "seed": seed,
        "until": asked.until,
        "engines": {name: asdict(choice) for name, choice in asked.choices},
        "limit": asked.limit,
        "made_by": fingerprint(),
    }


class _Batch(NamedTuple):
    """Samples of an engine: the number of their part, the first of them, and the last but one."""

    number: int
    engine: str
    first: int
    end: int


def _batches(count: int, engines: Sequence[str]) -> Iterator[_Batch]:
    number = 0
    for engine in engines:
        size = BATCH if in_batches(engine) else SINGLES
        for first in range(0, count, size):
            yield _Batch(number, engine, first, min(count, first + size))
            number += 1


def _run(folder: Folder, asked: Asked, some: Plan, engines: Sequence[str], where: Where, tell: Told) -> None:
    from joblib import Parallel, delayed

    whole = list(_batches(len(some.values), engines))
    waiting = [x for x in whole if not folder.has(x.number, x.end - x.first)]
    if known := len(whole) - len(waiting):
        tell(f"{known} of {len(whole)} batches are there already")
    if not waiting:
        return
    total, missing = (sum(x.end - x.first for x in batches) for batches in (whole, waiting))
    tell(f"{missing} samples to run")
    told, started, done = time.monotonic(), time.monotonic(), total - missing
    with _spread(where, engines):
        # no more ahead than the queue of loky's processes takes, whose thread fails over the rest where a sweep is interrupted
        work = Parallel(n_jobs=_tasks(where), return_as="generator_unordered", batch_size=1, pre_dispatch="2*n_jobs")
        # its arguments travel to wherever batches are run, its rows come back here and are written here
        tasks = (delayed(_done)(asked, x, some.values[x.first : x.end]) for x in waiting)
        with warnings.catch_warnings(), closing(work(tasks)) as finished:
            # joblib warns of tasks that are left where an interrupt reaches us between two answers: whoever interrupts knows
            warnings.filterwarnings("ignore", ".*adjusting the input task iterator", UserWarning)
            for batch, rows in finished:
                folder.write(batch.number, rows)
                done += batch.end - batch.first
                if time.monotonic() - told > PAUSE:
                    told = time.monotonic()
                    tell(f"{done} of {total} samples, {told - started:.0f} s")


def _done(asked: Asked, batch: _Batch, values: Array) -> tuple[_Batch, Rows]:
    return batch, rows_of(asked, batch.engine, np.arange(batch.first, batch.end), values)


def _end_with(parent: int) -> None:
    """End this process when its parent ends; joblib's processes would otherwise outlive a killed parent by minutes."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _tasks(where: Where) -> int:
    return -1 if where.backend == "dask" else where.jobs


@contextmanager
def _spread(where: Where, engines: Sequence[str]) -> Iterator[None]:
    """joblib's backend: threads where what computes is native code or in workers of its own, else processes; or Dask."""
    from joblib import parallel_config

    with ExitStack() as stack:
        if where.backend == "local":
            if all(in_batches(x) or is_isolated(x) for x in engines):
                backend = parallel_config(backend="threading")
            else:
                backend = parallel_config(backend="loky", inner_max_num_threads=1, initializer=_end_with, initargs=(os.getpid(),))
        else:
            client = stack.enter_context(_client(where, stack))
            backend = parallel_config(backend="dask", client=client, wait_for_workers_timeout=60)
        stack.enter_context(backend)
        yield


def _client(where: Where, stack: ExitStack) -> Any:
    """Dask's client, of a scheduler that is there or of workers on this machine.

    Raises:
        SweepError: there is no scheduler, or Dask is not installed.
    """
    try:
        from distributed import Client, LocalCluster
    except ImportError as error:
        raise SweepError("--backend dask: needs the packages dask and distributed: pip install 'gauss-bench[cluster]'") from error
    os.environ.setdefault("DASK_DISTRIBUTED__DASHBOARD__LINK", "")
    options = {"n_workers": where.jobs, "threads_per_worker": 1, "host": "127.0.0.1", "dashboard_address": None}
    try:
        return Client(where.scheduler or stack.enter_context(LocalCluster(**options)), timeout=FIRST)  # type: ignore[no-untyped-call]
    except (OSError, TimeoutError, ValueError) as error:
        raise SweepError(f"--scheduler {where.scheduler}: no scheduler answers there within {FIRST:g} s") from error
