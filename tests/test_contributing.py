"""What CONTRIBUTING says a new thing touches, done on a copy of the package: one test for each row."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import gauss_bench

PACKAGE = Path(gauss_bench.__file__).parent


def copy_of_the_package(folder: Path) -> Path:
    """A copy of the package that a test may change."""
    shutil.copytree(PACKAGE, folder / "gauss_bench", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(PACKAGE.parent / "mechanisms", folder / "mechanisms")
    return folder / "gauss_bench"


def insert(path: Path, before: str, text: str) -> None:
    source = path.read_text(encoding="utf-8")
    assert source.count(before) == 1, f"{path.name} has changed: {before!r}"
    path.write_text(source.replace(before, text + before), encoding="utf-8")


def run(folder: Path, code: str) -> str:
    """What a program prints that imports the copy."""
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=folder, env=os.environ | {"PYTHONPATH": str(folder)}, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


SCHEMA = """class MotorTable(Table, physics="type link stall drag"):
    type: Literal["motor"]
    link: Text
    stall: Number
    drag: Number


"""
KIND = '''@dataclass(frozen=True, eq=False)
class Motor:
    """Torque stall - drag omega on a link [N m], the opposite one on the ground."""

    name: str
    link: int
    stall: float
    drag: float

    @classmethod
    def read(cls, name: str, table: Mapping[str, Any], names: Names) -> "Motor":
        return cls(name, names.link(table["link"]), names.number(table, "stall"), names.number(table, "drag"))

    def lowered(self) -> tuple[Load, ...]:
        return (Law(Angle(GROUND, self.link), c=self.drag, bias=self.stall),)


'''
USED = """
import copy
import numpy as np
from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.load import document_of, load_document

document, _, _ = document_of("four_bar")
document["forces"]["drive"] = {"type": "motor", "link": "crank", "stall": 2.0, "drag": 0.3}
document["scenarios"]["torque"]["forces"] = ["drive"]
mechanism = load_document(document, "torque")
evaluator = Evaluator(mechanism)
rng = np.random.default_rng(0)
q, v = rng.normal(size=(2, mechanism.n))
omega = v[3 * mechanism.crank + 2]
weight = Evaluator(load_document(document, "conservative")).applied.generalised(q, v)
assert abs((evaluator.applied.generalised(q, v) - weight) @ v - (2.0 - 0.3 * omega) * omega) < 1e-12
h = 1e-5
slope = (evaluator.applied.potential(q + h * v) - evaluator.applied.potential(q - h * v)) / (2 * h)
assert abs(evaluator.applied.generalised(q, v) @ v + slope - evaluator.applied.power(q, v)) < 1e-7
engines = ["gauss"]
for name in ("pinocchio", "mujoco", "exudyn"):
    try:
        get(name).version()
        engines.append(name)
    except ImportError:
        pass
turning = rng.normal() * mechanism.v0
motions = []
for name in engines:
    engine = get(name)
    label = "tuned" if name == "exudyn" else "rigid" if name == "mujoco" else next(iter(engine.settings))
    choice = Choice(label, engine.integrators[0], "none", 1e-3)
    assert engine.skip(mechanism, choice) is None
    model = engine.build(mechanism, choice)
    motions.append(model.acceleration(0.0, mechanism.q0, mechanism.v0))
for a in motions:
    assert np.abs(a - motions[0]).max() < 1e-4 * np.abs(motions[0]).max(), engines
print(*engines)
"""


def test_a_force_touches_its_keys_and_its_kind(tmp_path: Path) -> None:
    """Keys in schema.py, what it is and what it comes to in model.py; terms, formulations and adapters follow."""
    mechanism = copy_of_the_package(tmp_path) / "mechanism"
    schema = mechanism / "schema.py"
    insert(schema, "class CoulombFrictionTable(Table", SCHEMA)
    insert(schema, '    "coulomb_friction": CoulombFrictionTable,', '    "motor": MotorTable,\n')
    union = '    | Annotated[CoulombFrictionTable, Tag("<coulomb_friction>")]'
    insert(schema, union, '    | Annotated[MotorTable, Tag("<motor>")]\n')
    insert(mechanism / "model.py", "@dataclass(frozen=True, eq=False)\nclass CoulombFriction:", KIND)
    insert(mechanism / "model.py", '    "coulomb_friction": CoulombFriction.read,', '    "motor": Motor.read,\n')
    assert "gauss" in run(tmp_path, USED)
