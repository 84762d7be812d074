"""A package with engines of others that abort, lie, print or lack something, as an installation leaves it."""

import os
from pathlib import Path

PLUGIN = """
import os
from gauss_bench.engines.interpreted import Interpreted

class Engine(Interpreted):
    def __init__(self):
        super().__init__("gauss")
        self.name = type(self).__name__.lower()
        self.integrators, self.stabilizations = ("rk4",), ("none",)
    def build(self, mechanism, choice):
        model = Interpreted("gauss").build(mechanism, choice)
        run, read = model.run, model.read
        model.run = lambda: (self.hook(), run())
        model.read = lambda: self.told(read())
        return model
    def hook(self):
        pass
    def told(self, trajectory):
        return trajectory

class Aborts(Engine):
    def hook(self):
        os.abort()

class Spoils(Engine):
    def hook(self):
        print("noise" * 1000)
        for k in range(3, 12):
            try:
                os.write(k, b"X" * 64)
            except OSError:
                pass

class Short(Engine):
    def told(self, x):
        return type(x)(x.t[:5], x.q[:5], x.v[:5], x.a[:5], 5)

class Rests(Engine):
    def told(self, x):
        return type(x)(x.t, 0 * x.q + x.q[0], 0 * x.v, 0 * x.a, x.steps)

class Wordy(Engine):
    def hook(self):
        raise ValueError("a first line\\n" + "and more \\x00" * 1000)

class Letters(Engine):
    def __init__(self):
        super().__init__()
        self.integrators = "rk4"

class Bare:
    name = "bare"
"""
NAMES = ("aborts", "spoils", "short", "rests", "wordy", "letters", "bare", "absent")


def installed(folder: Path, package: str = PLUGIN, names: tuple[str, ...] = NAMES) -> dict[str, str]:
    """The environment of a process that has the package, in this folder."""
    (folder / "others.py").write_text(package, encoding="utf-8")
    made = folder / "others-1.0.dist-info"
    made.mkdir()
    (made / "METADATA").write_text("Metadata-Version: 2.1\nName: others\nVersion: 1.0\n", encoding="utf-8")
    points = "".join(f"{x} = {'nowhere' if x == 'absent' else 'others'}:{x.capitalize()}\n" for x in names)
    (made / "entry_points.txt").write_text(f"[gauss_bench.engines]\n{points}", encoding="utf-8")
    root = str(Path(__file__).parents[1])
    return os.environ | {"PYTHONPATH": os.pathsep.join([root, str(folder)])}
