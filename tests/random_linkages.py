"""Linkages drawn by lot: links of two to eight, closed by pins and slides or left swinging, each sound where it starts.

A crank is on the ground. To what is there are added, by lot, two bars between two points of different links (an RRR dyad), a bar
and a block that slides along a link (RRP), or a bar that swings, until the number of links is reached. What a dyad adds is kept
away from its singular position at the start; later on nothing is promised. The same seed gives the same linkage.
"""

from typing import Any

import numpy as np

from gauss_bench.terms import Array

FEWEST, MOST = 2, 8  # links
CLEAR = 0.5  # of a sine that is zero where a dyad is singular
PLACES = ("A", "B", "C")
TRIES = 1000  # for a dyad between two points: none fits between points in one place, as of two links at their pin


class _Draft:
    """A linkage in the making, in the pose of its start."""

    def __init__(self, rng: np.random.Generator):
        self.rng = rng
        self.points: dict[str, Array] = {"ground.O": np.zeros(2)}
        self.links: dict[str, dict[str, Any]] = {}
        self.origins: dict[str, tuple[Array, float]] = {"ground": (np.zeros(2), 0.0)}
        self.joints: dict[str, dict[str, Any]] = {}
        self.start: dict[str, dict[str, float]] = {"angles": {}, "speeds": {}}

    def near(self, centre: Array, least: float, most: float) -> Array:
        """A point between two distances [m] of another."""
        angle = self.rng.uniform(0.0, 2 * np.pi)
        return np.asarray(centre + self.rng.uniform(least, most) * np.array([np.cos(angle), np.sin(angle)]))

    def bar(self, kind: str, start: Array, end: Array) -> str:
        """A link from point A to point B with a third point beside them."""
        name, (way, angle) = f"{kind}{len(self.links)}", (end - start, self.rng.uniform(-np.pi, np.pi))
        side = self.rng.uniform(-0.4, 0.4) * np.array([-way[1], way[0]])
        there = {"A": start, "B": end, "C": start + self.rng.uniform(0.3, 0.7) * way + side}
        mass, length = float(10 ** self.rng.uniform(-1.0, 1.0)), float(np.hypot(*way))
        here = {p: _turn(x - start, -angle) for p, x in there.items()}
        com = self.rng.uniform(0.3, 0.7) * here["B"] + self.rng.uniform(0.0, 0.3) * (here["C"] - here["B"] / 2)
        inertia = mass * length**2 * self.rng.uniform(0.05, 0.2)
        points = {p: x.tolist() for p, x in here.items()}
        self.links[name] = {"points": points, "mass": mass, "com": com.tolist(), "inertia": float(inertia)}
        self.origins[name] = (start, angle)
        self.points |= {f"{name}.{p}": x for p, x in there.items()}
        return name

    def pin(self, *at: str) -> None:
        self.joints[f"j{len(self.joints)}"] = {"type": "revolute", "at": list(at)}

    def anchor(self, other_than: str = "") -> tuple[str, Array]:
        """Name and place of a point to build on: one of a link, or a new one on the ground."""
        owners = [x for x in self.origins if x != other_than]
        owner = owners[int(self.rng.integers(len(owners)))]
        if owner != "ground":
            name = f"{owner}.{PLACES[1:][int(self.rng.integers(2))]}"
            return (name, self.points[name]) if name in self.points else self.anchor(other_than)
        name = f"ground.G{sum(x.startswith('ground') for x in self.points)}"
        self.points[name] = self.near(np.zeros(2), 0.3, 1.0)
        return name, self.points[name]

    def free(self, name: str) -> None:
        """A link whose angle is a freedom."""
        self.start["angles"][name] = self.origins[name][1]
        self.start["speeds"][name] = float(self.rng.uniform(-5.0, 5.0))

    def swing(self) -> None:
        at, place = self.anchor()
        name = self.bar("p", place, self.near(place, 0.15, 0.5))
        self.pin(at, f"{name}.A")
        self.free(name)

    def two_bars(self) -> None:
        tries, ((first, a), (second, b)) = 0, self._ends()
        while True:
            if (tries := tries + 1) > TRIES:
                tries, ((first, a), (second, b)) = 0, self._ends()
            middle = self.near((a + b) / 2, 0.1, 0.6)
            u, w = middle - a, middle - b
            lengths = np.hypot(*u), np.hypot(*w)
            if min(lengths) > 0.1 and abs(u[0] * w[1] - u[1] * w[0]) > CLEAR * lengths[0] * lengths[1]:
                break
        one, other = self.bar("u", a, middle), self.bar("w", b, middle)
        self.pin(first, f"{one}.A")
        self.pin(second, f"{other}.A")
        self.pin(f"{one}.B", f"{other}.B")

    def bar_and_block(self) -> None:
        (first, a), (second, b) = self._ends()
        while True:
            end, angle = self.near(a, 0.15, 0.6), self.rng.uniform(-np.pi, np.pi)
            along = np.array([np.cos(angle), np.sin(angle)])
            if abs(along @ (end - a)) > CLEAR * np.hypot(*(end - a)):
                break
        one = self.bar("u", a, end)
        block, turned = f"s{len(self.links)}", float(self.rng.uniform(-np.pi, np.pi))
        mass = float(10 ** self.rng.uniform(-1.0, 1.0))
        self.links[block] = {"points": {"A": [0.0, 0.0]}, "mass": mass, "inertia": mass * float(self.rng.uniform(1e-3, 4e-3))}
        self.links[block]["com"] = self.rng.uniform(-0.05, 0.05, 2).tolist()
        self.origins[block], self.points[f"{block}.A"] = (end, turned), end
        guide = second.partition(".")[0]
        self.pin(first, f"{one}.A")
        self.pin(f"{one}.B", f"{block}.A")
        offset = float(np.array([-along[1], along[0]]) @ (end - b))
        slide = {"guide": second, "block": f"{block}.A", "offset": offset, "block_angle": angle - turned}
        self.joints[f"j{len(self.joints)}"] = {"type": "prismatic", "angle": angle - self.origins[guide][1], **slide}

    def _ends(self) -> tuple[tuple[str, Array], tuple[str, Array]]:
        first = self.anchor()
        return first, self.anchor(first[0].partition(".")[0])

    def forces(self) -> dict[str, dict[str, Any]]:
        """A spring between two links or none, a torque on the crank or none."""
        made: dict[str, dict[str, Any]] = {}
        first, second = self._ends()
        distance = float(np.hypot(*(first[1] - second[1])))
        if self.rng.random() < 0.5 and distance > 0.1:
            k, c = float(10 ** self.rng.uniform(0.0, 2.0)), float(self.rng.uniform(0.0, 1.0))
            spring = {"between": [first[0], second[0]], "k": k, "c": c, "rest": float(self.rng.uniform(0.5, 1.5)) * distance}
            made["f0"] = {"type": "spring_damper", **spring}
        if self.rng.random() < 0.5:
            made["f1"] = {"type": "torque", "link": "c0", "value": float(self.rng.uniform(-2.0, 2.0))}
        return made


