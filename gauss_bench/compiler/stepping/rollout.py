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
"""

from collections.abc import Mapping
from dataclasses import dataclass

from gauss_bench.compiler.machine.graph import Graph
from gauss_bench.compiler.machine.llvm import Writer
from gauss_bench.compiler.machine.rewrite import rewrite
from gauss_bench.compiler.machine.schedule import live, order
from gauss_bench.compiler.stepping.bodies import Body, Looped, Turn, WrittenOut, count_operations, leaves
from gauss_bench.compiler.stepping.steps import EXACT, STEPS, Builder, Code, Reach

ARGUMENTS = "ptr noalias %y, ptr noalias %p, double %h, double %t0, i64 %n, i64 %every, ptr noalias %samples, ptr noalias %report"
WRITTEN_OUT = 2_900  # operations of a step; beyond it the code outgrows the caches of instructions


@dataclass(frozen=True, eq=False)
class Listing:
    """Code for native_code.py: the text of a module, and operations in one turn of the loop or in one evaluation."""

    text: str
    operations: int


def body(code: Code, integrator: str, reach: Reach, longest: int = WRITTEN_OUT) -> Body:
    """The step written out where it stays short, else looped over its stages."""
    if integrator == "rk4" and 4 * code.acceleration.operations > longest:
        return Looped(code, reach)
    found = WrittenOut(code, STEPS[integrator](code, reach))
    return Looped(code, reach) if integrator == "rk4" and found.operations > longest else found


def rollout(code: Code, integrator: str, reach: Reach, lanes: int, longest: int = WRITTEN_OUT) -> Listing:
    """The module that steps by one integrator within one reach."""
    found = body(code, integrator, reach, longest)
    loop = _Loop(code, found, lanes)
    return Listing("\n".join((loop.w.declarations(), loop.text(), _over_groups(code, lanes))), found.operations)


class _Loop:
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
