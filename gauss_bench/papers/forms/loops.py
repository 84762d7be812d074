"""Wang et al. (2010), sections 1 and 2: loop equations, the stack of all loops, and the graph of a linkage.

    J phi' = -B q'                                (4)
    J phi'' = -B q'' - B' q' - J' phi'            (5)
    J_l = sum J_i U_i,   B_l = sum J_i K_i        (11)

phi are the unknown variables and q the known inputs. J and B are the matrices of all loops, J_l and B_l those of one loop. Each
link that the loop passes contributes a Jacobian unit J_i (see `link_units`); the matrices U_i and K_i tell to which unknowns and to
which inputs the columns of J_i belong.

The equations are tested on built-in linkages, with matrices from the package `kinematics`, and with rates computed independently
from the motion in the crank angle. The matrices of the paper's six-bar (section 1.2.5; loops a-b-c-d and d-e-f-g) are written here
as printed. The paper gives no dimensions of the six-bar: those of the linkage file are used.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import chain

import networkx as nx
import numpy as np

from gauss_bench.kinematics.link_units import MOVING
from gauss_bench.kinematics.loop_equations import LoopEquations, Matrices
from gauss_bench.kinematics.topology import LinkageGraph, find_graph
from gauss_bench.linkage.load import built_in, load
from gauss_bench.mechanism import coordinates
from gauss_bench.mechanism.model import GROUND
from gauss_bench.mechanism.motion_laws import rise
from gauss_bench.papers.audit import worst
from gauss_bench.papers.forms.problems import count_off, relative
from gauss_bench.reference.minimal import MinimalCoordinate
from gauss_bench.terms import Array

DRIVEN = ("four_bar", "six_bar", "shaper", "eight_bar")
TIMES = (0.2, 0.37, 0.8)  # [s] in a cycloidal turn of 1 s; the acceleration of the crank has both signs
ALPHA = np.radians(50.0)  # between d-e and d-c of the six-bar's ternary link
LENGTHS = (0.10, 0.30, 0.28, 0.24, 0.36)  # l1, l2, l3, l3', l5 of the six-bar [m], which are the linkage file's
RAIL = np.radians(-45.0)  # direction of the six-bar's slide
LAWS = ("sine", "cosine", "poly345")  # motion laws that the paper names
INSIDE = np.linspace(0.0, 1.0, 101)  # [s] times in a rise of 1 in 1 s
COUNTED = ("crank_slider", "four_bar", "five_bar", "six_bar", "shaper", "eight_bar", "jansen", "parallelogram")
Blocks = tuple[Array, ...]  # matrices of loop equations
Laws = dict[str, Callable[[Array], Array]]  # name of a motion law -> its rise from 0 to 1 over the elapsed fraction of the time


@dataclass(frozen=True, eq=False)
class DrivenLinkage:
    """A driven linkage at an instant.

    Attributes:
        x: values of the variables, unknowns before inputs.
        rate, second: their true first and second time derivatives; NaN for the second derivatives of slides.
    """

    equations: LoopEquations
    x: Array
    rate: Array
    second: Array

    @property
    def unknowns(self) -> int:
        """The number of unknown variables."""
        return len(self.equations.unknown)

    @property
    def matrices(self) -> Matrices:
        """The matrices J, B of the loop equations and their rates."""
        return self.equations.evaluate(self.x, self.rate)


@cache
def list_driven() -> tuple[DrivenLinkage, ...]:
    """Return the linkages DRIVEN at each of TIMES, cranks driven by a cycloidal law, with rates from the crank angle alone."""
    linkages = []
    for name in DRIVEN:
        mechanism = load(name, "cycloid")
        slides = {j.name: j for j in mechanism.slides}
        for t in TIMES:
            q, v, a = (x[0] for x in MinimalCoordinate(mechanism).state_at(t))
            equations = LoopEquations(replace(mechanism, q0=q))
            rate, second = [], []
            for variable in equations.variables:
                if isinstance(variable, int):  # the angle of a link
                    rate.append(v[3 * variable + 2])
                    second.append(a[3 * variable + 2])
                else:  # the displacement of a slide
                    rate.append(float(coordinates.rate(slides[variable].motion, q, v)))
                    second.append(np.nan)
            linkages.append(DrivenLinkage(equations, equations.start(), np.array(rate), np.array(second)))
    return tuple(linkages)


def velocities(m: Matrices, q_rate: Array) -> Array:
    """Return the rates phi' of the unknowns by eq. (4), J phi' = -B q', from the rates q' of the inputs."""
    return np.asarray(np.linalg.solve(m.J, -m.B @ q_rate))


def velocities_off(form: Callable[[Matrices, Array], Array], linkage: DrivenLinkage) -> float:
    """Return the relative error of form(matrices, q'), the rates phi' of the unknowns."""
    return relative(form(linkage.matrices, linkage.rate[linkage.unknowns :]), linkage.rate[: linkage.unknowns])


def accelerations_off(last: list[str], linkage: DrivenLinkage) -> float:
    """Return the largest relative error of the angular accelerations of the unknowns by eq. (5).

    `last` has the name of the matrix in the last term: "J_rate", which is right, or "J", as the paper prints it.
    """
    n, m = linkage.unknowns, linkage.matrices  # `rate` and `second` have n unknowns, then the inputs
    known = m.B @ linkage.second[n:] + m.B_rate @ linkage.rate[n:] + getattr(m, *last) @ linkage.rate[:n]
    is_angle = ~np.isnan(linkage.second[:n])
    return relative(np.linalg.solve(m.J, -known)[is_angle], linkage.second[:n][is_angle])


def assemble(units: Sequence[Array], U: Sequence[Array], K: Sequence[Array]) -> Blocks:
    """Return J_l and B_l of one loop by eq. (11), from the Jacobians J of its links and their matrices U and K."""
    return sum(J @ u for J, u in zip(units, U, strict=True)), sum(J @ k for J, k in zip(units, K, strict=True))  # type: ignore[return-value]


def loops_of(linkage: DrivenLinkage) -> list[tuple[list[Array], list[Array], list[Array]]]:
    """Return for every loop three lists (J, U, K) with one matrix for each link of the loop.

    J has the derivatives of the link's vector by its angle and length, whose rates are U times the rates of the unknowns plus K
    times those of the inputs.
    """
    equations, loops = linkage.equations, []
    theta = equations.turning @ linkage.x + equations.phase  # angles of the links [rad]
    # for each link of a loop: the path through it, the indices of its slides, and those of all its variables
    for paths in equations.paths:
        units = [path.link_unit(theta[path.link], 0.0, linkage.x[slides], linkage.rate[slides]).J for path, slides, _ in paths]
        factors: list[Array] = [np.eye(len(linkage.x))[own] for _, _, own in paths]  # [U K] of each link
        loops.append((units, [f[:, : linkage.unknowns] for f in factors], [f[:, linkage.unknowns :] for f in factors]))
    return loops


def assembly_off(form: Callable[..., Blocks], linkage: DrivenLinkage) -> float:
    """Return the residual of eq. (4), J phi' + B q' = 0, relative to its terms, if `form` computes J_l, B_l as `assemble` does."""
    errors, rate = [], linkage.rate
    for loop in loops_of(linkage):
        J_B = np.hstack(form(*loop))  # J and B side by side
        errors.append(float(np.abs(J_B @ rate).max() / (np.abs(J_B) @ np.abs(rate)).max()))
    return worst(errors)


def stack_off(transposed: bool, linkage: DrivenLinkage) -> float:
    """Return the relative error of the velocities by eq. (4) if J and B are the blocks J_l, B_l one below the other.

    If `transposed`, the blocks are put side by side, and the whole is transposed. If J or B then has a wrong shape, the number of
    surplus or missing rows and columns is returned, divided by the sum of the right numbers.
    """
    loops = [assemble(*loop) for loop in loops_of(linkage)]  # (J_l, B_l) of each
    J, B = (np.hstack(blocks).T if transposed else np.vstack(blocks) for blocks in zip(*loops, strict=True))
    rows, columns = 2 * len(loops), linkage.unknowns  # right shapes: J (rows, columns), B (rows, 1)
    misfit = abs(J.shape[0] - rows) + abs(J.shape[1] - columns) + abs(B.shape[0] - rows) + abs(B.shape[1] - 1)
    if misfit:
        return float(misfit / (2 * rows + columns + 1))
    return relative(np.linalg.lstsq(J, -B @ linkage.rate[columns:], rcond=None)[0], linkage.rate[:columns])


def ones_off(form: list[list[str]]) -> float:
    """Return the fraction of rows of U and K (`loops_of`) that are not rows of a unit matrix.

    Each list in `form` names the matrices that are tested: ["U"], ["K"], or ["U", "K"] for the rows of both side by side.
    """
    is_unit_row = []
    for linkage in list_driven():
        for _, Us, Ks in loops_of(linkage):
            for U, K in zip(Us, Ks, strict=True):
                for names in form:
                    M = np.hstack([{"U": U, "K": K}[name] for name in names])
                    # of a unit row, the only entry that is not zero is 1
                    is_unit_row += [(row != 0).sum() == 1 and row.max(initial=0.0) == 1 for row in M]
    return 1 - float(np.mean(is_unit_row))


def columns_off(form: list[int], linkage: DrivenLinkage) -> float:
    """Return the largest error of a claimed number of columns of a link's Jacobian J, form[0] t + form[1] g + form[2] b.

    t is 1 if the link can turn, else 0; g and b are the numbers of guides (or rod ends) and blocks at which the loop enters and
    leaves it.
    """
    errors = []
    for path, slides, _ in chain.from_iterable(linkage.equations.paths):
        kinds = [path.enter.kind, path.leave.kind]
        guides = sum(kind in MOVING for kind in kinds)
        unit = path.link_unit(0.0, 0.0, linkage.x[slides], linkage.rate[slides])  # the shape of J is that at any angle
        errors.append(count_off(form, (int(path.turns), guides, kinds.count("block")), unit.J.shape[1]))
    return worst(errors)


@cache
def list_graphs() -> tuple[LinkageGraph, ...]:
    """Return the graphs of all built-in linkages with joints and without knife edges."""
    return tuple(find_graph(m) for m in map(load, built_in()) if m.joints and not m.knife_edges)


def list_counted() -> list[LoopEquations]:
    """Return the loop equations of each linkage named in COUNTED, loaded in its scenario "driven"."""
    return [LoopEquations(load(name, "driven")) for name in COUNTED]


def unknowns_off(form: list[int], equations: LoopEquations) -> float:
    """Return the error of a claimed number of unknowns, form[0] loops + form[1] redundant constraints."""
    return count_off(form, (len(equations.paths), equations.mechanism.redundant), len(equations.unknown))


def incidence(graph: LinkageGraph, oriented: bool) -> Array:
    """Return the incidence matrix by networkx, with a row for each link (the frame last) and a column for each pair.

    A column has ones in the rows of the pair's two links; if `oriented`, that of the first link is -1.
    """
    links, edges = [*range(graph.links), GROUND], [(*pair.links, pair.name) for pair in graph.pairs]
    return np.asarray(nx.incidence_matrix(nx.MultiGraph(edges), links, edges, oriented).toarray())


def loop_count_off(form: list[int], graph: LinkageGraph) -> float:
    """Return the error of a claimed number of loops (dimension of the space of cycles), form[0] pairs + form[1] links + form[2]."""
    matrix = incidence(graph, oriented=True)
    links, pairs = matrix.shape
    return count_off(form, (pairs, links, 1), pairs - int(np.linalg.matrix_rank(matrix)))


def incidence_off(diagonal: bool) -> float:
    """Return the share of wrong entries in the paper's incidence matrices, whose entry (i, j) is 1 if joint j is on link i.

    If `diagonal`, only entries of the diagonal may be 1. The number of wrong entries is divided by the number of ones in the right
    matrices.
    """
    wrong = ones = 0
    for graph in list_graphs():
        links = [*range(graph.links), GROUND]
        is_on_link = np.array([[float(i in pair.links) for pair in graph.pairs] for i in links])
        true = incidence(graph, oriented=False)
        claimed = np.eye(*is_on_link.shape) * is_on_link if diagonal else is_on_link
        wrong += int((claimed != true).sum())
        ones += int(true.sum())
    return wrong / ones


def neighbours(loop: str) -> frozenset[frozenset[str]]:
    """Return the pairs of neighbouring joints of a loop "joint-joint-...", which do not depend on its start and sense."""
    names = loop.split("-")
    return frozenset(frozenset(pair) for pair in zip(names, [*names[1:], names[0]], strict=True))


def loops_off(form: dict[str, list[str]]) -> float:
    """Return the number of loops that are not both in the paper (`form`: linkage -> loops "joint-joint-...") and in the suite."""
    count = 0
    for name, loops in form.items():
        own = {neighbours(str(loop)) for loop in find_graph(load(name)).loops}
        count += len(own ^ {neighbours(loop) for loop in loops})
    return float(count)


def six_bar_blocks(phi: Array, rate: Array) -> Blocks:
    """Return J (4, 4), B (4, 1) and their rates, in the order J, J', B, B', of the six-bar as printed in section 1.2.5.

    phi and rate (4,) are the angles phi1 (the input), phi2, phi3, phi5 and their rates; the columns of J are for phi2, phi3, phi5
    and the slide s.
    """
    l1, l2, l3, l3s, l5 = LENGTHS
    # each entry of these arrays belongs to one arm of a link: its length, its angle and its angular speed
    arms = np.array([l1, l2, l3s, l3, l5])
    angle, speed = phi[[0, 1, 2, 2, 3]] + np.array([0, 0, ALPHA, 0, 0]), rate[[0, 1, 2, 2, 3]]
    s, c = arms * np.sin(angle), arms * np.cos(angle)
    S, C = c * speed, s * speed  # the rate of s, and minus the rate of c
    J = [[-s[1], s[2], 0, 0], [c[1], -c[2], 0, 0], [0, -s[3], -s[4], -np.cos(RAIL)], [0, c[3], c[4], -np.sin(RAIL)]]
    J_rate = [[-S[1], S[2], 0, 0], [-C[1], C[2], 0, 0], [0, -S[3], -S[4], 0], [0, -C[3], -C[4], 0]]
    B, B_rate = [[-s[0]], [c[0]], [0], [0]], [[-S[0]], [-C[0]], [0], [0]]
    return np.array(J), np.array(J_rate), np.array(B), np.array(B_rate)


def list_six_bars() -> list[DrivenLinkage]:
    """Return the six-bar of `list_driven` at each of TIMES."""
    return [linkage for linkage in list_driven() if linkage.equations.mechanism.name == "six_bar"]


def blocks_off(form: Callable[[Array, Array], Blocks], linkage: DrivenLinkage) -> float:
    """Return the largest difference of form(phi, rate), the matrices of `six_bar_blocks`, from those of the suite.

    The paper may pass a loop in the opposite sense, so that the two equations of each loop may have the opposite sign.
    """
    equations, m, errors = linkage.equations, linkage.matrices, []
    columns = [equations.column[i] for i in (0, 1, 2, 3)]  # of phi1, phi2, phi3, phi5
    order = [*columns[1:], len(equations.unknown) - 1]  # the paper's unknowns: without the input phi1, the slide last
    printed = np.hstack(form(linkage.x[columns], linkage.rate[columns]))
    own = np.hstack([m.J[:, order], m.J_rate[:, order], m.B, m.B_rate])
    for rows in (slice(0, 2), slice(2, 4)):
        errors.append(min(float(np.abs(printed[rows] - sense * own[rows]).max()) for sense in (1.0, -1.0)))
    return worst(errors)


def straight() -> Laws:
    """Return a linear function for each motion law, because the paper prints no formulas of them."""
    return dict.fromkeys(LAWS, lambda u: u)


def textbook() -> Laws:
    """Return the motion laws of textbooks, which rise from 0 to 1, as functions of the elapsed fraction u of the time."""
    return {
        "sine": lambda u: u - np.sin(2 * np.pi * u) / (2 * np.pi),
        "cosine": lambda u: (1 - np.cos(np.pi * u)) / 2,
        "poly345": lambda u: 10 * u**3 - 15 * u**4 + 6 * u**5,
    }


def laws_off(form: Callable[[], Laws]) -> float:
    """Return the largest difference of the motion laws in form() from the suite's motion laws, over a rise of 1 in 1 s."""
    laws = form()
    return worst([float(np.abs(laws[name](INSIDE) - rise(name, 0.0, 1.0, 1.0)(INSIDE)[0]).max()) for name in LAWS])
