"""Run a sweep: plan the samples, run batches by joblib, store them in a folder and summarise them."""

import json
import os
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, TypedDict

import numpy as np

from gauss_bench.atomic import write_text
from gauss_bench.bench.journal import fingerprint
from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.linkage.load import choose_scenario, document_of, load, reduce_to_scenario
from gauss_bench.runs.offers import check_budget, duration, is_isolated, offer
from gauss_bench.sweep.batch import Rows, SweepCase, family, in_batches, kernel, rows_of
from gauss_bench.sweep.errors import SweepError
from gauss_bench.sweep.figures import units
from gauss_bench.sweep.folder import PICTURE, SIGN, Folder, check
from gauss_bench.sweep.halving import halve
from gauss_bench.sweep.paths import number_at
from gauss_bench.sweep.plan import PLANS, Plan, plan
from gauss_bench.sweep.plots import plots
from gauss_bench.sweep.summary import EngineSummary, summary
from gauss_bench.terms import Array

FORM = "sweep/1"  # format of the folder
BATCH, SINGLES = 512, 8  # largest numbers of samples in a task: for engines that run a batch in one call, and for all others
BACKENDS = ("local", "dask")
PAUSE = 5.0  # [s] between lines of progress
LIMIT = 60.0  # [s] default of the time of one sample in a worker
MOST_STEPS = 1e8  # largest number of steps of one sample
STEP = 1e-3  # [s] default step
EIGHTH_ORDER, EIGHTH_ORDER_STEP = "dop853_fixed", 2e-3  # default integrator and step [s] of engines that run batches
FIRST = 3.0  # [s] limit for finding a scheduler
Tell = Callable[[str], None]


@dataclass(frozen=True)
class Backend:
    """The processes that run batches.

    Attributes:
        backend: "local" for threads or processes of this machine, or "dask".
        scheduler: address of Dask's scheduler; if it is None, a scheduler is started on this machine.
        jobs: number of threads, processes, or workers of a scheduler that is started.
    """

    backend: str = "local"
    scheduler: str | None = None
    jobs: int = 2


@dataclass(frozen=True)
class Options:
    """The setting with which each sample is simulated; None stands for the default.

    Engines that simulate a batch of samples in one call have the default integrator EIGHTH_ORDER with steps of EIGHTH_ORDER_STEP.
    For all other engines the default is the first integrator that the engine offers, with steps of STEP.

    Attributes:
        scenario: name of the scenario; settings, integrator, stabilization: names that the engines offer.
        step: integration step [s].
        until: end of each motion [s].
        limit: longest time of one sample in a worker [s].
    """

    scenario: str | None = None
    settings: str | None = None
    integrator: str | None = None
    stabilization: str | None = None
    step: float | None = None
    until: float | None = None
    limit: float | None = None


class SweepSummary(TypedDict):
    """The summary of a sweep.

    Attributes:
        linkage, scenario: names of the linkage and scenario.
        samples: number of samples of each engine.
        until: end of the runs [s].
        paths: paths of the varied numbers.
        sampling: "sobol", or "random" for grids and random values.
        engines: name of an engine -> summary of its samples.
    """

    linkage: str
    scenario: str
    samples: int
    until: float
    paths: list[str]
    sampling: str
    engines: dict[str, EngineSummary]


