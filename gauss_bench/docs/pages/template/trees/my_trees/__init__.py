"""An engine of joint trees for gauss_bench: a linkage becomes a tree of a library, and the library solves its equations."""

import inspect
from pathlib import Path
from typing import ClassVar

import numpy as np

from gauss_bench.engines.base import Choice, LibraryCall
from gauss_bench.engines.shared import beyond_a_tree, closing_pins, joint_tree, unsteady
from gauss_bench.engines.tree_model import TreeModel
from gauss_bench.engines.variants import read_variants
from gauss_bench.mechanism.model import Along, Angle, Distance, Law, PointForce, Weighted, loads
from my_trees import library

VARIANTS = read_variants(Path(__file__).parent)
PROGRAM = """
tree = {tree}
state, steps, h = np.array({start}), {steps}, {step}
print("t", *{names}, sep=",")
for k in range(steps + 1):
    if k % {every} == 0:
        x = follow(tree, *state)
        print(k * h, *(z for i in {order} for z in (x.place[i].real, x.place[i].imag, x.angle[i])), sep=",")
    state = step(tree, {method!r}, *state, h, {pull})
"""


def call_library(mechanism, q, v):
    """Return a call of the library alone, at the state q, v (n,), with the accelerations that it should return."""
    model = Model(mechanism, Choice())
    y, dy = model.tree.relative(q, v)
    return LibraryCall(lambda: library.solve(model.built, y, dy), model.acceleration(0.0, q, v))


class Trees:
    """An engine; the members after `build` are optional."""

    name = "trees"
    integrators = ("rk4", "midpoint")
    stabilizations = ("none",)
    settings = VARIANTS.settings
    native_loop, python_loop = False, True

    def version(self):
        return "trees 0.1"

    def skip(self, mechanism, choice):
        """Return why the library cannot model this linkage, or None."""
        if reason := beyond_a_tree(mechanism, "trees") or unsteady(mechanism, "trees"):
            return reason
        for force in mechanism.forces:
            if any(isinstance(x, Law) and isinstance(x.coordinate, Weighted) for x in force.to_loads()):
                return f"trees has no law on a sum of coordinates ({force.name})"
        if mechanism.drivers:
            return "driven motions are not modelled in trees"
        if any(b.kind == "free" for b in joint_tree(mechanism, VARIANTS.options(choice.settings)).branches):
            return "trees has no link without a joint to the ground"
        return None

    def build(self, mechanism, choice):
        return Model(mechanism, choice)

    variants, knobs, first = VARIANTS.space, VARIANTS.knobs, VARIANTS.first
    resizable = True
    packages = ("numpy",)
    library_calls: ClassVar = {"solve": call_library}

    def in_python(self, mechanism, choice):
        return "everything: the library is written in Python"

    def program(self, mechanism, choice):
        """Return a program: the library's source, the numbers of this linkage, and a loop over its duration."""
        model = Model(mechanism, choice)
        steps = max(1, round(mechanism.duration / choice.step))
        numbers = {
            "tree": model.built,
            "start": [model.y0.tolist(), model.dy0.tolist()],
            "names": [f"{link.name}.{x}" for link in mechanism.links for x in ("x", "y", "theta")],
            "order": [model.place[i] for i in range(len(mechanism.links))],
        }
        every = -(-steps // 100)  # steps / 100, rounded up: about 100 states are printed
        loop = {"steps": steps, "step": mechanism.duration / steps, "every": every}
        return inspect.getsource(library) + PROGRAM.format(**numbers, **loop, method=choice.integrator, pull=model.options["pull"])


class Model(TreeModel):
    """A linkage in the library, in the coordinates y of a tree of joints; `TreeModel` translates states and samples."""

    library = "trees"

    def __init__(self, mechanism, choice):
        super().__init__(mechanism, choice, VARIANTS.options(choice.settings))
        self.place = {b.link: b.at for b in self.tree.branches} | {-1: -1}  # link of the file -> link of the library
        self.built = self.describe()

    def describe(self):
        """Return the linkage as a tree of the library, from its links, joints and forces."""
        m, place = self.mechanism, self.place
        links = [m.links[b.link] for b in self.tree.branches]
        acting = loads(m.forces)
        return library.Tree(
            joints=[self.describe_joint(b) for b in self.tree.branches],
            masses=[float(x.mass) for x in links],
            inertias=[float(x.inertia) for x in links],
            gravity=complex(*m.gravity),
            pins=[(*self.end(a), *self.end(b)) for a, b in closing_pins(self.tree)],
            pushes=[(*self.end(x.point), complex(*x.value), place[x.frame]) for x in acting if isinstance(x, PointForce)],
            laws=[self.describe_law(x) for x in acting if not isinstance(x, PointForce)],
        )

    def describe_joint(self, branch):
        """Return the joint of a branch of the tree, which holds a link on its parent."""
        near = complex(*(branch.parent_anchor + branch.base))
        return library.Joint(self.place[branch.parent], near, complex(*branch.anchor), complex(*branch.axis), float(branch.turn))

    def describe_law(self, law):
        """Return a force along a coordinate in the form of the library: (coordinate, k, c, rest, bias)."""
        match law.coordinate:
            case Angle(a, b):
                coordinate = ("angle", self.place[a], self.place[b])
            case Distance(a, b):
                coordinate = ("distance", *self.end(a), *self.end(b), -1, 0.0)  # no axes and no angle
            case Along(origin, point) as x:
                turned = np.pi / 2 if x.across else 0.0
                coordinate = ("along", *self.end(origin), *self.end(point), self.place[x.axes], float(x.angle + turned))
        return coordinate, *map(float, (law.k, law.c, law.rest, law.bias))

    def end(self, point):
        """Return a point in the form of the library: its link, and its place in the link."""
        return self.place[point.link], complex(*point.local)

    def tree_acceleration(self, t, y, dy):
        """Return the accelerations (n,) of the joints' coordinates."""
        return library.solve(self.built, y, dy, self.options["pull"])[0]

    def run(self):
        """Integrate the motion; only this function is timed."""
        state = self.y0, self.dy0
        for part in self.plan:  # equal steps from one sample to the next
            for _ in range(part.steps):
                state = library.step(self.built, self.choice.integrator, *state, part.size, self.options["pull"])
            self.y[part.row], self.dy[part.row] = state

    def joint_forces(self, t, q, v):
        """Return the forces of the pins that close loops (optional)."""
        forces = library.solve(self.built, *self.tree.relative(q, v))[1]
        return {pin.name: np.array([x.real, x.imag, 0.0]) for pin, x in zip(self.tree.closures, forces, strict=True)}
