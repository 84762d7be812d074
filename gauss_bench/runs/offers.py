"""The settings and integrators that engines offer, and checks of the durations, steps and budgets of runs.

An engine describes itself by an `Offer`. Adapters of this package do so in this process, plug-ins in a worker. If an engine aborts,
hangs, cannot be imported or lacks a member, its description has the reason.
"""

import math
import platform
import sys
import threading
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from gauss_bench.engines import COMPILED, ELSEWHERE, OWN, all_names, environment_of, get, is_class, not_installed, unknown
from gauss_bench.engines import SAFE as SAFE  # re-exported
from gauss_bench.engines.base import CHOSEN, NOT_TOLD, Choice, Variant, ask, has_own, list_lacking
from gauss_bench.engines.own_options import OptionError, OptionTable, is_assignment
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.runs.worker import MEMORY, Interpreter, Worker, WorkerFailure, get_worker
from gauss_bench.trajectory import Status, in_a_sentence
from gauss_bench.untrusted import BadInput

LIMIT = 30.0  # [s] limit for importing and describing an engine; the slowest library takes 3 s
NOT_INSTALLED = "not installed"
ALIASES = {"euler": "semi_implicit_euler"}
METHODS = ("in_python", "build_once", "program")  # optional methods, which only some engines have
MOST_STEPS = 1e10  # largest number of steps of a run; they take an hour with the quickest compiled step
MOST_SAMPLES = 5e6  # largest number of samples of a run: the states of a four-bar take half a GiB, and so does each copy
SPACING = 1e-3  # [s] usual time between two samples; if the step is longer, there is one sample a step


class ChoiceError(BadInput, ValueError):
    """Raised for a setting, integrator, stabilisation or time that an engine or a run does not accept."""


