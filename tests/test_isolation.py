"""Forty ways in which an engine can fail: each is a typed row with a sentence, and leaves no process behind."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from gauss_bench.bench import worker
from gauss_bench.bench.worker import Worker, WorkerFailure
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
FINE = {"version_boom", "told_function"}  # a name that is unknown and a remark that is none spoil no motion
CODE = """
import json, re
import gauss_bench
names = re.findall("CLASSES (.*)", open(FILE).read())[0].split()
told = {x: gauss_bench.simulate("four_bar", f"faults40:{x}", scenario="torque", at=[0.04], step=5e-3, limit=5.0) for x in names}
print(json.dumps({x: [str(y.status), y.message, bool(y.valid)] for x, y in told.items()}))
"""


def classes() -> list[str]:
    faults = ENGINES[ENGINES.index("FAULTS = [") + 10 : ENGINES.index("]\nfor fault")].replace("\n", " ").split(",")
    names = [f"run_{x.strip()}" for x in faults]
    names += [f"{place}_{how}" for place in ("init", "version", "skip", "build", "prepare", "read") for how in ("boom", "leave")]
    return [*names, "init_abort", *(line.split('"')[1] for line in ENGINES.splitlines() if line.startswith('kind("told_'))]


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


@pytest.mark.slow
def test_forty_faults_are_forty_typed_rows_and_no_orphans(tmp_path: Path) -> None:
    names, marked = classes(), "36001.7"
    assert len(names) >= 40
    module = tmp_path / "faults40.py"
    module.write_text(f"# CLASSES {' '.join(names)}\nMARKED = {marked!r}\n{ENGINES}", encoding="utf-8")
    sign = f"SIGN_OF_THIS_TEST={os.urandom(8).hex()}"
    environment = os.environ | {"PYTHONPATH": f"{Path(__file__).parents[1]}:{tmp_path}"} | dict([sign.split("=")])
    code = f"FILE = {str(module)!r}\n{CODE}"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=False, timeout=900)
    assert done.returncode == 0, done.stderr[-2000:]
    told = json.loads(done.stdout)
    assert told.keys() == set(names)
    for name, (status, message, valid) in told.items():
        if name in FINE:
            assert (status, valid) == ("ok", True)
            continue
        assert status in set(Status) - {Status.OK}, (name, status, message)
        assert message, name
        assert message.isprintable(), name
        assert not valid, name
    assert told["run_segfault"][:2] == ["crashed", "the process died with signal SIGSEGV"]
    assert [told[f"run_{x}"][0] for x in ("loop", "sleep", "stop", "daemon", "memory")] == ["timeout"] * 4 + ["error"]
    assert "MemoryError" in told["run_memory"][1]
    assert [told[f"told_{x}"][0] for x in ("nan", "short", "resting")] == ["nan", "incomplete", "invalid"]
    assert not alive(sign.encode())


def burn(seconds: float) -> float:
    start = time.process_time()
    while time.process_time() - start < seconds:
        pass
    return seconds


def test_waiting_for_a_processor_is_not_held_against_a_task(monkeypatch: pytest.MonkeyPatch) -> None:
    """The system says how long a process was ready and did not run; here it is told that it always was."""
    start = time.monotonic()
    monkeypatch.setattr(worker._Clock, "_waited", lambda self: 0.9 * (time.monotonic() - start))
    with Worker() as one:
        one.call(max, (1, 2), 60.0)
        assert one.call(burn, (0.6,), 0.3) == 0.6  # 0.6 s, of which a tenth counts
    monkeypatch.setattr(worker, "BACKSTOP", 2.0)
    with Worker() as one:
        one.call(max, (1, 2), 60.0)
        with pytest.raises(WorkerFailure, match="no answer within"):
            one.call(time.sleep, (60,), 0.3)


def start_a_daemon() -> int:
    return subprocess.Popen(["sleep", "3600"], start_new_session=True).pid


def test_what_hides_in_a_session_of_its_own_ends_with_its_worker() -> None:
    with Worker() as one:
        pid = one.call(start_a_daemon, (), 20.0)
        assert Path(f"/proc/{pid}").exists()
    deadline = time.monotonic() + 5.0
    while Path(f"/proc/{pid}").exists() and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not Path(f"/proc/{pid}").exists()
