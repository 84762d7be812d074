"""Engines that fail in different ways: while they run, by wrong answers or members, or when they are imported."""

import os
from pathlib import Path

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


WHEN = ("init", "version", "skip", "build", "prepare", "read")
FAULTS = [f"run_{name.strip()}" for name in ENGINES.partition("FAULTS = [")[2].partition("]")[0].split(",")]
FAULTS += [f"{when}_{how}" for when in WHEN for how in ("boom", "leave")] + ["init_abort", "init_loop"]
FAULTS += [f"told_{line.partition(chr(34))[0]}" for line in ENGINES.split('kind("told_')[1:]]
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


def write_modules(folder: Path, mark: str) -> list[str]:
    """Write the engines into a folder, and return their addresses; processes that they start sleep for `mark` seconds."""
    lies = "".join(f"class {name}(Sound):\n    {text}\n" for name, text in LIES.items())
    (folder / "faults40.py").write_text(f"MARKED = {mark!r}\n{ENGINES}\n{lies}", encoding="utf-8")
    for name, text in IMPORTS.items():
        (folder / f"{name}.py").write_text(f"{text}\nfrom faults40 import Sound\nEngine = Sound\n", encoding="utf-8")
    return [*(f"faults40:{name}" for name in [*FAULTS, *LIES]), *(f"{name}:Engine" for name in IMPORTS)]


def alive(sign: bytes) -> list[int]:
    """Return the processes that have this text in their environment or arguments."""
    found = []
    for name in filter(str.isdigit, os.listdir("/proc")):
        try:
            if sign in Path(f"/proc/{name}/cmdline").read_bytes() + Path(f"/proc/{name}/environ").read_bytes():
                found.append(int(name))
        except OSError:
            continue
    return [pid for pid in found if pid != os.getpid()]
