"""What the tests share: linkages, one with every kind of joint and force and one with a redundant row, and tools they need."""

import os
import shutil
import tempfile
import tomllib
from collections.abc import Iterable, Iterator
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gauss_bench.compiler import user_cache
from gauss_bench.compiler.elimination import program
from gauss_bench.compiler.machine import native_code
from gauss_bench.engines import FILE, environment_of
from gauss_bench.linkage.load import built_in, load, load_document
from gauss_bench.mechanism.model import AngleDriver, Mechanism, SlideDriver
from gauss_bench.mechanism.motion_laws import MotionLaw
from gauss_bench.runs.worker import get_worker

DATA = Path(__file__).parent / "data"
TIMED = ("slow", "long")  # marks of tests that take time; one with arguments marks the cases of these ids alone
DOCUMENTATION = 1.4e6  # bytes that the documentation may take of the 8 MB of the whole site
FEW = 8  # attempts of the search for a program
DEAREST = ("test_studio_page", "test_site", "test_sweep", "test_mutations", "test_isolation", "test_wheel", "test_selftest")
CACHE = pytest.StashKey[str]()
COLLECTED = pytest.StashKey[list[pytest.Function]]()  # whether they are run or not
USERS_CACHE = "GAUSS_BENCH_TESTS_USERS_CACHE"  # in the environment: the cache that a user has


def pytest_configure(config: pytest.Config) -> None:
    """Object code of this run is kept in one folder for all its processes, and the user's own cache is left alone.

    Programs, in this process and in all that it starts, are the best of few attempts, and machine code is what is there soonest:
    what holds for one holds for any, but for its costs. Hundreds of processes import the package: it is compiled for the first of
    them.
    """
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    os.environ[program.SHORTER], os.environ[native_code.QUICK] = str(FEW), "1"
    program.ATTEMPTS = FEW
    if not hasattr(config, "workerinput"):
        os.environ[USERS_CACHE] = str(user_cache.folder().parents[1])  # what takes minutes to build is not built for tests
        config.stash[CACHE] = os.environ["XDG_CACHE_HOME"] = tempfile.mkdtemp(prefix="gauss-bench-tests-")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """A mark that names cases is a mark of those alone; the dearest files come first, so no process waits for the other's last."""
    items.sort(key=lambda item: DEAREST.index(item.path.stem) if item.path.stem in DEAREST else len(DEAREST))
    for item in items:
        case = item.callspec.id if isinstance(item, pytest.Function) and hasattr(item, "callspec") else ""
        item.own_markers = [mark for mark in item.own_markers if not (mark.name in TIMED and mark.args and case not in mark.args)]
    config.stash[COLLECTED] = [item for item in items if isinstance(item, pytest.Function)]


def pytest_unconfigure(config: pytest.Config) -> None:
    if CACHE in config.stash:
        shutil.rmtree(config.stash[CACHE], ignore_errors=True)


def exhaustive(cases: Iterable[Any], *quick: Any) -> list[Any]:
    """Cases of which these alone are run in every run of the tests: the others show the same of more linkages, and are long."""
    long = pytest.mark.long
    return [x if x in quick else pytest.param(*(x if isinstance(x, tuple) else (x,)), marks=long) for x in cases]


@pytest.fixture
def full_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """The search that users get, for tests of what it finds."""
    monkeypatch.setattr(program, "ATTEMPTS", program.THOROUGH)
    monkeypatch.delenv(program.SHORTER)
    program.known_program.cache_clear()


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Any:
    """A clock in the place of the processor's."""
    from tests.synthetic import clocked

    return clocked(monkeypatch)


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """A browser without a window, where there is one; where CI is set there must be."""
    playwright = (
        pytest.importorskip("playwright.sync_api") if not os.environ.get("CI") else __import__("playwright.sync_api").sync_api
    )
    found = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if found is None:
        assert not os.environ.get("CI"), "no Chromium here, and pages must be looked at where CI is set"
        pytest.skip("no Chromium here to look at pages with")
    with playwright.sync_playwright() as started:
        opened = started.chromium.launch(executable_path=found, args=["--no-sandbox", "--disable-quic", "--disable-gpu"])
        yield opened
        opened.close()