@dataclass(frozen=True)
class Offer:
    """The description that an engine gives of itself.

    Attributes:
        name: name of the engine.
        version: the version of the engine's library, or "not installed".
        settings: label -> options; the first is the default.
        variants: name -> variant, in the order of searches; the name of a variant may be given in place of settings.
        integrators: the first is the default; empty if the engine does not describe itself.
        stabilizations: "none" and the others that the engine offers.
        adaptive: the integrators that choose their own steps.
        options: options that can be set one by one -> words that are allowed as values.
        knobs: name of a knob -> its meaning and the address of its documentation.
        first: variants that are tried first if time is short.
        soft: settings and variants that keep J a = gamma only approximately -> cause.
        unfinished: variants whose solver stops before it has converged -> cause.
        native_loop, python_loop: as in engines.base.
        methods: those of METHODS that the engine has.
        library_calls: names of the calls of its library that can be timed.
        packages: package -> version, of the packages that the engine names for the provenance of a run.
        environment: version and path of the engine's interpreter if it has an environment of its own, else empty.
        status, reason: OK, or the reason why the engine cannot be used.
    """

    name: str
    version: str = ""
    settings: dict[str, dict[str, Any]] = field(default_factory=dict)
    variants: dict[str, Variant] = field(default_factory=dict)
    integrators: tuple[str, ...] = ()
    stabilizations: tuple[str, ...] = ()
    adaptive: tuple[str, ...] = ()
    options: dict[str, tuple[str, ...]] = field(default_factory=dict)
    knobs: dict[str, tuple[str, str]] = field(default_factory=dict)
    first: tuple[str, ...] = ()
    soft: dict[str, str] = field(default_factory=dict)
    unfinished: dict[str, str] = field(default_factory=dict)
    native_loop: bool = False
    python_loop: bool = False
    methods: tuple[str, ...] = ()
    library_calls: tuple[str, ...] = ()
    packages: dict[str, str] = field(default_factory=dict)
    environment: str = ""
    status: Status = Status.OK
    reason: str = ""

    @property
    def usable(self) -> bool:
        """True if the engine is installed and describes itself."""
        return self.status is Status.OK

    def choose(self, settings: str | None, integrator: str | None, stabilization: str | None, step: float) -> Choice:
        """Return the choice for a run, with the engine's defaults for everything that is not given.

        Raises:
            ChoiceError: the engine does not offer the choice; the message names the choices that it offers.
        """
        check_positive("the step", step)
        if not self.integrators:  # an engine that cannot be used: the run will report why
            return Choice(settings or "default", integrator or "", stabilization or "none", step)
        variant = self.variants.get(settings or "")  # named settings may have an integrator and a stabilisation of their own
        usual = variant.integrator if variant else self.integrators[0]
        integrator = integrator.lower() if integrator else usual
        if integrator not in self.integrators:
            integrator = ALIASES.get(integrator, integrator)
        stabilization = stabilization or (variant.stabilization if variant else "none")
        chosen = Choice(settings or next(iter(self.settings)), integrator, stabilization, step)
        self.resolve_settings(chosen.settings)  # raises if the engine does not have them
        offered = {"integrator": self.integrators, "stabilization": self.stabilizations}
        for kind, names in offered.items():
            if getattr(chosen, kind) not in names:
                raise ChoiceError(f"{self.name} has no {kind} {getattr(chosen, kind)!r}; it offers {', '.join(names)}")
        return chosen

    def choose_tolerance(self, choice: Choice, tolerance: float | None) -> Choice:
        """Return a copy of `choice` with a relative tolerance, or `choice` itself if the tolerance is None.

        Raises:
            ChoiceError: the tolerance is not positive, or the integrator takes equal steps.
        """
        if tolerance is None:
            return choice
        check_positive("the tolerance", tolerance, "")
        # an engine that is not usable has not said which of its integrators choose their steps; the run will report why
        if self.usable and choice.integrator not in self.adaptive:
            adaptive = [x for x in self.integrators if x in self.adaptive]
            others = f"those that do are {', '.join(adaptive)}" if adaptive else "none of its integrators does"
            raise ChoiceError(f"{self.name}: {choice.integrator} does not choose its steps by a tolerance; {others}")
        return replace(choice, tolerance=tolerance)

    def resolve_settings(self, text: str) -> dict[str, Any]:
        """Return option -> value for a text: the name of settings or of a variant, options KEY=VALUE, or a name and then options.

        Raises:
            ChoiceError: the engine does not know the settings or options in the text; the message names those that it knows.
        """
        labels = {**self.settings, **{k: x.options for k, x in self.variants.items()}}
        if text not in labels and not is_assignment(text):
            own = f"; or its own options: {OptionTable(self.settings, self.options).describe()}" if self.options else ""
            raise ChoiceError(f"{self.name} has no settings {text!r}; it offers {', '.join(labels)}{own}")
        try:
            return OptionTable(labels, self.options).resolve(text)
        except (OptionError, KeyError) as error:
            raise ChoiceError(f"{self.name}: {error.args[0]}") from error


def in_python(name: str, mechanism: Mechanism, choice: Choice) -> str:
    """Name the Python code that runs besides the library while an engine is timed; NOT_TOLD if the engine does not say."""
    environment = environment_of(name)
    # an adapter that is part of this package is called without a worker
    if name in SAFE or (environment is not None and environment.class_name == ELSEWHERE.get(name)):
        return in_python_there(name, mechanism, choice)
    if not has_method(name, "in_python"):
        return NOT_TOLD
    try:
        worker = get_worker(name).under(interpreter_of(name))
        return in_a_sentence(worker.call(in_python_there, (name, mechanism, choice), LIMIT))
    except WorkerFailure:
        return NOT_TOLD


def has_method(name: str, method: str) -> bool:
    """Tell whether an engine has one of METHODS; an unknown engine has none."""
    try:
        return method in offer(name).methods
    except KeyError:
        return False


