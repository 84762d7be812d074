"""The functions of a large linkage as text of LLVM: its accelerations, and steps of Runge and Kutta around them.

    void accelerate(ptr y, ptr memory, ptr t, ptr out, i64 groups)
    void rollout(ptr y, ptr memory, double h, double t0, i64 n, i64, ptr, ptr report, i64, i64 groups)

with the signatures of loops.py, but coordinates in another order (large_loops.py), memory to work in in place of parameters, and
no samples: arguments without a name are not used. Arrays are C-contiguous doubles, a group being one trajectory or W of them, the
lane last:

    y        (groups, state, W)    q and v; those after the last step that counts
    out      (groups, out, W)      accelerations, and behind them the number of guards that hold
    report   (groups, 3, W)        steps done; 1 if all are; 0

A trajectory stops before the first step in which a guard fails at any stage. With the stage at q_s, v_s

    a = a(t, q_s, v_s),   X += w v_s,   U += w a,   q_s = q + c v_s,   v_s = v + c a;      q' = q + h/6 X,   v' = v + h/6 U
"""

from collections.abc import Callable
from dataclasses import dataclass

from gauss_bench.compiler.machine.llvm import LoopWriter, Text, declarations
from gauss_bench.compiler.machine.loops import LoopedProgram, Memory

# c, w, and time since the step began; what the last stage leaves at q_s, v_s is not used
STAGES = (("%half", 1.0, "%none"), ("%half", 2.0, "%half"), ("%h", 2.0, "%half"), ("%none", 1.0, "%h"))


@dataclass(frozen=True, eq=False)
class Sizes:
    """Elements of memory that functions work in: that of the loops, and behind it X and U."""

    memory: Memory

    @property
    def total(self) -> int:
        return self.memory.size + self.memory.state


def module(program: LoopedProgram, across: int, trajectories: int, name: str) -> str:
    """The module with a function, "accelerate", "rollout_rk4" or "rollout_semi_implicit_euler".

    `across` lanes of a loop are in one vector, or `trajectories`; one of them is 1.
    """
    w = Text(across, trajectories)
    w.line("define internal void @evaluate(ptr noalias %a) {\nentry:")
    writer = LoopWriter(w, program.groups, program.loops, program.memory)
    for loop in program.loops:
        writer.write(loop)
    w.line("  ret void\n}")
    w.width(w.trajectories)
    if name == "accelerate":
        _accelerate(w, program.memory)
    else:
        _rollout(w, Sizes(program.memory), program.guards, name.partition("_")[2])
    widths = {x for x in (1, 2, 4, 8) if x <= max(across, 1)} | {trajectories}
    intrinsics = ("void @llvm.memcpy.p0.p0.i64(ptr, ptr, i64, i1)", "void @llvm.memset.p0.i64(ptr, i8, i64, i1)")
    return "\n".join([*declarations(widths), *(f"declare {x}" for x in intrinsics), *w.table_lines(), *w.lines])


def _copy(w: Text, target: str, source: str, elements: int) -> None:
    w.line(f"  call void @llvm.memcpy.p0.p0.i64(ptr {target}, ptr {source}, i64 {8 * w.trajectories * elements}, i1 false)")


def _accelerate(w: Text, m: Memory) -> None:
    w.line("define void @accelerate(ptr noalias %y, ptr noalias %a, ptr noalias %t, ptr noalias %out, i64 %groups) {\nentry:")
    w.line("  br label %loop\nloop:\n  %k = phi i64 [0, %entry], [%next, %loop]")
    _copy(w, "%a", w.address("%y", w.let(f"mul i64 %k, {m.state}")), m.state)
    w.store(w.let(f"load {w.real}, ptr {w.address('%t', '%k')}, align 8"), "%a", m.t)
    w.line("  call void @evaluate(ptr %a)")
    _copy(w, w.address("%out", w.let(f"mul i64 %k, {m.out}")), w.address("%a", m.a), m.out)
    w.line("  %next = add i64 %k, 1\n  %more = icmp slt i64 %next, %groups\n  br i1 %more, label %loop, label %done\ndone:")
    w.line("  ret void\n}")


