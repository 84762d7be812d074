"""New kinds of constraints and forces as in CONTRIBUTING.md: a file, its keys and a line. All parts of the suite support or refuse
them.

A rack and pinion holds a weighted sum of coordinates; a magnet pushes by the inverse square of a distance. Their motions are known
without the suite: a torque T on the pinion gives it the acceleration T / (I + m R^2).
"""

import shutil

import pytest

from tests.conftest import DATA
from tests.test_contributing import copied, insert, said_by

FILES = {
    "rack_and_pinion": '''"""A wheel that rolls on a slide."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from gauss_bench.mechanism.model import GROUND, Along, Angle, Coordinate, Names, Weighted


@dataclass(frozen=True, eq=False)
class RackAndPinion:
    """The slide goes `radius` times the angle of the wheel."""

    name: str
    way: Along
    link: int
    radius: float

    @classmethod
    def read(cls, name: str, table: Mapping[str, Any], names: Names) -> "RackAndPinion":
        (slide,) = names.pairs(table["joint"])
        return cls(name, slide.motion, names.link(table["links"][0]), names.number(table, "radius"))

    @property
    def held(self) -> tuple[tuple[Coordinate, float], ...]:
        return ((Weighted(((self.way, 1.0), (Angle(GROUND, self.link), -self.radius))), 0.0),)
''',
    "magnet": '''"""Two points that push each other apart."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from gauss_bench.mechanism.model import Distance, Law, Load, Names, Point


@dataclass(frozen=True, eq=False)
class Magnet:
    """The force strength / d^2 along the line of two points at the distance d [N m^2]; negative ones attract."""

    name: str
    a: Point
    b: Point
    strength: float

    @classmethod
    def read(cls, name: str, table: Mapping[str, Any], names: Names) -> "Magnet":
        a, b = (names.point(x) for x in table["between"])
        return cls(name, a, b, names.number(table, "strength"))

    def to_loads(self) -> tuple[Load, ...]:
        return (Law(Distance(self.a, self.b), inverse_square=self.strength),)
''',
}
KEYS = {
    "rack_and_pinion": ("RackAndPinion", "joint: Text\n    links: list[Text]\n    radius: Number"),
    "magnet": ("Magnet", "between: Couple\n    strength: Number"),
}
THROUGH = """
import contextlib, io, sys

import numpy as np

from gauss_bench.api.simulate import simulate
from gauss_bench.compiler.elimination.program import generate
from gauss_bench.cli import main
from gauss_bench.engines import FOREIGN, get, names
from gauss_bench.exchange.errors import ExchangeError
from gauss_bench.exchange.export import KINDS, export_linkage
from gauss_bench.linkage.load import document_of, load
from gauss_bench.report.drawings.drawing import draw
from gauss_bench.studio import reading, scene
from gauss_bench.verbs.catalogue import show

FILE, KIND = "new.toml", sys.argv[1]
mechanism = load(FILE)
document, _, _ = document_of(FILE)


def wanted(theta):
    if KIND == "rack_and_pinion":
        return 0.7 / (0.02 + 3.0 * 0.1**2)
    arm, pole = 0.3 * np.array([np.cos(theta), np.sin(theta)]), np.array([0.5, 0.0])
    gap = arm - pole
    force = 0.05 * gap / np.linalg.norm(gap) ** 3
    return (arm[0] * force[1] - arm[1] * force[0]) / 0.02


named = ("mesh", "drive", "dyads", "redundant", "loop")
ran = []
for name in names():
    engine = get(name)
    try:
        engine.version()
    except ImportError:
        continue
    # settings and variants differ by engine: what runs by default stands for them
    found = simulate(FILE, engine=name, at=[0.0, 0.05, 0.1])
    if found.status == "skip":
        assert any(word in found.message for word in named), (name, found.message)
        continue
    if found.status != "ok":
        assert name == "yuan_ge_eq16", (name, found.status, found.message)  # the negative control
        continue
    ran.append(name)
    wheel = next(iter(found.links.values()))
    for theta, alpha in zip(wheel["theta"], wheel["alpha"]):
        assert abs(alpha - wanted(theta)) < 1e-6 * abs(wanted(theta)), (name, alpha, wanted(theta))
    if KIND == "magnet":
        gaps = np.hypot(0.3 * np.cos(wheel["theta"]) - 0.5, 0.3 * np.sin(wheel["theta"]))
        energies = 0.5 * 0.02 * wheel["omega"] ** 2 + 0.05 / gaps
        assert np.ptp(energies) < 1e-6 * energies[0], (name, energies)
assert {"gauss", "lagrange", "gauss-native", "lagrange-native"} <= set(ran), ran
if KIND == "magnet":
    assert list(generate(mechanism, "gauss", ("forces.drive.strength",)).values) == [0.05]
assert "<svg" in draw(mechanism)
shown = show(FILE, None).data
assert shown.couplings == ({"mesh": KIND} if KIND == "rack_and_pinion" else {})
assert scene.scene(reading.read(document))["links"]


for kind in KINDS:
    try:
        export_linkage(mechanism, kind, 1e-3)
    except ExchangeError as error:
        assert any(word in str(error) for word in (*named, "RackAndPinion")), (kind, error)
said = io.StringIO()
with contextlib.redirect_stdout(said):
    assert main(["certify", FILE]) == 1
assert "mesh" in said.getvalue() or "drive" in said.getvalue(), said.getvalue()
assert main(["run", FILE, "--no-costs", "--until", "0.1", "--steps", "1e-2", "--engine", "gauss", "--out", "rows"]) == 0
print(*ran)
"""


@pytest.mark.long("magnet")
@pytest.mark.slow
@pytest.mark.parametrize("kind", FILES)
def test_a_new_kind_is_a_file_its_keys_and_a_line(kind, tmp_path):
    package = copied(tmp_path) / "gauss_bench"
    name, keys = KEYS[kind]
    (package / "mechanism" / f"{kind}.py").write_text(FILES[kind], encoding="utf-8")
    schema = package / "linkage" / "schema.py"
    table = f"class {name}Table(Table):\n    read: ClassVar = {name}.read\n"
    table += f'    type: Literal["{kind}"]\n    {keys}\n\n\n'
    insert(schema, "class TableOverTime(Table", table)
    other = '"coulomb_friction": CoulombFrictionTable' if kind == "magnet" else '"knife_edge": KnifeEdgeTable'
    insert(schema, other, f'"{kind}": {name}Table, ')
    insert(schema, "FORMAT = ", f"from gauss_bench.mechanism.{kind} import {name}\n")
    shutil.copy(DATA / "new_kinds" / f"{kind}.toml", tmp_path / "new.toml")
    assert "gauss-native" in said_by(tmp_path, "-c", THROUGH, kind)