def sweep(
    linkage: str,
    vary: Sequence[str],
    out: Path,
    engines: Sequence[str] = ("gauss-native",),
    samples: int | None = None,
    sampling: str = "random",
    seed: int = 0,
    how: Options = Options(),
    where: Backend = Backend(),
    tell: Tell = lambda sentence: None,
) -> SweepSummary:
    """Simulate a linkage with many values of some of its numbers, store rows and summary in a folder, and return the summary.

    Args:
        linkage: name of a built-in linkage, or a path.
        vary: varied numbers, each as PATH=VALUES (`plan.py`).
        out: path of the folder. If it contains batches of the same sweep, only the missing batches are run.
        samples, sampling, seed: arguments of `plan`.
        how: setting of each sample.
        where: processes that run batches.
        tell: called with each sentence of progress.

    Raises:
        LinkageError, SweepError, ChoiceError, KeyError: an argument cannot be used, and nothing is written.
        Busy: another sweep writes into the folder.
    """
    if sampling not in PLANS:
        raise SweepError(f"--sampling is one of {', '.join(PLANS)}")
    if where.backend not in BACKENDS:
        raise SweepError(f"--backend is one of {', '.join(BACKENDS)}")
    if where.jobs < 1:
        raise SweepError(f"--jobs {where.jobs}: must be at least 1")
    if where.scheduler and where.backend != "dask":
        raise SweepError("--scheduler: needs --backend dask")
    if not engines or len(set(engines)) < len(engines):
        raise SweepError("--engine: name each engine once")
    samples_plan = plan(vary, samples, sampling, seed)
    case = _case(linkage, samples_plan, engines, how, where.jobs)
    nominal = family(case).nominal
    units_by_figure = units(nominal)  # name of a figure (a number that is computed from each motion) -> its unit
    stamp = _stamp(case, vary, samples_plan, sampling, seed)
    check(out, stamp)  # before the kernels are compiled, which takes long
    for engine in filter(in_batches, engines):
        inputs = ", ".join(kernel(case, engine).parameters)  # `kernel` compiles the kernel, which all batches share
        tell(f"{engine}: compiled a kernel with the inputs {inputs or '(none)'}")
    with Folder(out, stamp, dict.fromkeys(samples_plan.paths, "") | units_by_figure) as folder:
        _run(folder, case, samples_plan, engines, where, tell)
        rows = folder.read()
    tell("repeating some samples at half the step")
    by_engine = summary(rows, samples_plan, list(units_by_figure))
    for engine in engines:
        by_engine[engine]["half_the_step"] = halve(case, engine, rows[rows["engine"] == engine], samples_plan.values)
    result: SweepSummary = {
        "linkage": nominal.name,
        "scenario": case.scenario,
        "samples": len(samples_plan.values),
        "until": case.until,
        "paths": list(samples_plan.paths),
        "sampling": "sobol" if samples_plan.base else "random",
        "engines": by_engine,
    }
    write_text(out / PICTURE, plots(rows, samples_plan, list(units_by_figure)) + SIGN)
    write_text(out / "summary.json", json.dumps(result, indent=1) + "\n")
    return result


def _case(linkage: str, samples: Plan, engines: Sequence[str], how: Options, jobs: int) -> SweepCase:
    """Return the data that all samples of a sweep share.

    Raises:
        SweepError, ChoiceError: an engine, a path or a number cannot be used.
    """
    document, _, path = document_of(linkage)
    scenario = choose_scenario(document, how.scenario, str(path), path.stem)
    mechanism, document = load(linkage, scenario), reduce_to_scenario(document, scenario)
    for name in samples.paths:
        number_at(document, name)  # raises SweepError if there is no number
    until = duration(mechanism.duration, None, how.until)
    if how.step is not None and not (np.isfinite(how.step) and 0 < how.step <= until * (1 + 1e-12)):
        raise SweepError(f"--step {how.step:g}: must be positive and at most the {until:g} s of a run")
    choices = tuple((name, _choice(name, how, until)) for name in engines)
    count = max(until / choice.step for _, choice in choices)
    if count > MOST_STEPS:
        option = f"--until {until:g}" if how.step is None else f"--step {how.step:g}"
        raise SweepError(f"{option}: {count:.1e} steps per sample; at most {MOST_STEPS:.0e} are allowed")
    for name, choice in choices:  # an engine that runs in a process of its own is not loaded here, but checked in its process
        reason = "" if is_isolated(name) else get(name).skip(mechanism, choice)
        if reason:
            raise SweepError(f"--engine {name}: {reason}")
    limit = check_budget(how.limit, LIMIT)
    return SweepCase(json.dumps(document), scenario, str(path), samples.paths, until, choices, limit, jobs)


def _choice(engine: str, how: Options, until: float) -> Choice:
    """Return the setting of an engine, with the defaults that `Options` describes, and no default step longer than `until` [s].

    Raises:
        SweepError, ChoiceError: the engine cannot be used, or does not offer the setting.
    """
    offered = offer(engine)
    integrator = EIGHTH_ORDER if in_batches(engine) and not (how.integrator or how.settings) else how.integrator
    # the default step depends on the integrator that `choose` selects: STEP is a placeholder here
    choice = offered.choose(how.settings, integrator, how.stabilization, STEP if how.step is None else how.step)
    if not offered.usable:
        raise SweepError(f"--engine {engine}: {offered.reason}")
    if in_batches(engine) and choice.integrator == "dop853":
        raise SweepError(f"--integrator dop853: {engine} steps a batch by rk4, semi_implicit_euler or dop853_fixed")
    default = EIGHTH_ORDER_STEP if in_batches(engine) and choice.integrator == EIGHTH_ORDER else STEP
    return replace(choice, step=min(until, default) if how.step is None else how.step)


def _stamp(case: SweepCase, vary: Sequence[str], samples: Plan, sampling: str, seed: int) -> dict[str, Any]:
    """Return all data on which the rows of a sweep's table depend, as values that JSON can store."""
    return {
        "form": FORM,
        "linkage": family(case).nominal.digest,
        "scenario": case.scenario,
        "vary": [text.replace(" ", "") for text in vary],
        "samples": len(samples.values),
        "sampling": sampling,
        "seed": seed,
        "until": case.until,
        "engines": {name: asdict(choice) for name, choice in case.choices},
        "limit": case.limit,
        "made_by": fingerprint(),
    }


