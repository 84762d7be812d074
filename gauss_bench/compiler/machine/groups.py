"""Equal operations joined: from one graph of scalar expressions to groups of operations that can be done side by side.

Expressions are gone through level by level, a level being what can be computed once those before are. Two expressions of a level
belong to one group where they are the same operation on operands of the same groups; what finds no company is joined by operation
alone, and its operands are gathered. The members of a group are its lanes, ordered as their operands are, so that the k-th lane
mostly needs the k-th lane of another group, or the one after: then it can be loaded without gathering.

The stages of the elimination bound the levels (`Equations.phases`): without them equal steps in loops that are finished in
different rounds would drift apart.
"""

from bisect import bisect_right
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

from gauss_bench.compiler.elimination.side_by_side import Equations
from gauss_bench.compiler.expressions.export import reachable
from gauss_bench.compiler.expressions.node import Node

FEW = 6  # equal operations; fewer are done one by one
ALIGNED = 12  # equal operations with operands that stand side by side, so many that gathering them with others would cost more
COMMUTATIVE = ("ADD", "MUL")


class Term(NamedTuple):
    """An operand: a value, or a number, and whether it counts negative."""

    value: int
    negative: bool


@dataclass(frozen=True, eq=False)
class Group:
    """One operation in several lanes.

    Attributes:
        operation: ADD, MUL, INV, SQRT, SIN, COS, FMIN, FMAX, LE; IS, the operand itself; SUM, over all lanes of its operand; OUT,
            an acceleration or the guard.
        results: the values by lane; the one of a SUM; coordinates of an OUT.
        operands: for each operand the values by lane.
        negative: for each operand whether it counts negative.
    """

    operation: str
    results: tuple[int, ...]
    operands: tuple[tuple[int, ...], ...]
    negative: tuple[bool, ...]

    @property
    def lanes(self) -> int:
        return len(self.operands[0])


@dataclass(frozen=True, eq=False)
class Groups:
    """Groups in an order in which they can be computed.

    Attributes:
        numbers: the values that are numbers; inputs: those that come from outside, by name and index.
    """

    groups: list[Group]
    numbers: dict[int, float]
    inputs: dict[int, tuple[str, int]]

    @property
    def operations(self) -> int:
        return sum(g.lanes for g in self.groups if g.operation != "OUT")


Kind = tuple[object, ...]
Member = tuple[int, tuple[Term, ...]]  # a value, and what it is made of


def term(node: Node) -> Term:
    return Term(node.args[0].index, True) if node.op == "NEG" else Term(node.index, False)