def in_python_there(name: str, mechanism: Mechanism, choice: Choice) -> str:
    """Return the same text as `in_python`, by calling the engine's method in this process."""
    return str(ask(get(name), "in_python")(mechanism, choice))


def is_isolated(name: str) -> bool:
    """Tell whether an engine runs in a worker process: all but the suite's own formulations."""
    return name not in (*OWN, *COMPILED)


def interpreter_of(name: str) -> Interpreter:
    """Return the interpreter under which an engine runs: that of its own environment, or that of this process."""
    environment = environment_of(name)
    if environment is None:
        return Interpreter()
    return Interpreter(environment.python, environment.memory or MEMORY)


_known: dict[str, Offer] = {}  # name of an engine that this process has asked -> its description
_lock = threading.Lock()


def offer(name: str) -> Offer:
    """Return the description of an engine, or the reason why it cannot be used; a process asks each engine only once.

    Raises:
        KeyError: there is no such engine.
    """
    return offers([name])[0]


def offers(wanted: Sequence[str] | None = None) -> list[Offer]:
    """Return the descriptions of the engines with these names, each once, or of all engines.

    Adapters of this package (SAFE) are asked in this process, all other engines in a worker.

    Raises:
        KeyError: there is no such engine.
        TypeError: `wanted` is a single text, or has an entry that is not a text.
    """
    if isinstance(wanted, str) or not all(isinstance(name, str) for name in wanted or ()):
        raise TypeError(f"engines must be a list of names, not {wanted!r}")
    if wanted is None or any(name not in _known for name in wanted):
        existing = all_names()  # slow: it looks through all installed packages
        wanted = existing if wanted is None else wanted
        for name in wanted:
            if name not in existing and not is_class(name):
                raise unknown(name)
    with _lock:
        not_asked = [name for name in wanted if name not in _known]
        isolated = [name for name in not_asked if name not in SAFE]
        _known.update({name: describe(name) for name in not_asked if name in SAFE})
        if len(isolated) == 1:  # an engine that is asked alone will probably run next, in the same worker
            _known[isolated[0]] = _ask(get_worker(isolated[0]), isolated[0])
        elif isolated:
            with Worker() as worker:
                _known.update({name: _ask(worker, name) for name in isolated})
        return [_known[name] for name in dict.fromkeys(wanted)]


def offers_from_outside() -> list[Offer]:
    """Return the descriptions of plug-ins and of engines of other environments."""
    return offers([name for name in all_names() if name not in SAFE])


def _ask(worker: Worker, name: str) -> Offer:
    """Ask an engine in a worker to describe itself; if the worker crashes, the description contains the reason."""
    try:
        return _read_offer(name, worker.under(interpreter_of(name)).call(_describe, (name,), LIMIT))
    except WorkerFailure as failure:
        environment = environment_of(name)
        where = environment.python if environment else ""
        return Offer(name, "cannot be used", environment=where, status=failure.status, reason=str(failure))


def _describe(name: str) -> dict[str, Any]:
    """Return the result of `describe` as plain data, with the interpreter if the engine has an environment of its own."""
    where = f"Python {platform.python_version()} at {sys.executable}" if environment_of(name) else ""
    return asdict(replace(describe(name), environment=where))


def _read_offer(name: str, answer: object) -> Offer:
    """Return the description in a worker's answer or, if the answer is not valid, a description with the reason."""
    from pydantic import TypeAdapter, ValidationError  # imported here, because the process of an engine does not need it

    try:
        offer = TypeAdapter(Offer).validate_python(answer)
    except ValidationError:
        return _reject(name, TypeError("its description is not valid"))
    names = (*offer.settings, *offer.integrators, *offer.stabilizations, *offer.adaptive, *offer.library_calls)
    words = (offer.version, offer.reason, offer.environment, *names, *offer.packages, *offer.packages.values())
    unprintable = [word for word in words if not word.isprintable()]
    if unprintable:
        return _reject(name, TypeError(f"it reports {ascii(unprintable[0])[:80]}, which is not printable"))
    if offer.usable and not (offer.settings and offer.integrators and offer.stabilizations):
        return _reject(name, TypeError("it does not describe itself"))
    return replace(offer, name=name)