@dataclass(frozen=True)
class _Batch:
    """One task of a sweep: the samples `first` to `end` - 1, simulated by one engine and stored as the part `number`."""

    number: int
    engine: str
    first: int
    end: int

    @property
    def size(self) -> int:
        """Number of samples in the batch."""
        return self.end - self.first


def _batches(count: int, engines: Sequence[str]) -> Iterator[_Batch]:
    """Yield the batches of all samples, engine by engine."""
    number = 0
    for engine in engines:
        size = BATCH if in_batches(engine) else SINGLES
        for first in range(0, count, size):
            yield _Batch(number, engine, first, min(count, first + size))
            number += 1


def _run(folder: Folder, case: SweepCase, samples: Plan, engines: Sequence[str], where: Backend, tell: Tell) -> None:
    """Run those batches of samples whose rows are not yet stored in the folder, and store their rows."""
    from joblib import Parallel, delayed

    batches = list(_batches(len(samples.values), engines))
    waiting = [x for x in batches if not folder.has(x.number, x.size)]
    if stored := len(batches) - len(waiting):
        tell(f"{stored} of {len(batches)} batches are stored already")
    if not waiting:
        return
    total, missing = sum(x.size for x in batches), sum(x.size for x in waiting)
    tell(f"{missing} samples to run")
    last_report, started, done = time.monotonic(), time.monotonic(), total - missing
    jobs = -1 if where.backend == "dask" else where.jobs  # a cluster uses all of its workers
    with _use_backend(where, engines):
        # dispatch no more tasks than fit into the queue of loky's processes: with more, the queue's thread fails on an interrupt
        work = Parallel(n_jobs=jobs, return_as="generator_unordered", batch_size=1, pre_dispatch="2*n_jobs")
        # the rows of a batch are sent back to this process, which writes them
        tasks = (delayed(_run_batch)(case, x, samples.values[x.first : x.end]) for x in waiting)
        with warnings.catch_warnings(), closing(work(tasks)) as finished:
            # after an interrupt, joblib's warning of unfinished tasks tells the user nothing new
            warnings.filterwarnings("ignore", ".*adjusting the input task iterator", UserWarning)
            for batch, rows in finished:
                folder.write(batch.number, rows)
                done += batch.size
                if time.monotonic() - last_report > PAUSE:
                    last_report = time.monotonic()
                    tell(f"{done} of {total} samples, {last_report - started:.0f} s")


def _run_batch(case: SweepCase, batch: _Batch, values: Array) -> tuple[_Batch, Rows]:
    """Simulate a batch of samples, and return the batch and its rows of the sweep's table; joblib calls this in a worker."""
    return batch, rows_of(case, batch.engine, np.arange(batch.first, batch.end), values)


def _end_with_parent(parent: int) -> None:
    """End this process when the process that started it, with the id `parent`, ends.

    Otherwise joblib's processes would run for minutes after their parent was killed.
    """

    def watch() -> None:
        """Wait until this process has another parent, because its parent has ended, and then end this process."""
        while os.getppid() == parent:
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _use_backend(where: Backend, engines: Sequence[str]) -> Iterator[None]:
    """Let joblib use Dask if `where` names it, else threads if all engines compute outside of Python, else processes."""
    from joblib import parallel_config

    if where.backend == "dask":
        with _client(where) as client, parallel_config(backend="dask", client=client, wait_for_workers_timeout=60):
            yield
    elif all(in_batches(x) or is_isolated(x) for x in engines):
        with parallel_config(backend="threading"):
            yield
    else:
        with parallel_config(backend="loky", inner_max_num_threads=1, initializer=_end_with_parent, initargs=(os.getpid(),)):
            yield


def _client(where: Backend) -> Any:
    """Return a client of a running Dask scheduler, or of new workers on this machine, which end with the client.

    Raises:
        SweepError: no scheduler answers, no worker starts, or Dask is not installed.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise SweepError("--backend dask: needs the packages dask and distributed: pip install 'gauss-bench[cluster]'") from error
    os.environ.setdefault("DASK_DISTRIBUTED__DASHBOARD__LINK", "")
    options = {"n_workers": where.jobs, "threads_per_worker": 1, "host": "127.0.0.1", "dashboard_address": None}
    try:
        return Client(where.scheduler, timeout=FIRST, **({} if where.scheduler else options))  # type: ignore[no-untyped-call]
    except (OSError, TimeoutError, ValueError) as error:
        failure = (
            f"--scheduler {where.scheduler}: no scheduler answers there" if where.scheduler else "--backend dask: no worker started"
        )
        raise SweepError(f"{failure} within {FIRST:g} s") from error
