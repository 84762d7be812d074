"""The links and pairs of a linkage as a graph, and its independent loops.

The links are the nodes of the graph, and the kinematic pairs its edges. A joint of m links consists of m - 1 pairs J, J.001, ... at
the same place, so that every pair joins two links; two links may share several pairs. A spanning tree of the n links (frame
included) has n - 1 of the p pairs. Each of the other

    L = p - n + 1

pairs closes one loop with the path through the tree. The tree is the breadth-first tree from the frame, which keeps the loops
short.

Source: Wang et al. (2010), sections 2.2 and 3.1. The paper does not say how loops are chosen; its examples have the loops of the
breadth-first tree.
"""

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, replace
from itertools import pairwise

import networkx as nx
import numpy as np

from gauss_bench.kinematics.link_units import BLOCK, GUIDE, PIN, ROD_END, Element, LinkPath
from gauss_bench.mechanism.model import GROUND, Joint, LengthDriver, Mechanism, Point, Prismatic, Revolute
from gauss_bench.terms import Array

Levels = tuple[Array, Array, Array]  # a quantity and its first and second derivatives by time


@dataclass(frozen=True)
class Pair:
    """A joint of two links: their indices, and the element of each; the guide of a slide comes first."""

    links: tuple[int, int]
    elements: tuple[Element, Element]

    @property
    def name(self) -> str:
        """Name of the pair."""
        return self.elements[0].pair

    def element(self, link: int) -> Element:
        """Return the half of this pair that belongs to a link, whose index is one of `links`."""
        return self.elements[self.links.index(link)]


@dataclass(frozen=True)
class Loop:
    """A loop: its paths through its links, in cyclic order.

    The first link is the one nearest to the frame; the loop leaves it by the earlier of its two pairs in the file.
    """

    paths: tuple[LinkPath, ...]

    @property
    def joints(self) -> tuple[str, ...]:
        """The names of the joints around the loop; a multiple joint has one name."""
        # a multiple joint gives several equal names in a row: drop repeats, also that of the last and the first name
        nodes = [path.leave.node for path in self.paths]
        merged = [node for k, node in enumerate(nodes) if k == 0 or node != nodes[k - 1]]
        return tuple(merged[:-1] if len(merged) > 1 and merged[0] == merged[-1] else merged)

    def __str__(self) -> str:
        return "-".join(self.joints)


@dataclass(frozen=True, eq=False)
class LinkageGraph:
    """The graph of a linkage, whose nodes are links and whose edges are kinematic pairs.

    Attributes:
        links: number of links without the frame.
        tree: link -> (parent, the next link towards the frame; the pair between them), parents first: the spanning tree.
        loops: one loop for each pair outside the tree.
    """

    links: int
    pairs: tuple[Pair, ...]
    tree: Mapping[int, tuple[int, Pair]]
    loops: tuple[Loop, ...]

    def elements(self, link: int) -> tuple[Element, ...]:
        """Return all elements of a link: its halves of the pairs that join it to other links."""
        return tuple(pair.element(link) for pair in self.pairs if link in pair.links)


def pairs_of(mechanism: Mechanism, bars: Sequence[LengthDriver] = ()) -> tuple[Pair, ...]:
    """Return the pairs of a linkage: those of its joints in file order, then two pins for each active bar.

    An active bar (a bar whose length is an input) is one more link, with an index after those of the linkage's links.
    """
    pairs = [_make_pair(joint) for joint in mechanism.joints]
    for k, bar in enumerate(bars, start=len(mechanism.links)):
        a, b = bar.a, bar.b
        near, far = f"{bar.name} at {a.name}", f"{bar.name} at {b.name}"
        # the pins at the ends of the bar: its far end has the length of the bar as its coordinate
        near_end, far_end = Element(near, a.name, PIN, 0j), Element(far, b.name, ROD_END, 0j, 1.0 + 0j, bar.name)
        pairs.append(Pair((a.link, k), (Element(near, a.name, PIN, complex(*a.local)), near_end)))
        pairs.append(Pair((k, b.link), (far_end, Element(far, b.name, PIN, complex(*b.local)))))
    return tuple(pairs)


