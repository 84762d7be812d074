"""The equations between the points of a linkage, their exact Jacobian and bias, and the groups that can be solved separately.

Let z (N,) be the complex vector of all points and inputs, as in `points`. Every equation phi = 0 is at most quadratic in z, and has
three constant rows of coefficients a, b, c (N,) each:

    equation:           phi = Re(conj(a z) (b z) + c z)
    first derivative:   dphi = Re(r dz),  with  r = conj(b z) a + conj(a z) b + c
    second derivative:  phi'' = Re(r z'') + 2 Re(conj(a z') (b z'))

The equations are listed here with the points or drivers to which they belong. In this list A, B, C, P are points in the world; a,
b, c are the places of A, B, C in the frame of a link, L = |b - a|; u is the unit vector of a slide's line through the point G:

    (|B - A|^2 - L^2) / 2 L:             the two points that show a link's direction
    C - A - (c - a) (B - A) / (b - a):   two rows, for every further point of a link, or of a link that shares its angle
    C - A - (c - a) exp(i theta):        two rows, for every further point of a link whose direction is known
    u x (P - G) - offset:                the point P of a slide's block
    u . (P - G) - s:                     the point P of the block of a driven slide
    (|B - A|^2 - L(t)^2) / 2 size:       an active bar, whose length L(t) is an input

All residuals are in metres. The two linear equations exclude the mirror image of a third point, and the turn of a direction by 180
degrees. The paper prints the equation of a line as a quotient, which is 0/0 if the line is parallel to the x axis; here it is a
cross product.

Source: Men, Feng, He (2009), section 1: eq. (2).
"""

from cmath import exp
from collections.abc import Iterator
from dataclasses import dataclass

import networkx as nx
import numpy as np

from gauss_bench.kinematics.points import SAME, Points, place
from gauss_bench.mechanism.close import Residual
from gauss_bench.mechanism.model import Mechanism, Prismatic
from gauss_bench.terms import Array, Vectors, largest

Equation = tuple[Vectors, Vectors, Vectors]  # rows a, b, c (N,) of Re(conj(a z) (b z) + c z) = 0; entry 0 of z is 1


@dataclass(frozen=True, eq=False)
class PointGroup:
    """Points that can only be solved together (an Assur group), such as the point that joins the two links of a dyad.

    The sign of the determinant of the group's block of the Jacobian distinguishes assemblies, and changes only at a singular
    position.

    Attributes:
        name: names of the points, joined by "+".
        rows, columns: indices of the group's equations (rows) and unknowns (columns) in the Jacobian.
    """

    name: str
    rows: Array
    columns: Array


def link_equations(p: Points, link: int) -> Iterator[Equation]:
    """Yield the equations that keep the points of one link at their places in the frame of the link."""
    anchor, zeros = p.anchor[link], np.zeros(p.N, dtype=complex)
    # the points A and B of the link `owner` show the direction of this link too; no owner if the direction is an input
    owner, A, B = p.base.get(p.frames[link][0], (None, -1, -1))
    if link == owner:
        L = abs(p.local(link, B) - p.local(link, A))
        bar = (p.unit(B) - p.unit(A)) / np.sqrt(2 * L)  # a = b = bar: the product conj(a z) (b z) is |B - A|^2 / 2 L
        yield bar, bar, -L / 2 * p.unit(0)  # (|B - A|^2 - L^2) / 2 L = 0; entry 0 of z is 1
    # every further point C: neither the anchor A, from which others are computed, nor placed by this link, nor the point B above
    for k in p.entries_of[link]:
        if k != anchor and p.placed_by.get(k) != link and (link != owner or k != B):
            row = p.unit(k) - p.point(link, p.local(link, k))  # C minus its place computed from A and the direction of the link
            yield zeros, zeros, row  # real part of C - A - ... = 0
            yield zeros, zeros, -1j * row  # imaginary part


