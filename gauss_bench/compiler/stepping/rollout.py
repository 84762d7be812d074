"""Native time stepping: a step of an integrator becomes one loop whose state never touches memory.

    void rollout(ptr y, ptr p, double h, double t0, i64 n, i64 every, ptr samples, ptr report, i64 slots, i64 groups)

steps `groups` groups of W trajectories each, all by n steps. Arrays are C-contiguous doubles with the lane last:

    y        (groups, 2 n_q, W)           q and v at the start; where a trajectory stopped early, the state it stopped at
    p        (groups, n_p, W)             parameters
    samples  (groups, slots, 2 n_q, W)    every `every` steps, and the last; slots = ceil(n / every), at least one
    report   (groups, 3, W)               steps done; 1 if all are; 1 if it stopped because a reach was exceeded and nothing else

A trajectory stops before the first step whose guards fail: that step is not counted. With several lanes the others go on, and the
stopped one keeps its state by selection. Only a turn of the loop that finds the end stores anything: it runs once more than there
are steps, since what is stored belongs to the beginning of a step (with projection, velocities are corrected there).

    void accelerate(ptr y, ptr p, ptr t, ptr out, i64 groups)

evaluates accelerations; t (groups, 1, W), out (groups, n_q + 1, W), whose last row is 1 where the guards hold.

The body of the loop has all stages written out, or one stage gone through four times. Written out, equal expressions of different
stages are one value, sines rotate from stage to stage, and the processor overlaps the stages; the code is as long as four
accelerations. Once it no longer fits the instruction cache (32 kB on most processors, about 11 bytes an operation), each turn of
the loop fetches it anew and takes two to three times as long: then one stage is written, and looped over.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from gauss_bench.compiler.machine.code import Code
from gauss_bench.compiler.machine.graph import Graph, constant_values, count_operations, leaves, live, order, rewrite
from gauss_bench.compiler.machine.llvm import Listing, Writer
from gauss_bench.compiler.machine.trigonometry import sincos
from gauss_bench.compiler.stepping.steps import EXACT, STEPS, Builder, Reach, Stage, Step, rk4_end, rk4_stage


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
    g, names = Graph(), dict[str, str]()
    outer, w.names = w.names, {}
    for i, name in angles.items():
        q = g.leaf(name)
        w.names[q] = name
        pair = sincos(g, q)
        w.write(g, live(g, pair))
        names |= {f"%s{i}": w.names[pair[0]], f"%c{i}": w.names[pair[1]]}
    w.names = outer
    return names


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


ARGUMENTS = "ptr noalias %y, ptr noalias %p, double %h, double %t0, i64 %n, i64 %every, ptr noalias %samples, ptr noalias %report"
WRITTEN_OUT = 2_900  # operations of a step; beyond it the code outgrows the caches of instructions


def body(code: Code, integrator: str, reach: Reach, longest: int = WRITTEN_OUT) -> Body:
    """The step written out where it stays short, else looped over its stages."""
    if integrator == "rk4" and 4 * code.acceleration.operations > longest:
        return Looped(code, reach)
    written = WrittenOut(code, STEPS[integrator](code, reach))
    return Looped(code, reach) if integrator == "rk4" and written.operations > longest else written


def rollout(code: Code, integrator: str, reach: Reach, lanes: int, longest: int = WRITTEN_OUT) -> Listing:
    """The module that steps by one integrator within one reach."""
    step = body(code, integrator, reach, longest)
    loop = _RolloutWriter(code, step, lanes)
    return Listing("\n".join((loop.w.declarations(), loop.text(), _over_groups(code, lanes))), step.operations)


class _RolloutWriter:
    """Writes the function that steps one group, around a body."""

    def __init__(self, code: Code, body: Body, lanes: int):
        self.code, self.body, self.w = code, body, Writer(lanes)

    def text(self) -> str:
        w = self.w
        w.line(f"define internal void @group({ARGUMENTS}) align 64 {{\nentry:")
        first = self._entry()
        above = w.block
        w.line("  br label %loop")
        w.label("loop")
        header = len(w.lines)
        w.line("")
        self._time()
        turn = self.body.write(w)
        following = self._verdict(turn)
        kinds = dict.fromkeys(following, w.real) | {"%alive": w.mask, "%far": w.mask, "%i": "i64", "%due": "i64", "%slot": "i64"}
        w.lines[header] = "\n".join(
            f"  {name} = phi {kinds[name]} [{first[name]}, %{above}], [{x}, %check]" for name, x in following.items()
        )
        self._sample(turn)
        self._finish(turn)
        return "\n".join(w.lines)

    def _entry(self) -> dict[str, str]:
        """Load the state, and do what does not change in the loop; returns the first value of everything carried."""
        w, n = self.w, self.code.program.n
        state = {f"%q{i}": w.load("%y", i) for i in range(n)} | {f"%v{i}": w.load("%y", n + i) for i in range(n)}
        fixed = {f"%p{i}": w.load("%p", i) for i in range(self.code.program.n_parameters)} | {"%h": w.broadcast("%h")}
        self.body.prepare(w, fixed)
        due = w.let("call i64 @llvm.smin.i64(i64 %every, i64 %n)")
        masks = {"%alive": w.splat("true", "i1"), "%far": w.splat("false", "i1")}
        counters = {"%done": w.const(0.0), "%i": "0", "%due": due, "%slot": "0"}
        return state | self.body.first(w, state) | masks | counters

    def _time(self) -> None:
        """t = t0 + i h, as a number and in every lane."""
        w = self.w
        w.line("  %count = sitofp i64 %i to double\n  %passed = fmul double %count, %h\n  %t_now = fadd double %t0, %passed")
        w.line(f"  %t = fadd {w.real} {w.broadcast('%t_now')}, {w.const(-0.0)}")

    def _verdict(self, turn: Turn) -> dict[str, str]:
        """Who goes on, and the next value of everything carried."""
        w = self.w
        good = w.let(f"and {w.mask} {turn.regular}, {turn.within}")
        alive = w.let(f"and {w.mask} %alive, {good}")
        far = w.let(f"or {w.mask} %far, {w.let(f'and {w.mask} %alive, {self._beyond(turn)}')}")
        done = w.let(f"fadd {w.real} %done, {w.select(alive, w.const(1.0), w.const(0.0))}")
        following = dict(turn.carried)
        if w.lanes > 1:  # a lane that stopped keeps its state
            following = {name: w.select(alive, x, name) for name, x in following.items()}
        w.line(f"  %next = add i64 %i, 1\n  %go = or i1 {w.any(alive)}, false\n  %stop = icmp eq i64 %i, %due")
        self.last = w.block
        w.line("  br i1 %stop, label %sample, label %check")
        masks = {"%alive": alive, "%far": far} if w.lanes > 1 else {"%alive": "true", "%far": "false"}
        return following | masks | {"%done": done, "%i": "%next", "%due": "%due_next", "%slot": "%slot_next"}

    def _beyond(self, turn: Turn) -> str:
        """Where all pivots are fine and yet a reach is exceeded: another partition would not help."""
        w = self.w
        beyond = w.let(f"xor {w.mask} {turn.within}, {w.splat('true', 'i1')}")
        return w.let(f"and {w.mask} {turn.regular}, {beyond}")

    def _sample(self, turn: Turn) -> None:
        """Store what is due; then on, or to the end."""
        w = self.w
        w.label("sample")
        base = w.address("%samples", w.let(f"mul i64 %slot, {len(turn.out) * w.lanes}"), "double")
        for row, x in enumerate(turn.out):
            w.store(x, base, row)
        later = w.let("add i64 %due, %every")
        w.line(f"  %due_later = call i64 @llvm.smin.i64(i64 {later}, i64 %n)\n  %slot_later = add i64 %slot, 1")
        w.line(f"  %complete = and {w.mask} %alive, {turn.regular_out}")
        w.line("  %ended = icmp eq i64 %i, %n\n  br i1 %ended, label %finish, label %check\ncheck:")
        for name in ("due", "slot"):
            w.line(f"  %{name}_next = phi i64 [%{name}, %{self.last}], [%{name}_later, %sample]")
        w.line("  br i1 %go, label %loop, label %finish")

    def _finish(self, turn: Turn) -> None:
        """Store the last state, or the one where a trajectory stopped, and the report."""
        w, n = self.w, self.code.program.n
        w.line(f"finish:\n  %all = phi {w.mask} [%complete, %sample], [{w.splat('false', 'i1')}, %check]")
        raw = [f"%{letter}{i}" for letter in "qv" for i in range(n)]
        for row, (x, name) in enumerate(zip(turn.out, raw, strict=True)):
            w.store(w.select("%all", x, name), "%y", row)
        far = w.let(f"or {w.mask} %far, {w.let(f'and {w.mask} %alive, {self._beyond(turn)}')}")
        one, zero = w.const(1.0), w.const(0.0)
        for row, value in enumerate(("%done", w.select("%all", one, zero), w.select(far, one, zero))):
            w.store(value, "%report", row)
        w.line("  ret void\n}")


def _over_groups(code: Code, lanes: int) -> str:
    """The exported function: one group after the other."""
    n, n_p = code.program.n, code.program.n_parameters
    strides = {"y": f"{2 * n * lanes}", "p": f"{n_p * lanes}", "samples": "%block", "report": f"{3 * lanes}"}
    moves = "".join(
        f"  %{name}_at = mul i64 %k, {stride}\n  %{name}_k = getelementptr double, ptr %{name}, i64 %{name}_at\n"
        for name, stride in strides.items()
    )
    call = "ptr %y_k, ptr %p_k, double %h, double %t0, i64 %n, i64 %every, ptr %samples_k, ptr %report_k"
    return f"""define void @rollout({ARGUMENTS}, i64 %slots, i64 %groups) {{
entry:
  %block = mul i64 %slots, {2 * n * lanes}
  br label %loop
loop:
  %k = phi i64 [0, %entry], [%next, %loop]
{moves}  call void @group({call})
  %next = add i64 %k, 1
  %more = icmp slt i64 %next, %groups
  br i1 %more, label %loop, label %done
done:
  ret void
}}
declare i64 @llvm.smin.i64(i64, i64)"""


def acceleration(code: Code, lanes: int) -> Listing:
    """The module that evaluates accelerations, every sine from nothing."""
    n, n_p = code.program.n, code.program.n_parameters
    b = Builder(code, EXACT)
    a = b.acceleration(b.t, b.q, b.v)
    sound = b.g.both([*b.pivots, b.within(a)])
    assert sound is not None
    flag = b.g.make("select", sound, b.g.const(1.0), b.g.const(0.0))
    inputs = {f"%q{i}": ("%y", i) for i in range(n)} | {f"%v{i}": ("%y", n + i) for i in range(n)} | {"%t": ("%t", 0)}
    inputs |= {f"%p{i}": ("%p", i) for i in range(n_p)}
    return evaluation(b.g, [*a, flag], inputs, {"%y": 2 * n, "%p": n_p, "%t": 1}, lanes)


Inputs = Mapping[str, tuple[str, int]]


def evaluation(g: Graph, roots: list[int], inputs: Inputs, sizes: Mapping[str, int], lanes: int) -> Listing:
    """The module that evaluates a graph; `inputs` maps a leaf to an array and its row, `sizes` an array to its rows."""
    g, roots = rewrite(g, roots)
    values = order(g, live(g, roots), {str(k): x for k, x in enumerate(roots)})
    w = Writer(lanes)
    w.line("define void @accelerate(ptr noalias %y, ptr noalias %p, ptr noalias %t, ptr noalias %out, i64 %groups) {\nentry:")
    w.line("  br label %loop")
    w.label("loop")
    header = len(w.lines)
    w.line("")
    rows = {**sizes, "%out": len(roots)}
    base = {name: w.address(name, w.let(f"mul i64 %k, {count * lanes}"), "double") for name, count in rows.items()}
    for leaf, x in leaves(g, values).items():
        name, row = inputs[leaf]
        w.names[x] = w.load(base[name], row)
    w.write(g, values)
    for row, x in enumerate(roots):
        w.store(w.names[x], base["%out"], row)
    w.lines[header] = f"  %k = phi i64 [0, %entry], [%next, %{w.block}]"
    w.line("  %next = add i64 %k, 1\n  %more = icmp slt i64 %next, %groups\n  br i1 %more, label %loop, label %done")
    w.line("done:\n  ret void\n}")
    return Listing("\n".join((w.declarations(), *w.lines)), count_operations(g, values))