def _turn(x: Array, angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([c * x[0] - s * x[1], s * x[0] + c * x[1]])


def random_linkage(seed: int) -> dict[str, Any]:
    """The document of a linkage."""
    rng = np.random.default_rng([seed, 10])
    draft, count = _Draft(rng), int(rng.integers(FEWEST, MOST + 1))
    crank = draft.bar("c", np.zeros(2), draft.near(np.zeros(2), 0.15, 0.5))
    draft.pin("ground.O", f"{crank}.A")
    draft.free(crank)
    while len(draft.links) < count:
        ways = [draft.swing] if len(draft.links) == count - 1 else [draft.two_bars, draft.bar_and_block, draft.swing]
        chances = [1.0] if len(ways) == 1 else [0.45, 0.35, 0.2]
        ways[int(rng.choice(len(ways), p=chances))]()
    forces = draft.forces()
    joined = {x for j in draft.joints.values() for x in j.get("at", [])}
    at = {x: place.tolist() for x, place in draft.points.items()}
    sketch = {x: place for x, place in at.items() if not x.startswith("ground") and (x in joined or x[-1] in "AB")}
    ground = {x.partition(".")[2]: place for x, place in at.items() if x.startswith("ground")}
    blocks = {x: angle for x, (_, angle) in draft.origins.items() if x.startswith("s")}
    return {
        "format": "planar-linkage/1",
        "name": f"random_{seed}",
        "crank": crank,
        "gravity": [float(rng.uniform(-1.0, 1.0)), -9.81],
        "ground": {"points": ground},
        "links": draft.links,
        "joints": draft.joints,
        "forces": forces,
        "assembly": {"sketch": sketch, "angles": blocks},
        "scenarios": {"run": {"duration": 0.2, "forces": sorted(forces), "start": draft.start}},
    }