def slide_equations(p: Points, slide: Prismatic) -> Iterator[Equation]:
    """Yield the equation that keeps the block on the line of a slide and, if it is driven, that of its coordinate s."""
    u = exp(1j * slide.angle) * p.direction(slide.guide.link)  # along the line
    gap = p.unit(p.block(slide)) - p.point(slide.guide.link, place(slide.guide))  # P - G, from guide to block
    yield u, -1j * gap, -slide.offset * p.unit(0)  # Re(conj(u) (-i) gap) is the cross product u x gap
    if slide.name in p.pushed:
        yield u, gap, -p.unit(p.pushed[slide.name])  # Re(conj(u) gap) is the dot product u . gap


def bar_equation(p: Points, name: str) -> Equation:
    """Return the equation (|B - A|^2 - L^2) / 2 size = 0 of an active bar from A to B, with L^2 an entry of z."""
    bar, root = p.bars[name], np.sqrt(2 * p.size)
    gap = (p.point(bar.b.link, place(bar.b)) - p.point(bar.a.link, place(bar.a))) / root  # (B - A) / sqrt(2 size)
    return gap, gap, -p.unit(p.stretched[name]) / root**2


class PointModel:
    """The points of a mechanism, whose drivers are the i inputs, and the m equations between the points.

    p (2 u,) has the coordinates of the u unknown points [m], x and y of each point in turn. m is 2 u, or larger if the
    linkage has redundant constraints.

    Attributes:
        points: the points, and the rows of quantities that are linear in z.
        a, b, c: (m, N) coefficients of the equations, see the top of this file.
        size: largest distance of two points of a link [m].
        unknown, names: (u,) indices in z of the unknown points, and their names.
        directions, centres: (links, N) matrices; their products with z are exp(i theta) of the links and their centres of mass [m].
        groups: the groups of points that have more than one assembly.
    """

    def __init__(self, mechanism: Mechanism):
        """Set up the equations of a mechanism.

        Raises:
            ValueError: the number of drivers is not that of degrees of freedom, the drivers contradict each other, or the mechanism
                has couplings or knife edges.
        """
        if mechanism.couplings:
            raise ValueError(f"{mechanism.name}: equations of points do not support the coupling {mechanism.couplings[0].name}")
        if mechanism.knife_edges:
            raise ValueError(f"{mechanism.name}: equations of points do not support knife edges, which constrain velocities")
        if len(mechanism.drivers) != mechanism.dof:
            raise ValueError(f"{mechanism.name}: {len(mechanism.drivers)} inputs for {mechanism.dof} degrees of freedom")
        self.points = p = Points(mechanism)
        equations: list[Equation] = []
        for i in range(len(mechanism.links)):
            equations += link_equations(p, i)
        for slide in mechanism.slides:
            equations += slide_equations(p, slide)
        equations += [bar_equation(p, name) for name in p.stretched]
        # (m, 3, N): a, b, c of every equation; the shape is given because there may be no equation
        self.a, self.b, self.c = np.array(equations, complex).reshape(-1, 3, p.N).transpose(1, 0, 2)
        self.size, self.unknown = p.size, p.unknown
        self.names = tuple(p.points[k - p.first].name for k in self.unknown)
        self.directions = np.array([p.direction(i) for i in range(len(mechanism.links))])
        self.centres = np.array([p.point(i, 0j) for i in range(len(mechanism.links))])
        self.groups = find_groups(self)

    def fill(self, z: Vectors, p: Array) -> Vectors:
        """Return z (N,) with the unknown points p (2 u,) inserted."""
        z = z.copy()
        z[self.unknown] = p.reshape(-1, 2) @ [1.0, 1.0j]
        return z

    def z_at(self, x: Array, p: Array) -> Vectors:
        """Return z (N,) for inputs x (i,) [rad, m] and unknown coordinates p (2 u,) [m]."""
        still = np.zeros_like(x)
        return self.fill(self.points.evaluate_known(x, still, still)[0], p)

    def phi(self, z: Vectors) -> Array:
        """Return the residual phi (m,) of the equations at z (N,) [m]."""
        return np.asarray(((self.a @ z).conj() * (self.b @ z) + self.c @ z).real)

    def rows(self, z: Vectors) -> Vectors:
        """Return the complex matrix r (m, N) with which a change dz (N,) changes the residual by dphi = Re(r dz)."""
        return np.asarray((self.b @ z).conj()[:, None] * self.a + (self.a @ z).conj()[:, None] * self.b + self.c)

    def jacobian(self, r: Vectors) -> Array:
        """Return the real Jacobian dphi/dp (m, 2 u) from the result r (m, N) of `rows`."""
        columns = r[:, self.unknown]  # dphi = Re(r dz), with dz = dx + i dy of each unknown point
        return np.stack([columns.real, -columns.imag], axis=-1).reshape(len(r), 2 * len(self.unknown))

    def residual(self, x: Array) -> Residual:
        """Return the equations at fixed inputs x (i,) as a function: p (2 u,) -> phi (m,) [m] and its Jacobian (m, 2 u)."""
        known = self.z_at(x, np.zeros(2 * len(self.unknown)))

        def evaluate(p: Array) -> tuple[Array, Array]:
            z = self.fill(known, p)
            return self.phi(z), self.jacobian(self.rows(z))

        return evaluate

    def bias(self, dz: Vectors) -> Array:
        """Return 2 Re(conj(a z') (b z')) (m,), the part of phi'' that is quadratic in the rates dz (N,)."""
        return np.asarray(2 * ((self.a @ dz).conj() * (self.b @ dz)).real)

    def signs(self, J: Array) -> Array:
        """Return the sign of the determinant of each group's block of J (m, 2 u), as (g,); signs distinguish assemblies."""
        signs = [np.sign(np.linalg.det(J[np.ix_(group.rows, group.columns)])) for group in self.groups]
        return np.array(signs, dtype=int)