def describe(name: str) -> Offer:
    """Ask an engine in this process to describe itself; an error becomes the description of an unusable engine."""
    try:
        engine: Any = get(name)
    except ImportError as error:
        return Offer(name, NOT_INSTALLED, status=Status.SKIP, reason=not_installed(error))
    except Exception as error:
        return _reject(name, error)
    try:
        if lacking := list_lacking(engine):
            raise TypeError(f"it has no method {', '.join(lacking)}")
        for word, value in (("integrators", engine.integrators), ("stabilizations", engine.stabilizations)):
            if isinstance(value, str):
                raise TypeError(f"{word} is a string, not a list")
        if not isinstance(engine.settings, Mapping) or not all(isinstance(x, Mapping) for x in engine.settings.values()):
            raise TypeError("settings is not a dict of dicts")
        knobs = {str(k): x for k, x in dict(ask(engine, "knobs")).items()}  # plug-ins may leave out all attributes of a knob
        # options that can be set alone are the knobs or, without knobs, the names in `options`
        values = {k: tuple(map(str, getattr(x, "values", ()))) for k, x in knobs.items()}
        offer = Offer(
            name,
            settings={str(k): _plain_options(v) for k, v in dict(engine.settings).items()},
            variants={
                str(k): Variant(str(k), str(x.integrator), str(x.stabilization), _plain_options(x.options))
                for k, x in dict(ask(engine, "variants")).items()
            },
            integrators=tuple(map(str, engine.integrators)),
            stabilizations=tuple(map(str, engine.stabilizations)),
            adaptive=tuple(map(str, ask(engine, "adaptive"))),
            options={k: x for k, x in values.items() if k not in CHOSEN} or dict.fromkeys(map(str, ask(engine, "options")), ()),
            knobs={
                k: (in_a_sentence(getattr(x, "meaning", "")), in_a_sentence(getattr(x, "source", ""))) for k, x in knobs.items()
            },
            first=tuple(map(str, ask(engine, "first"))),
            soft={str(k): in_a_sentence(x) for k, x in dict(ask(engine, "soft")).items()},
            unfinished={str(k): in_a_sentence(x) for k, x in dict(ask(engine, "unfinished")).items()},
            native_loop=bool(engine.native_loop),
            python_loop=bool(engine.python_loop),
            methods=tuple(x for x in METHODS if has_own(engine, x)),
            library_calls=tuple(map(str, ask(engine, "library_calls"))),
            packages=_find_versions(ask(engine, "packages")),
        )
        for word in ("settings", "integrators", "stabilizations"):
            if not getattr(offer, word):
                raise TypeError(f"it offers no {word}")
    except Exception as error:
        return _reject(name, error)
    try:
        version = engine.version()
        version = in_a_sentence(version) if isinstance(version, str) else f"unknown ({type(version).__name__}, not a text)"
    except ImportError as error:
        return replace(offer, version=NOT_INSTALLED, status=Status.SKIP, reason=not_installed(error))
    except Exception as error:
        version = f"unknown ({type(error).__name__}: {in_a_sentence(error)})"
    return replace(offer, version=version)


def _reject(name: str, error: Exception) -> Offer:
    """Return the description of an engine that cannot be used because of an error."""
    return Offer(name, "cannot be used", status=Status.ERROR, reason=f"{type(error).__name__}: {in_a_sentence(error)}")