def _pass(w: Text, head: str, count: int, write: Callable[[str], None]) -> None:
    """A function that does the same to elements 0 to `count` - 1, of which there are whole vectors."""
    at_once = w.across
    w.line(f"define internal void {head} {{\nentry:\n  br label %loop\nloop:\n  %k = phi i64 [0, %entry], [%next, %loop]")
    w.width(max(w.across, w.trajectories))
    write("%k")
    w.width(w.trajectories)
    w.line(
        f"  %next = add i64 %k, {at_once}\n  %more = icmp ult i64 %next, {count}\n  br i1 %more, label %loop, label %done\ndone:"
    )
    w.line("  ret void\n}")


def _advance(w: Text, sizes: Sizes) -> None:
    """To the next stage, and to the sums."""
    m, half = sizes.memory, sizes.memory.state // 2

    def write(k: str) -> None:
        way, weight = w.broadcast("%c"), w.broadcast("%w")
        rates = _load(w, "%a", k, half), _load(w, "%a", k, m.a)
        for start, rate in zip((0, half), rates, strict=True):
            _store(w, _fma(w, weight, rate, _load(w, "%a", k, m.size + start)), "%a", k, m.size + start)
            _store(w, _fma(w, way, rate, _load(w, "%y", k, start)), "%a", k, start)

    _pass(w, "@advance(ptr noalias %y, ptr noalias %a, double %c, double %w)", half, write)


def _finish(w: Text, sizes: Sizes) -> None:
    """To the end of the step, where it counts."""

    def write(k: str) -> None:
        old = _load(w, "%y", k, 0)
        new = _fma(w, w.broadcast("%sixth"), _load(w, "%a", k, sizes.memory.size), old)
        _store(w, new if w.trajectories == 1 else w.select("%ok", new, old), "%y", k, 0)

    mask = w.mask
    _pass(w, f"@finish(ptr noalias %y, ptr noalias %a, double %sixth, {mask} %ok)", sizes.memory.state, write)


def _load(w: Text, base: str, k: str, first: int) -> str:
    return w.let(f"load {w.real}, ptr {_at(w, base, k, first)}, align 8")


def _store(w: Text, value: str, base: str, k: str, first: int) -> None:
    w.line(f"  store {w.real} {value}, ptr {_at(w, base, k, first)}, align 8")


def _at(w: Text, base: str, k: str, first: int) -> str:
    return w.address(base, w.let(f"add i64 {k}, {first}"), w.element)


def _fma(w: Text, a: str, b: str, c: str) -> str:
    return w.let(f"call {w.real} @llvm.fma.{w.suffix}({w.real} {a}, {w.real} {b}, {w.real} {c})")


def _euler(w: Text, m: Memory) -> None:
    """v' = v + h a, q' = q + h v', where the step counts."""
    half = m.state // 2

    def write(k: str) -> None:
        way, q, v = w.broadcast("%h"), _load(w, "%y", k, 0), _load(w, "%y", k, half)
        faster = _fma(w, way, _load(w, "%a", k, m.a), v)
        for start, old, new in ((half, v, faster), (0, q, _fma(w, way, faster, q))):
            _store(w, new if w.trajectories == 1 else w.select("%ok", new, old), "%y", k, start)

    _pass(w, f"@finish(ptr noalias %y, ptr noalias %a, double %h, {w.mask} %ok)", half, write)


