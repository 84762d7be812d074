"""Engines of others that each fail in a way of their own, installed as a package with entry points; what verbs make of them.

`python -m tests.faults` runs every one of them through `list`, `simulate`, `run` and `check`, as a user would.
"""

import csv
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Collection, Sequence
from pathlib import Path

from gauss_bench.tables import TABLES, csv_text, read_file, row_of, write_text
from gauss_bench.trajectory import Status

ENGINES = """
import ctypes, os, signal, subprocess, sys, threading, time
import numpy as np
from dataclasses import replace
from gauss_bench.engines.interpreted import Interpreted
from gauss_bench.trajectory import RunFailure

class Sound:
    integrators, stabilizations, settings = ("rk4",), ("none",), {"default": {}}
    native_loop, python_loop = False, True
    def __init__(self):
        self.name = type(self).__name__
        self.at("init")
    def at(self, place):
        if place == getattr(self, "place", "run"):
            self.fault()
    def fault(self): pass
    def version(self):
        self.at("version")
        return "sound 1"
    def skip(self, mechanism, choice): self.at("skip")
    def build(self, mechanism, choice):
        self.at("build")
        return Model(self, Interpreted("gauss").build(mechanism, choice))
    def told(self, x): return x

class Model:
    def __init__(self, engine, model): self.engine, self.model = engine, model
    def acceleration(self, t, q, v): return self.model.acceleration(t, q, v)
    def prepare(self, times, native=True):
        self.engine.at("prepare")
        self.model.prepare(times, native)
    def run(self):
        self.engine.at("run")
        self.model.run()
    def read(self):
        self.engine.at("read")
        return self.engine.told(self.model.read())

def segfault(self): ctypes.string_at(0)
def abort(self): os.abort()
def loop(self):
    while True: pass
def sleep(self): time.sleep(3600)
def stop(self): os.kill(os.getpid(), signal.SIGSTOP)
def memory(self): self.kept = np.ones(1 << 30)
def leave(self): os._exit(0)
def exits(self): sys.exit(0)
def interrupt(self): raise KeyboardInterrupt
def boom(self): raise ValueError("boom \\x00 <b>| and\\nmore")
def closes(self): os.closerange(3, 300)
def recursion(self): return recursion(self)
def child(self):
    subprocess.Popen(["sleep", MARKED]); os.abort()
def daemon(self):
    subprocess.Popen(["sleep", MARKED], start_new_session=True, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    loop(self)
def forks(self):
    if os.fork() == 0:
        os.setsid(); time.sleep(3600)
    os.abort()
def thread(self):
    threading.Thread(target=os.abort).start(); time.sleep(3600)
def signalled(self): os.kill(os.getpid(), signal.SIGTERM)
def noise(self):
    for k in range(1, 300):
        try: os.write(k, b"\\x00\\xffGARBAGE" * 1000)
        except OSError: pass
    abort(self)
def failure(self): raise RunFailure("ok", "all is well")
def unreadable(self): raise type("Odd", (Exception,), {"__str__": lambda self: 1 / 0})()

def kind(name, fault=None, place="run", told=None):
    own = {"fault": fault, "place": place} if fault else {}
    globals()[name] = type(name, (Sound,), own | ({"told": lambda self, x: told(x)} if told else {}))

FAULTS = [segfault, abort, loop, sleep, stop, memory, leave, exits, interrupt, boom, recursion, child, daemon, forks, thread,
          signalled, noise, failure, unreadable, closes]
for fault in FAULTS:
    kind(f"run_{fault.__name__}", fault)
for place in ("init", "version", "skip", "build", "prepare", "read"):
    kind(f"{place}_boom", boom, place)
    kind(f"{place}_leave", leave, place)
kind("init_abort", abort, "init")
kind("init_loop", loop, "init")
kind("told_nan", told=lambda x: replace(x, q=x.q * np.nan))
kind("told_short", told=lambda x: replace(x, t=x.t[:5], q=x.q[:5], v=x.v[:5], a=x.a[:5]))
kind("told_stretched", told=lambda x: replace(x, t=x.t * 2))
kind("told_resting", told=lambda x: replace(x, q=0 * x.q + x.q[0], v=0 * x.v, a=0 * x.a))
kind("told_shape", told=lambda x: replace(x, q=x.q[:, :3]))
kind("told_nothing", told=lambda x: None)
kind("told_texts", told=lambda x: replace(x, q=np.array([["a"] * x.q.shape[1]] * len(x.q))))
kind("told_function", told=lambda x: replace(x, note=lambda: 1))
kind("told_steps", told=lambda x: replace(x, steps="many"))
"""