@pytest.fixture(scope="session")
def studio_server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """The studio that tests share; it shows what the last of them drew."""
    pytest.importorskip("uvicorn")
    from tests.studio import ended, started

    running = started(tmp_path_factory.mktemp("studio"))
    yield running
    assert ended(running) == 0


@pytest.fixture
def engines(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The user's file of engines, which need not exist; no engine is installed."""
    path = tmp_path / "engines.toml"
    monkeypatch.setenv(FILE, str(path))
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    monkeypatch.setattr("gauss_bench.runs.offers._known", {})
    return path


@pytest.fixture
def pen(tmp_path: Path) -> Any:
    """A session of the studio that draws by requests, with an empty drawing."""
    from tests.studio import Pen

    return Pen(tmp_path)


@pytest.fixture
def bars(tmp_path: Path) -> Any:
    """A session with a four-bar, whose crank is driven."""
    from tests.studio import four_bar

    return four_bar(tmp_path)


@pytest.fixture
def elsewhere(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The interpreter of the environment of a test's engine: its case `engine`, or ENGINE of its file; skipped where there is none.

    The adapter of this package is used in it, as named in a file of engines of the test's own.
    """
    cases = request.node.callspec.params if hasattr(request.node, "callspec") else {}
    name = cases.get("engine") or request.module.ENGINE
    environment = environment_of(name)
    if environment is None:
        pytest.skip(f"there is no environment of {name} here")
    path = tmp_path / "engines.toml"
    path.write_text(f'[{name}]\npython = "{environment.python}"\n', encoding="utf-8")
    monkeypatch.setenv(FILE, str(path))
    monkeypatch.setattr("gauss_bench.runs.offers._known", {})
    get_worker(name).stop()  # its process may have another file of engines
    return environment.python


def needs(*tools: str) -> Any:
    """The first of these modules or programs that is there: the module, or the program's path; for tests, fixtures and files.

    Where there is none the test is skipped, and what it needs named; in CI, where everything should be installed, it fails.
    """
    for tool in tools:
        if program := shutil.which(tool):
            return program
        try:
            return import_module(tool)
        except ImportError:
            pass
    reason = f"needs {' or '.join(tools)}, not installed here"
    if os.environ.get("CI") == "true":
        pytest.fail(reason, pytrace=False)
    pytest.skip(reason, allow_module_level=True)


def everything(scenario: str = "free") -> Mechanism:
    """Two chains, a guide on a moving link, a multiple joint, a knife edge and every kind of force."""
    document = tomllib.loads((DATA / "everything.toml").read_text(encoding="utf-8"))
    return load_document(document, scenario)


def driven(mechanism: Mechanism, **laws: MotionLaw) -> Mechanism:
    """The mechanism with links turned and slides moved by laws, given by their names, and no other driver."""
    links = [link.name for link in mechanism.links]
    slides = {slide.name: slide for slide in mechanism.slides}
    drivers = [
        SlideDriver(name, law, slides[name]) if name in slides else AngleDriver(name, law, links.index(name))
        for name, law in laws.items()
    ]
    return replace(mechanism, drivers=tuple(drivers))


def redundant() -> Mechanism:
    """The four-bar with its last pin entered twice: two redundant rows."""
    document = tomllib.loads(built_in()["four_bar"].read_text(encoding="utf-8"))
    document["joints"]["again"] = document["joints"]["D"]
    document["expect"] = {"dof": 1, "redundant": 2}
    return load_document(document, "torque")


@pytest.fixture(params=["crank_slider", "four_bar", "six_bar", "eight_bar", "everything", "redundant"])
def any_mechanism(request: pytest.FixtureRequest) -> Mechanism:
    match request.param:
        case "everything":
            return everything()
        case "redundant":
            return redundant()
        case name:
            return load(name)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)