def _rollout(w: Text, sizes: Sizes, guards: int, integrator: str) -> None:
    m = sizes.memory
    if integrator == "rk4":
        _advance(w, sizes)
        _finish(w, sizes)
    else:
        _euler(w, m)
    names = ("ptr noalias %y", "ptr noalias %a", "double %h", "double %t0", "i64 %n", "i64 %every", "ptr %samples")
    w.line(f"define void @rollout({', '.join(names)}, ptr noalias %report, i64 %slots, i64 %groups) {{\nentry:")
    w.line(
        "  %half = fmul double %h, 0.5\n  %sixth = fdiv double %h, 6.0\n  %none = fmul double %h, 0.0\n  br label %group\ngroup:"
    )
    w.line("  %g = phi i64 [0, %entry], [%g_next, %finish]")
    state, report = w.address("%y", w.let(f"mul i64 %g, {m.state}")), w.address("%report", w.let("mul i64 %g, 3"))
    w.line("  br label %step\nstep:\n  %i = phi i64 [0, %group], [%i_next, %stepped]")
    w.line(f"  %alive = phi {w.mask} [{w.splat('true', 'i1')}, %group], [%ok, %stepped]")
    w.line(f"  %done = phi {w.real} [{w.const(0.0)}, %group], [%done_next, %stepped]")
    w.line("  %left = icmp slt i64 %i, %n\n  br i1 %left, label %go, label %finish\ngo:")
    w.line("  %count = sitofp i64 %i to double\n  %passed = fmul double %count, %h\n  %time = fadd double %t0, %passed")
    good = _stages(w, sizes, guards, state) if integrator == "rk4" else _one_stage(w, m, guards, state)
    w.line(f"  %ok = and {w.mask} %alive, {good}")
    w.line(f"  %done_next = fadd {w.real} %done, {w.select('%ok', w.const(1.0), w.const(0.0))}")
    w.line(f"  %on = or i1 {w.any('%ok')}, false\n  br i1 %on, label %stepped, label %finish\nstepped:")
    way = "%sixth" if integrator == "rk4" else "%h"
    w.line(f"  call void @finish(ptr {state}, ptr %a, double {way}, {w.mask} %ok)\n  %i_next = add i64 %i, 1\n  br label %step")
    w.line(f"finish:\n  %steps = phi {w.real} [%done, %step], [%done_next, %go]")
    w.line("  %all = sitofp i64 %n to double")
    complete = w.let(f"fcmp oeq {w.real} %steps, {w.broadcast('%all')}")
    for row, value in enumerate(("%steps", w.select(complete, w.const(1.0), w.const(0.0)), w.const(0.0))):
        w.store(value, report, row)
    w.line("  %g_next = add i64 %g, 1\n  %more = icmp slt i64 %g_next, %groups\n  br i1 %more, label %group, label %end\nend:")
    w.line("  ret void\n}")


def _one_stage(w: Text, m: Memory, guards: int, state: str) -> str:
    """The accelerations at the beginning of the step; returns the mask of guards that hold."""
    _copy(w, "%a", state, m.state)
    w.store(w.broadcast(w.let("fadd double %time, %none")), "%a", m.t)
    w.line("  call void @evaluate(ptr %a)")
    return _hold(w, m, guards)


def _hold(w: Text, m: Memory, guards: int) -> str:
    """Mask where all guards hold."""
    return w.let(f"fcmp oeq {w.real} {w.load('%a', m.a + m.coordinate(3 * m.links))}, {w.const(float(guards))}")


def _stages(w: Text, sizes: Sizes, guards: int, state: str) -> str:
    """The four stages, written out; returns the mask of guards that hold at all of them."""
    m = sizes.memory
    _copy(w, "%a", state, m.state)
    sums, size = w.address("%a", m.size), 8 * w.trajectories * m.state
    w.line(f"  call void @llvm.memset.p0.i64(ptr {sums}, i8 0, i64 {size}, i1 false)")
    good = w.splat("true", "i1")
    for c, weight, since in STAGES:
        w.store(w.broadcast(w.let(f"fadd double %time, {since}")), "%a", m.t)
        w.line("  call void @evaluate(ptr %a)")
        good = w.let(f"and {w.mask} {good}, {_hold(w, m, guards)}")
        w.line(f"  call void @advance(ptr {state}, ptr %a, double {c}, double {weight})")
    return good