def find_groups(model: PointModel) -> tuple[PointGroup, ...]:
    """Return the groups of points that have more than one assembly, in an order in which they can be solved one after the other.

    Each unknown coordinate is matched with an equation, and depends on the other unknowns in it. Unknowns that depend on each other
    (a strongly connected component) form a group. Left out are groups of linear equations, and those that depend on redundant
    equations and therefore have no determinant.
    """
    # the pattern of J at random points, where no entry is zero by chance
    z: Vectors = np.random.default_rng(0).normal(size=(model.points.N, 2)) @ np.array([1.0, 1.0j])
    z[0] = 1.0  # the constant entry of z
    J = model.jacobian(model.rows(z))
    m, n = J.shape
    pattern = np.abs(J) > SAME * largest(J)
    columns_of = [np.flatnonzero(row).tolist() for row in pattern]
    graph = nx.Graph((("row", i), ("column", k)) for i in range(m) for k in columns_of[i])
    row_nodes = sorted(node for node in graph if node[0] == "row")  # one side of the bipartite graph
    matched = nx.bipartite.hopcroft_karp_matching(graph, row_nodes)
    row_of = {k: matched["column", k][1] for k in range(n) if ("column", k) in matched}  # unknown -> its equation
    # an edge leads from an unknown to each unknown on which it depends
    needs = nx.DiGraph((k, other) for k, i in row_of.items() for other in columns_of[i])
    redundant: set[int] = set()  # unknowns in equations without a match, and those on which they depend
    for i in range(m):
        if ("row", i) not in matched:
            redundant.update(*({k} | nx.descendants(needs, k) for k in columns_of[i]))
    # an equation Re(conj(a z) (b z) + c z) = 0 is quadratic in the points if both a and b have entries at points of z
    curved = np.any(model.a[:, model.points.first :] != 0, axis=1) & np.any(model.b[:, model.points.first :] != 0, axis=1)
    groups = []
    for component in nx.strongly_connected_components(needs):
        columns = sorted(component)
        rows = sorted(row_of[k] for k in columns)
        if curved[rows].any() and not component & redundant:
            name = "+".join(dict.fromkeys(model.names[k // 2] for k in columns))  # unknowns 2 k and 2 k + 1: x and y of point k
            groups.append(PointGroup(name, np.array(rows), np.array(columns)))
    return tuple(groups)