class _Grouping:
    """Groups in the making; kinds and lanes tell where a value stands."""

    def __init__(self, equations: Equations):
        self.equations = equations
        n = equations.mechanism.n
        self.nodes = reachable([*equations.a, equations.sound])
        self.numbers = {x.index: float(x.number) for x in self.nodes if x.number is not None}
        self.inputs = {x.index: (str(x.args[0]), int(x.args[1])) for x in self.nodes if x.op == "INPUT"}
        self.groups: list[Group] = []
        self.kind: dict[int, Kind] = dict.fromkeys(self.numbers, ("number",))
        self.lane: dict[int, int] = dict.fromkeys(self.numbers, 0)
        for value, (name, k) in self.inputs.items():
            self.kind[value], self.lane[value] = (name, k % 3), k // 3
        for value, (array, lane) in equations.homes.items():
            self.kind[value], self.lane[value] = (array,), lane
        self.spare = max((x.index for x in self.nodes), default=0) + 1
        self.n = n

    def made(self) -> Groups:
        for level in self._levels():
            self._level(level)
        found: dict[Kind, list[tuple[int, Term]]] = {}
        for j, node in enumerate(self.equations.a):
            t = term(node)
            found.setdefault((j % 3, self.kind[t.value], t.negative), []).append((j, t))
        for members in found.values():
            self.groups.append(_group("OUT", [(j, (t,)) for j, t in members]))
        self.groups.append(_group("OUT", [(self.n, (term(self.equations.sound),))]))
        return Groups(self.groups, self.numbers, self.inputs)

    def _levels(self) -> Iterable[list[Node]]:
        """Nodes by stage and depth within it."""
        depth: dict[int, tuple[int, int]] = {}
        found: dict[tuple[int, int], list[Node]] = {}
        for x in self.nodes:
            if x.op in ("CONST", "INPUT", "NEG"):
                continue
            stage = bisect_right(self.equations.phases, x.index)
            before = [depth[t.value] for t in map(term, x.args) if t.value in depth]
            depth[x.index] = (stage, max((d + 1 for s, d in before if s == stage), default=0))
            found.setdefault(depth[x.index], []).append(x)
        return [found[key] for key in sorted(found)]

    def _level(self, nodes: list[Node]) -> None:
        alike: dict[Kind, list[Member]] = {}
        for x in nodes:
            if x.op == "SUM":
                self._sum(x)
                continue
            operation, terms = self._terms(x)
            key: Kind = (operation, *((self.kind[t.value], t.negative) for t in terms))
            alike.setdefault(key, []).append((x.index, terms))
        left: dict[Kind, list[Member]] = {}
        for key, members in alike.items():
            if len(members) >= FEW:
                for part in self._aligned(members):
                    self._keep(str(key[0]), part)
            else:
                rough = (key[0], *((t.negative, t.value in self.numbers) for t in members[0][1]))
                left.setdefault(rough, []).extend(members)
        for key, members in left.items():
            for part in [members] if len(members) >= FEW else [[x] for x in members]:
                self._keep(str(key[0]), part)

    def _aligned(self, members: list[Member]) -> list[list[Member]]:
        """Members whose operands are a fixed number of lanes apart by themselves, where these are many; the others together."""
        apart: dict[tuple[int, ...], list[Member]] = {}
        for x in members:
            lanes = [self.lane[t.value] for t in x[1] if t.value not in self.numbers]
            apart.setdefault(tuple(k - lanes[0] for k in lanes), []).append(x)
        many = [part for part in apart.values() if len(part) >= ALIGNED]
        rest = [x for part in apart.values() if len(part) < ALIGNED for x in part]
        return [*many, rest] if len(rest) >= FEW else [*many, *([x] for x in rest)]

    def _terms(self, x: Node) -> tuple[str, tuple[Term, ...]]:
        terms = [term(a) for a in x.args]
        if x.op == "SUB":
            terms[1] = Term(terms[1].value, not terms[1].negative)
        operation = "ADD" if x.op == "SUB" else x.op
        if operation in COMMUTATIVE:
            terms.sort(key=lambda t: (repr(self.kind[t.value]), t.negative, self.lane[t.value]))
        return operation, tuple(terms)

    def _keep(self, operation: str, members: list[Member]) -> None:
        members.sort(key=lambda x: [(repr(self.kind[t.value]), self.lane[t.value]) for t in x[1]])
        number = len(self.groups)
        self.groups.append(_group(operation, members))
        for lane, (value, _) in enumerate(members):
            if value not in self.kind:
                self.kind[value], self.lane[value] = ("group", number), lane

    def _sum(self, x: Node) -> None:
        """A long sum: each kind of summands by itself, and these sums one by one."""
        alike: dict[Kind, list[Term]] = {}
        for t in map(term, x.args):
            alike.setdefault((self.kind[t.value], t.negative), []).append(t)
        parts = []
        for terms in alike.values():
            terms.sort(key=lambda t: self.lane[t.value])
            parts.append(self._partial("SUM", [terms]))
        while len(parts) > 1:
            a, b = (Term(p, False) for p in parts[:2])
            parts = [*parts[2:], self._partial("ADD", [[a], [b]])]
        last = self.groups.pop()
        self.groups.append(Group(last.operation, (x.index,), last.operands, last.negative))
        self.kind[x.index], self.lane[x.index] = ("group", len(self.groups) - 1), 0

    def _partial(self, operation: str, operands: list[list[Term]]) -> int:
        value = self.spare
        self.spare += 1
        values, signs = (tuple(t.value for t in x) for x in operands), tuple(x[0].negative for x in operands)
        self.groups.append(Group(operation, (value,), tuple(values), signs))
        self.kind[value], self.lane[value] = ("group", len(self.groups) - 1), 0
        return value


def _group(operation: str, members: list[Member]) -> Group:
    columns = list(zip(*(terms for _, terms in members), strict=True))
    operands = tuple(tuple(t.value for t in column) for column in columns)
    return Group(operation, tuple(value for value, _ in members), operands, tuple(column[0].negative for column in columns))


def grouped(equations: Equations) -> Groups:
    """The groups that compute accelerations and their guard."""
    return _Grouping(equations).made()