IMPORTS = {
    "import_boom": "1 / 0",
    "import_exit": "import sys; sys.exit(0)",
    "import_leave": "import os; os._exit(0)",
    "import_abort": "import os; os.abort()",
    "import_syntax": "def",
    "import_missing": "import a_library_that_is_nowhere",
    "import_noise": "import os; [os.write(k, b'noise' * 1000) for k in (1, 2)]; 1 / 0",
    "import_child": "import subprocess; subprocess.Popen(['sleep', '36001.7']); 1 / 0",
    "import_loop": "while True: pass",
}
LIES = {  # what stands in the place of a class that is sound but for this
    "lie_integrators": "integrators = 'rk4'",
    "lie_integrators_endless": "integrators = iter(int, 1)",
    "lie_settings": "settings = ['default']",
    "lie_settings_function": "settings = {'default': {'x': print}}",
    "lie_property": "adaptive = property(lambda self: 1 / 0)",
    "lie_no_build": "build = None",
    "lie_version": "version = lambda self: object()",
    "lie_skip": "skip = lambda self, mechanism, choice: [1, 2]",
    "lie_build": "build = lambda self, mechanism, choice: None",
    "lie_name": "name = property(lambda self: 7, lambda self, x: None)",
    "lie_everything": "__getattribute__ = lambda self, key: 1 / 0",
    "lie_words": "stabilizations = ('none\\x1b[2J',)",
}


def classes() -> list[str]:
    faults = ENGINES[ENGINES.index("FAULTS = [") + 10 : ENGINES.index("]\nfor fault")].replace("\n", " ").split(",")
    names = [f"run_{x.strip()}" for x in faults]
    names += [f"{place}_{how}" for place in ("init", "version", "skip", "build", "prepare", "read") for how in ("boom", "leave")]
    return [
        *names,
        "init_abort",
        "init_loop",
        *(line.split('"')[1] for line in ENGINES.splitlines() if line.startswith('kind("told_')),
    ]


def alive(sign: bytes) -> list[int]:
    """Processes that have this in their environment or arguments."""
    found = []
    for name in filter(str.isdigit, os.listdir("/proc")):
        try:
            if sign in Path(f"/proc/{name}/cmdline").read_bytes() + Path(f"/proc/{name}/environ").read_bytes():
                found.append(int(name))
        except OSError:
            continue
    return [pid for pid in found if pid != os.getpid()]


def installed(folder: Path) -> tuple[list[str], dict[str, str]]:
    """Names of engines that a package in this folder has, each with a fault; and the environment of a process that has it.

    Whatever such a process starts carries the sign of the folder in its environment.
    """
    lies = "".join(f"class {name}(Sound):\n    {text}\n" for name, text in LIES.items())
    (folder / "faults40.py").write_text(f"MARKED = '36001.7'\n{ENGINES}\n{lies}", encoding="utf-8")
    for name, text in IMPORTS.items():
        (folder / f"{name}.py").write_text(f"{text}\nfrom faults40 import Sound\nEngine = Sound\n", encoding="utf-8")
    made = folder / "faults-1.0.dist-info"
    made.mkdir()
    (made / "METADATA").write_text("Metadata-Version: 2.1\nName: faults\nVersion: 1.0\n", encoding="utf-8")
    inside = [*classes(), *LIES]
    points = [f"{x} = faults40:{x}" for x in inside] + [f"{x} = {x}:Engine" for x in IMPORTS]
    points += ["point_nowhere = nowhere:Engine", "point_nothing = faults40:nothing", "point_module = faults40"]
    (made / "entry_points.txt").write_text("\n".join(["[gauss_bench.engines]", *points, ""]), encoding="utf-8")
    path = os.pathsep.join([str(Path(__file__).parents[1]), str(folder)])
    return [x.partition(" = ")[0] for x in points], os.environ | {"PYTHONPATH": path, "SIGN_OF_FAULTS": str(folder)}


HARMLESS = {"version_boom", "told_function", "lie_version", "lie_name", "lie_settings_function"}  # they spoil no motion
SHOWN = ("init", "version_leave", "lie", "import", "point")  # what `list` already says of an engine
HIDDEN = {"lie_version", "lie_name", "lie_settings_function", "lie_skip", "lie_build"}
TRACES = ("Traceback", "fault of gauss-bench")
HURRIED = """
import contextlib, io, json, os, sys
from functools import partial
from gauss_bench import cli
from gauss_bench.bench import runner
from gauss_bench.runs import offers
offers.LIMIT = 5.0
runner.measure_all = partial(runner.measure_all, limit=5.0)
"""
ONE = HURRIED + "sys.exit(cli.command())"
MANY = (  # the verb once for each engine: its exit code, and what it wrote
    HURRIED
    + """
found = {}
for name in sys.argv[1].split(","):
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = cli.main([*sys.argv[2:], "--engine", name])
    found[name] = [code, out.getvalue(), err.getvalue()]
os.write(1, json.dumps(found).encode())
"""
)