def _find_versions(packages: Sequence[str]) -> dict[str, str]:
    """Return package -> version as installed in this process's environment, or "not installed".

    Raises:
        TypeError: `packages` is a single text.
    """
    if isinstance(packages, str):
        raise TypeError("packages is a string, not a list")
    if not packages:
        return {}
    from importlib.metadata import PackageNotFoundError, version  # slow to import, and most engines name no packages

    versions = {}
    for package in map(str, packages):
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            versions[package] = NOT_INSTALLED
    return versions


def _plain_options(options: Mapping[object, object]) -> dict[str, Any]:
    """Return option -> value as plain data; a value of another type is replaced by its text."""

    def plain(value: object) -> object:
        if isinstance(value, (list, tuple)):
            return [plain(x) for x in value]
        return value if isinstance(value, (str, int, float, bool, type(None))) else str(value)

    return {str(k): plain(x) for k, x in dict(options).items()}


def check_positive(name: str, value: float, unit: str = " of seconds") -> None:
    """Check that a number is positive and finite.

    Raises:
        ChoiceError: the number is not; the message begins with its name.
    """
    if not (math.isfinite(value) and value > 0):
        raise ChoiceError(f"{name} must be a positive number{unit}, not {value:g}")


def duration(own: float, suite: float | None = None, until: float | None = None) -> float:
    """Return the duration of a run [s]: `until` if given, else `suite` if a suite lists the linkage, else the scenario's `own`.

    Raises:
        ChoiceError: the duration is not a positive time, or too long.
    """
    most = MOST_SAMPLES * SPACING
    if until is not None and until > most:
        raise ChoiceError(f"the end of a run must be at most {most:g} s, not {until:g}: more samples are not kept")
    end = next(x for x in (until, suite, own) if x is not None)
    check_positive("the end of a run", end)
    return end


def check_size(step: float, t_end: float) -> None:
    """Check that a run until `t_end` has neither too many equal steps nor too many samples, SPACING or a longer step apart [s].

    Raises:
        ChoiceError: the run is too large; the message states its number of steps or samples.
    """
    with np.errstate(all="ignore"):  # the quotients overflow for tiny steps
        steps, samples = np.float64(t_end) / np.float64(step), np.float64(t_end) / np.float64(max(step, SPACING))
    if not steps <= MOST_STEPS:
        raise ChoiceError(f"{steps:.2g} steps of {step:g} s up to {t_end:g} s; at most {MOST_STEPS:.0e} are allowed")
    if not samples <= MOST_SAMPLES:
        raise ChoiceError(f"{samples:.2g} samples up to {t_end:g} s; at most {MOST_SAMPLES:.0e} are kept")


def check_affordable(step: float, t_end: float, seconds_a_step: float, budget: float) -> None:
    """Check that a run until `t_end` [s] can end within its budget [s] if each of its steps takes at least `seconds_a_step` [s].

    Raises:
        ChoiceError: the steps take longer than the budget; the message states the least time that they need.
    """
    check_size(step, t_end)
    least = t_end / step * seconds_a_step
    if least > budget:
        advice = "take longer steps, an earlier end or a larger budget"
        raise ChoiceError(f"{t_end / step:.2g} steps take {least:.2g} s at least, and the budget is {budget:g} s: {advice}")


def usable_steps(steps: Sequence[float], t_end: float) -> tuple[float, ...]:
    """Return the distinct steps [s], from large to small.

    Raises:
        ChoiceError: a step is not positive, longer than the run, or so small that the run has more steps than are allowed.
    """
    for step in steps:
        check_positive("the step", step)
        check_size(step, t_end)
        if step > t_end * (1 + 1e-12):
            raise ChoiceError(f"the step {step:g} s is longer than the run of {t_end:g} s")
    return tuple(sorted(set(steps), reverse=True))


def check_budget(seconds: float | None, usual: float) -> float:
    """Return the longest time [s] that one case may take: the user's or, if the user gives none, the `usual` one.

    Raises:
        ChoiceError: the user's budget is not positive and finite.
    """
    if seconds is None:
        return usual
    check_positive("the budget", seconds)
    return seconds
