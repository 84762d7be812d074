"""The equations between the points of a linkage, their exact Jacobian and bias, and the groups they fall into.

With z as in `points`, every equation is at most quadratic and made of three constant rows a, b, c:

    phi = Re(conj(a z) (b z) + c z),    dphi = Re(r dz)  with  r = conj(b z) a + conj(a z) b + c
    phi'' = Re(r z'') + 2 Re(conj(a z') (b z'))

so that Jacobian and acceleration bias are exact, and the same few lines for every kind. u is the unit vector of a line through G:

    (|B - A|^2 - L^2) / 2 L            the two points that show a link's direction
    C - A - (c - a) (B - A) / (b - a)  two rows: every further point of a link, or of a partner in a slide, which has its angle
    C - A - (c - a) exp(i theta)       two rows: every further point of a link of known direction
    u x (P - G) - offset               the block point of a slide
    u . (P - G) - s                    a driven slide
    (|B - A|^2 - L(t)^2) / 2 size      an active bar

All are in metres. A third point by lengths would admit the mirror image of the link, and two bars by the cross product of their
directions a turn by 180 degrees; the linear rows admit neither. A line is a cross product and not the printed quotient of
differences, which is 0/0 where it is parallel to the x axis.
Source: Men, Feng, He, General simulation software of planar linkages based on geometric constraints, J. Mechanical Transmission
33(4), 2009, section 1: eq. (2).
"""

from cmath import exp
from collections.abc import Iterator
from dataclasses import dataclass

import networkx as nx
import numpy as np

from gauss_bench.kinematics.inputs import Input
from gauss_bench.kinematics.points import SAME, Points, place
from gauss_bench.kinematics.root_finding import Residual
from gauss_bench.mechanism.model import Mechanism, Prismatic
from gauss_bench.terms import Array, Vectors

Equation = tuple[Vectors, Vectors, Vectors]  # rows a, b, c (N,)


@dataclass(frozen=True, eq=False)
class PointGroup:
    """Points that only their equations together determine (an Assur group): its name, rows and columns of the Jacobian.

    The sign of its determinant tells assemblies apart: that of a dyad is the side on which its middle point lies. It can change
    only where the determinant vanishes, which is a singular position.
    """

    name: str
    rows: Array
    columns: Array


def link_equations(p: Points, link: int) -> Iterator[Equation]:
    """The equations that hold the points of one link at their places in it."""
    anchor, none = p.anchor[link], np.zeros(p.N, dtype=complex)
    owner, A, B = p.base.get(p.frames[link][0], (None, -1, -1))
    if link == owner:
        L = abs(p.local(link, B) - p.local(link, A))
        bar = (p.unit(B) - p.unit(A)) / np.sqrt(2 * L)
        yield bar, bar, -L / 2 * p.unit(0)
    for k in p.of[link]:
        if k != anchor and p.placed_by.get(k) != link and (link != owner or k != B):
            row = p.unit(k) - p.point(link, p.local(link, k))
            yield none, none, row
            yield none, none, -1j * row


def slide_equations(p: Points, slide: Prismatic) -> Iterator[Equation]:
    """The line of a slide, and its driven coordinate."""
    u = exp(1j * slide.angle) * p.direction(slide.guide.link)
    gap = p.unit(p.block(slide)) - p.point(slide.guide.link, place(slide.guide))
    yield u, -1j * gap, -slide.offset * p.unit(0)
    if slide.name in p.pushed:
        yield u, gap, -p.unit(p.pushed[slide.name])


def bar_equation(p: Points, name: str) -> Equation:
    """The length of an active bar."""
    bar, size = p.bars[name], np.sqrt(2 * p.size)
    gap = (p.point(bar.b.link, place(bar.b)) - p.point(bar.a.link, place(bar.a))) / size
    return gap, gap, -p.unit(p.stretched[name]) / size**2