def _make_pair(joint: Joint) -> Pair:
    """Return the pair of a joint, with its two elements: pin and pin, or guide and block of a slide."""
    if not isinstance(joint, Prismatic):
        a, b = (Element(joint.name, node=joint.joint, kind=PIN, at=complex(*p.local)) for p in (joint.a, joint.b))
        return Pair((joint.a.link, joint.b.link), (a, b))
    along = complex(np.cos(joint.angle), np.sin(joint.angle))
    start = complex(*joint.guide.local) + 1j * along * joint.offset  # the point of the line at which s is zero
    guide = Element(joint.name, node=joint.name, kind=GUIDE, at=start, along=along, slide=joint.name)
    block = Element(joint.name, node=joint.name, kind=BLOCK, at=complex(*joint.block.local))
    return Pair((joint.guide.link, joint.block.link), (guide, block))


def find_graph(mechanism: Mechanism, bars: Sequence[LengthDriver] = ()) -> LinkageGraph:
    """Return the graph of a linkage, with the given active bars as further links.

    Raises:
        ValueError: no chain of joints connects some links to the frame; the message names them.
    """
    pairs = pairs_of(mechanism, bars)
    links = len(mechanism.links) + len(bars)
    net = _make_graph(pairs, links)
    parents = dict(nx.bfs_predecessors(net, GROUND))
    loose = [mechanism.link_name(i) for i in range(len(mechanism.links)) if i not in parents]
    if loose:
        raise ValueError(f"{mechanism.name}: no joints hold {', '.join(loose)} to the frame; loops do not determine where they are")
    tree = nx.Graph()
    for i, parent in parents.items():
        first_edge = next(iter(net[parent][i].values()))  # of the pairs between both links
        tree.add_edge(parent, i, pair=first_edge["pair"])
    edges = {i: (parent, tree[parent][i]["pair"]) for i, parent in parents.items()}
    in_tree = {pair.name for _, pair in edges.values()}
    unturned = {link for link, (root, _) in shared_angles(mechanism).items() if root == GROUND}  # links that cannot turn
    loops = tuple(_make_loop(tree, pair, pairs, unturned) for pair in pairs if pair.name not in in_tree)
    return LinkageGraph(links, pairs, edges, loops)


def _make_graph(pairs: Sequence[Pair], links: int) -> nx.MultiGraph:
    """Return the graph of links (nodes) and pairs (edges)."""
    net = nx.MultiGraph()
    net.add_nodes_from(range(GROUND, links))  # GROUND is -1: the ground, then all links
    for pair in pairs:
        net.add_edge(*pair.links, key=pair.name, pair=pair)
    return net


def loose_links(mechanism: Mechanism) -> tuple[int, ...]:
    """Return the links that no chain of joints connects to the frame."""
    reached = nx.node_connected_component(_make_graph(pairs_of(mechanism), len(mechanism.links)), GROUND)
    return tuple(i for i in range(len(mechanism.links)) if i not in reached)


def pin_loose_links(mechanism: Mechanism) -> Mechanism:
    """Return the linkage with a pin on the frame for every group of links that no joint connects to it; no loop is closed."""
    while loose := loose_links(mechanism):  # each pin takes a whole group out of this list
        name = f"loose {loose[0]}"
        pin = Revolute(name, name, Point(GROUND, np.zeros(2), "ground."), Point(loose[0], np.zeros(2), ""))
        mechanism = replace(mechanism, joints=(*mechanism.joints, pin))
    return mechanism