def verb(environment: dict[str, str], folder: Path, *arguments: str, code: str = ONE) -> "subprocess.CompletedProcess[str]":
    """A verb as a user runs it, but that an engine is waited for no longer than 5 s."""
    command = [sys.executable, "-c", code, *arguments]
    return subprocess.run(command, capture_output=True, text=True, env=environment, cwd=folder, check=False, timeout=3000)


def wrong(status: str, message: str, fine: bool) -> bool:
    """Whether a row does not say what is to be said: ok of what spoils no motion, else another status and a sentence."""
    if fine:
        return status != "ok"
    return status not in {str(x) for x in Status if x is not Status.OK} or not message or not message.isprintable()


def baseline_for(names: Sequence[str], path: Path) -> None:
    """A baseline in which each of these engines did what gauss does."""
    rows = read_file("baseline", Path(__file__).parents[1] / "reports" / "baseline.csv")
    like = [x for x in rows if (x["mechanism"], x["engine"], x["integrator"], x["step"]) == ("four_bar", "gauss", "rk4", 1e-2)]
    like = [x for x in like if x["stabilization"] == "none"]
    table = TABLES["baseline"]
    write_text(path, csv_text(table.columns, [row_of(table, x | {"engine": name}) for name in names for x in like]))


def over_verbs(folder: Path, chosen: Collection[str] = ()) -> list[str]:
    """Sentences on what list, simulate, run and check make of the faults (all, or those chosen) other than they should."""
    names, environment = installed(folder)
    names = [x for x in names if not chosen or x in chosen]
    bad = list[str]()

    def judged(
        what: str,
        done: "subprocess.CompletedProcess[str]",
        code: int,
        rows: dict[str, tuple[str, str]],
        fine: Collection[str] = HARMLESS,
    ) -> None:
        if done.returncode != code or any(x in done.stderr for x in TRACES):
            bad.append(f"{what}: exit code {done.returncode}, not {code}: {done.stderr[-600:]}")
        bad.extend(f"{what}: {x}: {rows.get(x)}" for x in names if x not in rows or wrong(*rows[x], x in fine))
        print(f"{what}: {len(rows)} rows", file=sys.stderr, flush=True)

    done = verb(environment, folder, "list", "--json")
    told = json.loads(done.stdout)["engines"]
    at_work = {x for x in names if not x.startswith(SHOWN) or x in HIDDEN}  # their faults do not show before they are asked to run
    judged("list", done, 0, {x: (told[x]["status"], told[x]["reason"]) for x in names if x in told}, at_work)
    asked = [y for x in names for y in ("--engine", x)]
    shared = ["--no-costs", "--steps", "0.01", "--until", "0.1", "--budget", "5", "--out", "run"]
    done = verb(environment, folder, "run", "four_bar", *asked, *shared)
    with (folder / "run" / "results.csv").open(encoding="utf-8", newline="") as file:
        rows = {x["engine"]: (x["status"], x["message"]) for x in csv.DictReader(file)}
    judged("run", done, 0, rows)
    baseline_for(names, folder / "baseline.csv")
    done = verb(environment, folder, "check", "four_bar", *asked, "--baseline", "baseline.csv", "--json")
    rows = {
        x["case"].split()[2]: (x["value"], x["cause"] or x["outcome"])
        for x in json.loads(done.stdout)["verdicts"]
        if x["metric"] == "status" and x["value"] != "none"
    }
    judged("check", done, 1, rows)
    shared = ["four_bar", "--at", "0.05", "--step", "0.01", "--budget", "5", "--json"]
    done = verb(environment, folder, ",".join(names), "simulate", *shared, code=MANY)
    rows = {}
    for name, (code, out, err) in (json.loads(done.stdout) if done.stdout else {}).items():
        found = json.loads(out) if out else {"status": "error", "message": err.strip()}
        rows[name] = found["status"], found["message"]
        usual = (0,) if found["status"] in ("ok", "skip") else (1, 2)
        if code not in usual or any(x in err for x in TRACES):
            bad.append(f"simulate: {name}: exit code {code} of {found['status']}: {err[-600:]}")
    judged("simulate", done, 0, rows)
    left = alive(f"SIGN_OF_FAULTS={folder}".encode())
    return [*bad, *(f"process {pid} is left" for pid in left)]


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as place:
        found = over_verbs(Path(place), sys.argv[1:])
    print(*found, f"{len(found)} are not as they should be", sep="\n")
    raise SystemExit(bool(found))
