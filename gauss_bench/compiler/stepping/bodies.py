"""The body of a stepping loop as text: all stages written out, or one stage gone through four times.

Written out, equal expressions of different stages are one value, sines rotate from stage to stage, and the processor overlaps the
stages; the code is as long as four accelerations. Once it no longer fits the instruction cache (32 kB on most processors, about
11 bytes an operation), each turn of the loop fetches it anew and takes two to three times as long: then one stage is written, and
looped over.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from gauss_bench.compiler.machine.graph import Graph
from gauss_bench.compiler.machine.llvm import Writer
from gauss_bench.compiler.machine.rewrite import rewrite
from gauss_bench.compiler.machine.schedule import live, order
from gauss_bench.compiler.machine.trigonometry import sincos
from gauss_bench.compiler.stepping.stages import Stage, rk4_end, rk4_stage
from gauss_bench.compiler.stepping.steps import Code, Reach, Step


@dataclass(frozen=True, eq=False)
class Turn:
    """What the skeleton of the loop needs of a body that has been written: names in the text.

    Attributes:
        carried: name of a leaf -> its value at the next step.
        out: q, v (2n) to be stored.
        regular, regular_out, within: masks, as in Step.
    """

    carried: dict[str, str]
    out: list[str]
    regular: str
    regular_out: str
    within: str


class Body(Protocol):
    """Something that writes one step."""

    @property
    def operations(self) -> int: ...
    def prepare(self, w: Writer, fixed: Mapping[str, str]) -> None:
        """Before the loop: what does not change in it; `fixed` names the leaves that do not."""
        ...

    def first(self, w: Writer, state: Mapping[str, str]) -> dict[str, str]:
        """Before the loop: first values of what is carried beyond q and v."""
        ...

    def write(self, w: Writer) -> Turn: ...


def constant_values(g: Graph, values: list[int], fixed: Mapping[str, str]) -> list[int]:
    """Values that depend on fixed leaves and numbers only."""
    found: dict[int, bool] = {}
    for x in sorted(values):
        leaf = g.operation[x] == "leaf"
        found[x] = str(g.payload[x]) in fixed if leaf else all(found[k] for k in g.operands[x])
    return [x for x, constant in found.items() if constant]


def leaves(g: Graph, values: list[int]) -> dict[str, int]:
    return {str(g.payload[x]): x for x in values if g.operation[x] == "leaf"}


def count_operations(g: Graph, values: list[int]) -> int:
    return sum(g.operation[x] not in ("const", "leaf") for x in values)


def shortened(step: Step) -> Step:
    """The step with its arithmetic regrouped."""
    graph, roots = rewrite(step.graph, step.roots())
    moved = dict(zip(step.roots(), roots, strict=True))
    regular, regular_out = (None if m is None else moved[m] for m in (step.regular, step.regular_out))
    carried = {name: moved[x] for name, x in step.carried.items()}
    return Step(graph, carried, [moved[x] for x in step.out], regular, regular_out, moved[step.within])


class WrittenOut:
    """A step in one piece."""

    def __init__(self, code: Code, step: Step):
        self.code, self.step = code, shortened(step)
        g = self.step.graph
        self.values = order(g, live(g, self.step.roots()), self.step.carried)
        self.operations = count_operations(g, self.values)

    def prepare(self, w: Writer, fixed: Mapping[str, str]) -> None:
        for name, x in leaves(self.step.graph, self.values).items():
            w.names[x] = fixed.get(name, name)
        w.write(self.step.graph, constant_values(self.step.graph, self.values, fixed))

    def first(self, w: Writer, state: Mapping[str, str]) -> dict[str, str]:
        if not any(name.startswith("%s") for name in self.step.carried):
            return {}
        return sines(w, {i: state[f"%q{i}"] for i in self.code.angles})

    def write(self, w: Writer) -> Turn:
        step = self.step
        w.write(step.graph, self.values)
        carried = {name: w.names[x] for name, x in step.carried.items()}
        masks = (w.everywhere(step.regular), w.everywhere(step.regular_out), w.everywhere(step.within))
        return Turn(carried, [w.names[x] for x in step.out], *masks)


def sines(w: Writer, angles: Mapping[int, str]) -> dict[str, str]:
    """Sine and cosine of angles in the text, from nothing: "%s2", "%c2" of angle 2 ..."""
    g, found = Graph(), dict[str, str]()
    outer, w.names = w.names, {}
    for i, name in angles.items():
        q = g.leaf(name)
        w.names[q] = name
        pair = sincos(g, q)
        w.write(g, live(g, pair))
        found |= {f"%s{i}": w.names[pair[0]], f"%c{i}": w.names[pair[1]]}
    w.names = outer
    return found


class Looped:
    """A step of Runge-Kutta as four turns of an inner loop, one stage each, and what comes after them.

    c = h/2, h/2, h is the way from stage to stage, w = 1, 2, 2, 1 the weight of a stage.
    """

    def __init__(self, code: Code, reach: Reach):
        self.code, self.reach = code, reach
        self.stage, self.end = regrouped(rk4_stage(code, reach)), regrouped(rk4_end(code, reach))
        self.operations = sum(count_operations(s.graph, live(s.graph, s.roots())) for s in (self.stage, self.end))

    def prepare(self, w: Writer, fixed: Mapping[str, str]) -> None:
        self.half = w.let("fmul double %h, 0.5")
        self.named: list[dict[int, str]] = []
        for s in (self.stage, self.end):
            w.names = {x: fixed[name] for name, x in leaves(s.graph, live(s.graph, s.roots())).items() if name in fixed}
            w.write(s.graph, constant_values(s.graph, live(s.graph, s.roots()), fixed))
            self.named.append(w.names)

    def first(self, w: Writer, state: Mapping[str, str]) -> dict[str, str]:
        return {}

    def write(self, w: Writer) -> Turn:
        n = self.code.program.n
        pairs = sines(w, {i: f"%q{i}" for i in self.code.angles}) if self.reach.rotates else {}
        above = w.block
        w.line("  br label %stage")
        w.label("stage")
        header = len(w.lines)
        w.line("")
        w.line("  %early = icmp ult i64 %j, 2\n  %whole = fadd double %h, 0.0")
        w.line(f"  %way = select i1 %early, double {self.half}, double %whole")
        inner = w.let("add i64 %j, 1")
        w.line(f"  %outer = icmp ult i64 {w.let(f'and i64 {inner}, 3')}, 2\n  %weight = select i1 %outer, double 1.0, double 2.0")
        names = pairs | {
            f"%{name}": w.broadcast(f"%{scalar}") for name, scalar in (("t", "time"), ("way", "way"), ("weight", "weight"))
        }
        turn = self._part(w, self.stage, self.named[0], names)
        start = {f"%{a}{i}": f"%{b}{i}" for a, b in (("x", "q"), ("u", "v")) for i in range(n)}
        start |= {f"%{a}{i}": w.const(0.0) for a in ("X", "U") for i in range(n)}
        true = w.splat("true", "i1")
        good = [w.let(f"and {w.mask} %{mask}, {x}") for mask, x in (("even", turn.regular), ("near", turn.within))]
        w.line("  %later = fadd double %t_now, %way\n  %j_next = add i64 %j, 1\n  %last = icmp eq i64 %j, 3")
        w.line("  br i1 %last, label %end, label %stage")
        below = w.block
        w.label("end")
        phis = [f"  {k} = phi {w.real} [{start[k]}, %{above}], [{x}, %{below}]" for k, x in turn.carried.items()]
        phis += [f"  %{k} = phi {w.mask} [{true}, %{above}], [{x}, %{below}]" for k, x in zip(("even", "near"), good, strict=True)]
        phis += [f"  %j = phi i64 [0, %{above}], [%j_next, %{below}]"]
        phis += [f"  %time = phi double [%t_now, %{above}], [%later, %{below}]"]
        w.lines[header] = "\n".join(phis)
        after = {name: x for name, x in turn.carried.items() if name[:2] in ("%X", "%U")}
        end = self._part(w, self.end, self.named[1], after)
        masks = [w.let(f"and {w.mask} {a}, {b}") for a, b in zip(good, (end.regular, end.within), strict=True)]
        return Turn(end.carried, [f"%{a}{i}" for a in "qv" for i in range(n)], masks[0], true, masks[1])

    def _part(self, w: Writer, s: Stage, constants: dict[int, str], given: Mapping[str, str]) -> Turn:
        w.names = dict(constants)
        values = live(s.graph, s.roots())
        for name, x in leaves(s.graph, values).items():
            w.names.setdefault(x, given.get(name, name))
        w.write(s.graph, order(s.graph, values, s.carried))
        carried = {name: w.names[x] for name, x in s.carried.items()}
        return Turn(carried, [], w.everywhere(s.regular), w.splat("true", "i1"), w.everywhere(s.within))


def regrouped(s: Stage) -> Stage:
    graph, roots = rewrite(s.graph, s.roots())
    moved = dict(zip(s.roots(), roots, strict=True))
    regular = None if s.regular is None else moved[s.regular]
    return Stage(graph, {name: moved[x] for name, x in s.carried.items()}, regular, moved[s.within])