class PointModel:
    """Points and equations of a mechanism with given inputs.

    Unknowns are p (2 u,), x before y of each unknown point [m]; there are m >= 2 u equations, more where the linkage is redundant.
    """

    def __init__(self, mechanism: Mechanism, inputs: tuple[Input, ...]):
        """Raises ValueError for knife edges, or inputs that are not as many as degrees of freedom or contradict each other."""
        if mechanism.couplings:
            raise ValueError(f"{mechanism.name}: points have no equation for the coupling {mechanism.couplings[0].name}")
        if mechanism.knife_edges:
            raise ValueError(f"{mechanism.name}: knife edges leave no trace in positions, so that points cannot obey them")
        if len(inputs) != mechanism.dof:
            raise ValueError(f"{mechanism.name}: {len(inputs)} inputs for {mechanism.dof} degrees of freedom")
        self.points = p = Points(mechanism, inputs)
        equations = [e for i in range(len(mechanism.links)) for e in link_equations(p, i)]
        equations += [e for slide in mechanism.slides for e in slide_equations(p, slide)]
        equations += [bar_equation(p, name) for name in p.stretched]
        self.a, self.b, self.c = np.array(equations, complex).reshape(-1, 3, p.N).transpose(1, 0, 2)
        self.size, self.unknown = self.points.size, self.points.unknown
        self.names = tuple(self.points.points[k - self.points.first].name for k in self.unknown)
        self.directions = np.array([self.points.direction(i) for i in range(len(mechanism.links))])
        self.centres = np.array([self.points.point(i, 0j) for i in range(len(mechanism.links))])
        self.groups = groups(self)

    def filled(self, z: Vectors, p: Array) -> Vectors:
        """z (N,) with the unknown points p (2 u,) put in."""
        z = z.copy()
        z[self.unknown] = p.reshape(-1, 2) @ [1.0, 1.0j]
        return z

    def at(self, x: Array, p: Array) -> Vectors:
        """z (N,) at inputs x (i,) [rad, m] and unknown points p (2 u,)."""
        still = np.zeros_like(x)
        return self.filled(self.points.known(x, still, still)[0], p)

    def phi(self, z: Vectors) -> Array:
        """Residual (m,) [m]."""
        return np.asarray(((self.a @ z).conj() * (self.b @ z) + self.c @ z).real)

    def rows(self, z: Vectors) -> Vectors:
        """r (m, N) of dphi = Re(r dz)."""
        return np.asarray((self.b @ z).conj()[:, None] * self.a + (self.a @ z).conj()[:, None] * self.b + self.c)

    def jacobian(self, r: Vectors) -> Array:
        """dphi/dp (m, 2 u) of rows r."""
        part = r[:, self.unknown]
        return np.stack([part.real, -part.imag], axis=-1).reshape(len(r), 2 * len(self.unknown))

    def residual(self, x: Array) -> Residual:
        """p -> phi (m,), J (m, 2 u) at the inputs x (i,) [rad, m]."""
        known = self.at(x, np.zeros(2 * len(self.unknown)))

        def of(p: Array) -> tuple[Array, Array]:
            z = self.filled(known, p)
            return self.phi(z), self.jacobian(self.rows(z))

        return of

    def bias(self, dz: Vectors) -> Array:
        """2 Re(conj(a z') (b z')) (m,): what the speeds dz (N,) leave in phi''."""
        return np.asarray(2 * ((self.a @ dz).conj() * (self.b @ dz)).real)

    def signs(self, J: Array) -> Array:
        """Sign (g,) of the determinant of each group."""
        signs = [np.sign(np.linalg.det(J[np.ix_(group.rows, group.columns)])) for group in self.groups]
        return np.array(signs, dtype=int)


def groups(model: PointModel) -> tuple[PointGroup, ...]:
    """The groups that have more than one assembly, in an order in which they can be solved.

    Equations and unknowns are matched; an equation points from its unknown to the others in it, and unknowns that reach each
    other form a group. Left out are groups whose rows do not change with the points (no choice), and what redundant equations
    reach: it has more equations than unknowns and no determinant.
    """
    z: Vectors = np.random.default_rng(0).normal(size=(model.points.N, 2)) @ np.array([1.0, 1.0j])
    z[0] = 1.0
    J = model.jacobian(model.rows(z))
    m, n = J.shape
    pattern = np.abs(J) > SAME * np.abs(J).max(initial=0.0)
    graph = nx.Graph((("row", i), ("column", k)) for i, k in np.argwhere(pattern).tolist())
    tops = [node for node in graph if node[0] == "row"]
    matched = nx.bipartite.hopcroft_karp_matching(graph, sorted(tops))
    row_of = {k: matched["column", k][1] for k in range(n) if ("column", k) in matched}
    free = {i for i in range(m) if pattern[i].any() and ("row", i) not in matched}
    needs = nx.DiGraph((k, other) for k, i in row_of.items() for other in np.flatnonzero(pattern[i]).tolist())
    spoiled = {k for i in free for start in np.flatnonzero(pattern[i]).tolist() for k in {start} | nx.descendants(needs, start)}
    curved = np.any(model.a[:, model.points.first :] != 0, axis=1) & np.any(model.b[:, model.points.first :] != 0, axis=1)
    several = []
    for part in nx.strongly_connected_components(needs):
        columns = sorted(part)
        rows = sorted(row_of[k] for k in columns)
        if curved[rows].any() and not part & spoiled:
            name = "+".join(dict.fromkeys(model.names[k // 2] for k in columns))
            several.append(PointGroup(name, np.array(rows), np.array(columns)))
    return tuple(several)