def _make_loop(tree: nx.Graph, chord: Pair, pairs: Sequence[Pair], unturned: Set[int]) -> Loop:
    """Return the loop that a pair outside the tree (a chord) closes with the path in the tree between its two links.

    The links `unturned` cannot turn.
    """
    path = nx.shortest_path(tree, *chord.links)
    breadth_first = list(tree)
    top = min(range(len(path)), key=lambda k: breadth_first.index(path[k]))  # the link nearest to the frame
    links = path[top::-1] + path[:top:-1]  # from there to one end of the chord, and from the other end back
    # crossed[k] is the pair between links[k] and the next link, cyclically
    crossed = [tree[a][b]["pair"] if tree.has_edge(a, b) else chord for a, b in pairwise([*links, links[0]])]
    crossed[top] = chord  # even where the two links of the chord share an edge of the tree
    if pairs.index(crossed[0]) > pairs.index(crossed[-1]):  # reverse the loop: it leaves its first link by the earlier pair
        links, crossed = [links[0], *links[:0:-1]], crossed[::-1]
    ends = [(link, crossed[k - 1].element(link), crossed[k].element(link)) for k, link in enumerate(links)]
    return Loop(tuple(LinkPath(link, enter, leave, turns=link not in unturned) for link, enter, leave in ends))


def shared_angles(mechanism: Mechanism) -> dict[int, tuple[int, float]]:
    """Return link -> (root, phase): the angle of the link is that of its root plus the constant `phase` [rad].

    Links that slides join turn by the same angle. One of them is their root: the ground if it is one of them, else the first link
    that is no block. A link without a slide is its own root.
    """
    held = mechanism.held_angles
    blocks = {angle.b for angle, _ in held}
    roots: dict[int, tuple[int, float]] = {}
    for root in sorted(range(GROUND, len(mechanism.links)), key=lambda i: (i != GROUND, i in blocks, i)):
        todo = [(root, 0.0)]
        while todo:
            link, phase = todo.pop()
            if link not in roots:
                roots[link] = (root, phase)
                todo += [(angle.b, phase + turn) for angle, turn in held if angle.a == link]
                todo += [(angle.a, phase - turn) for angle, turn in held if angle.b == link]
    return roots


def absolute_states(graph: LinkageGraph, links: int, angles: Levels, slides: Mapping[str, Levels]) -> Levels:
    """Return q, v, a (k, 3 links) of the first `links` links at k times, computed along the tree from the frame.

    Args:
        angles: angles and their two derivatives, (k, all links + 1) each, with the ground in the last column.
        slides: name of a slide or active bar -> its coordinate or length and two derivatives, (k,) each.
    """
    theta, omega, alpha = angles
    E = np.exp(1j * theta)
    turning = 1j * alpha - omega**2  # E' = i omega E, and E'' = turning E

    def arm(i: int, element: Element) -> tuple[Array, Array, Array]:
        """Return the vector from the centre of link i to an element, and its two time derivatives, complex (k,)."""
        zero = np.zeros(len(theta))
        s, s_rate, s_second = (x * element.along for x in slides.get(element.slide, (zero, zero, zero)))
        local = element.at + s
        e, rate = E[:, i], omega[:, i]  # for the ground, i = -1 is the last column
        return e * local, e * (s_rate + 1j * rate * local), e * (s_second + 2j * rate * s_rate + turning[:, i] * local)

    # link -> place of its centre and two derivatives, complex (k,)
    centres: dict[int, tuple[Array, ...]] = {GROUND: (np.zeros(len(theta)),) * 3}
    for link, (parent, pair) in graph.tree.items():  # both arms end at the pair: the centre is that of the parent + near - far
        near, far = arm(parent, pair.element(parent)), arm(link, pair.element(link))
        centres[link] = tuple(z + x - y for z, x, y in zip(centres[parent], near, far, strict=True))
    levels = []
    for level, angle in enumerate(angles):  # positions, then velocities, then accelerations
        columns: list[Array] = []
        for i in range(links):
            z = centres[i][level]
            columns += [z.real, z.imag, angle[:, i]]
        levels.append(np.stack(columns, axis=-1))
    q, v, a = levels
    return q, v, a
