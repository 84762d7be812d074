"""Time stepping as a routine: a step of an integrator in a loop whose state never touches memory.

    rollout(y, p, samples, report; h, t0; n, every, slots)

steps a group of trajectories by n steps. Rows of the arrays, each with one number for each trajectory:

    y        2 n_q            q and v at the start; where a trajectory stopped early, the state it stopped at
    p        n_p              parameters
    samples  slots x 2 n_q    every `every` steps, and the last; slots = ceil(n / every), at least one
    report   3                steps done; 1 if all are; 1 if it stopped because the last reach was exceeded and nothing else

A trajectory stops before the first step whose guards fail: that step is not counted. With several lanes the others go on, and the
stopped one keeps its state by selection. Only a turn of the loop that finds the end stores anything: it runs once more than there
are steps, since what is stored belongs to the beginning of a step (with projection, velocities are corrected there).

    accelerate(y, p, t, out)

evaluates accelerations; `out` has n_q + 1 rows, of which the last is 1 where the guards hold. Likewise

    settle(y, p, t, out)

takes a state back onto the constraints; `out` has 2 n_q + 1 rows.

What is stepped is a body, with all stages written out: equal expressions of different stages are one value, sines rotate from stage
to stage, and the processor overlaps the stages. The code grows with the linkage. Where the right-hand side has more than
`steps.LONG` operations, the body of Runge and Kutta's method has it once, in a loop over the stages.
"""

from collections.abc import Sequence

from gauss_bench.compiler.machine.code import Code
from gauss_bench.compiler.machine.graph import (
    Array,
    Compute,
    Graph,
    If,
    Load,
    Loop,
    Routine,
    Statement,
    Store,
    count_operations,
    live,
    order,
    rewrite,
)
from gauss_bench.compiler.machine.trigonometry import sincos
from gauss_bench.compiler.stepping.steps import EXACT, REACHES, STEPS, TINY, Builder, Reach, Step, dop853, is_looped, rk4_looped

Carried = dict[int, tuple[int, int]]  # leaf -> its first and its next value

# steps after which what redundant rows are off is taken back where nothing else does: rows that have drifted apart count as
# independent, and to who takes the rank for granted the linkage locks
SETTLED = 32


class Body:
    """One step, its state carried in registers; `plain` where its arithmetic is left to the target.

    Attributes:
        graph: of the whole routine. rows: numbers of a state.
        arrays: arguments of the routine other than y, samples and report.
        entry: statements before the loop.
        carried: leaf -> its first and its next value, from step to step.
        settled: leaf -> its next value every SETTLED steps, in place of the one that is carried; {} where there is none.
        statements: of one step; values: in order; operations: among them.
    """

    def __init__(self, code: Code, step: Step, plain: bool = False, into: Graph | None = None):
        self.step = step = step if plain else step.rewrite_into(into)
        self.graph, self.rows = step.graph, 2 * code.program.n
        g, n, needed = self.graph, code.program.n, live(step.graph, step.roots())
        self.values = needed if plain else order(g, needed, step.carried)
        self.operations = count_operations(g, self.values)
        self.statements: list[Statement] = [Compute(self.values)]
        if step.stages:
            following = [x for _, x in step.stages.values()]
            again = g.make("below", g.count("%stage"), g.whole(3))
            in_order = order(g, live(g, following), {str(k): x for k, x in enumerate(following)})
            self.statements.insert(0, Loop(step.stages, [Compute(in_order)], again))
        self.y = [g.leaf(f"%y{k}") for k in range(self.rows)]
        self.state = [g.leaf(f"%{x}{i}") for x in "qv" for i in range(n)]
        parameters = {g.leaf(f"%p{k}"): k for k in range(code.program.n_parameters)}
        self.arrays = {"p": Array(len(parameters))}
        self.entry = [Load("y", {x: k for k, x in enumerate(self.y)}), Load("p", parameters)]
        first = {f"%{x}{i}": self.y[k] for k, (x, i) in enumerate((x, i) for x in "qv" for i in range(n))}
        if any(name.startswith("%s") for name in step.carried):
            for i in code.angles:
                first[f"%s{i}"], first[f"%c{i}"] = sincos(g, self.y[i])
        self.carried: Carried = {g.leaf(name): (first[name], x) for name, x in step.carried.items()}
        self.settled = {g.leaf(name): x for name, x in step.settled.items()}

    def store_end(self, complete: int) -> Store:
        """Store the last state in y: the projected one where the mask holds, else the state before the failed step."""
        return Store("y", [self.graph.make("select", complete, x, raw) for x, raw in zip(self.step.out, self.state, strict=True)])


def rollout(bodies: Sequence[Body], many: bool) -> Routine:
    """Build the routine that steps `many` trajectories at once, or one.

    The bodies share one graph. The first steps until its reach is exceeded, the next continues from there, the last has no limit.
    Many trajectories change the body together, so that lanes compute the same bits as a single trajectory.
    """
    first, statements = bodies[0], list[Statement]()
    for level in reversed(range(len(bodies))):
        steps, complete, far = _stepping(bodies, level, many)
        statements = [*steps, *([If(first.graph.make("any", far), statements, {})] if statements else [])]
    arrays = {"y": Array(first.rows), **first.arrays, "samples": Array(first.rows, "slots"), "report": Array(3)}
    counts, operations = ("n", "every", "slots"), max(body.operations for body in bodies)
    return Routine("rollout", first.graph, arrays, ("h", "t0"), counts, [*first.entry, *statements], complete, operations)


def _stepping(bodies: Sequence[Body], level: int, many: bool) -> tuple[list[Statement], int, int]:
    """Return the loop over one of the bodies, the mask of finished trajectories, and the mask of those that need a longer reach."""
    body = bodies[level]
    g, begins, ends = body.graph, level == 0, level == len(bodies) - 1
    i, due, slot, n, every = (g.count(f"%{x}") for x in ("i", "due", "slot", "n", "every"))
    one, zero, always, none = g.whole(1), g.whole(0), g.all(True), g.all(False)
    h, t0, t, done = (g.leaf(f"%{x}") for x in ("h", "t0", "t", "done"))
    alive, far = (g.make("mask", payload=x) for x in ("%alive", "%far")) if many else (always, none)
    # a lane goes on if its guards hold; `beyond`: only its reach was exceeded, a longer one will do
    beyond = g.both([alive, body.step.regular, g.make("not", body.step.within)])
    going = g.both([alive, body.step.regular, body.step.within])
    following, more = g.make("sum", i, one), g.make("below", i, n)
    later = g.make("add", t0, g.make("mul", g.make("number", following), h))
    due_later, slot_later = g.count("%due_later"), g.count("%slot_later")
    settling, chosen, counted = _settling(body, following)
    # a lane that has stopped keeps its state by selection while the others go on
    state = {x: (a, chosen.get(x, b)) for x, (a, b) in body.carried.items()}
    carried: Carried = counted | {x: (a, g.make("select", going, b, x) if many else b) for x, (a, b) in state.items()}
    carried |= {t: (t0, later), done: (g.const(0.0), g.make("add", done, g.flag(going)))}
    carried |= {i: (zero, following), due: (g.make("least", every, n), due_later), slot: (zero, slot_later)}
    carried |= {alive: (always, going)} if many else {}
    if not begins:  # continue from the values at which the previous body stopped
        carried = {x: (x, b) for x, (_, b) in carried.items()}
    carried |= {far: (none, _either(g, far, beyond))} if many else {}
    sample = If(
        g.make("same", i, due),
        [Store("samples", body.step.out, g.make("times", slot, payload=body.rows))],
        {due_later: (g.make("least", g.make("sum", due, every), n), due), slot_later: (g.make("sum", slot, one), slot)},
    )
    again = g.make("also", g.make("any", going), more)
    again = again if ends or not many else g.make("also", again, g.make("nowhere", beyond))
    complete = g.both([alive, body.step.regular_out, g.make("everywhere", g.make("same", i, n))])
    too_far = g.both([_either(g, far, beyond), g.make("not", complete)])
    report = Store("report", [done, g.flag(complete), g.flag(too_far)])
    return [Loop(carried, [*body.statements, sample, *settling], again), body.store_end(complete), report], complete, too_far


def _settling(body: Body, following: int) -> tuple[list[Statement], dict[int, int], Carried]:
    """Return the statements that settle the state after every SETTLED steps, leaf -> its next value, and the carried counter.

    `following` is the number of the next step.
    """
    if not body.settled:
        return [], {}, {}
    g = body.graph
    due, due_later = g.count("%settle"), g.count("%settle_later")
    chosen = {x: g.leaf(f"%next{k}") for k, x in enumerate(body.settled)}
    merged = {chosen[x]: (value, body.carried[x][1]) for x, value in body.settled.items()}
    merged[due_later] = (g.make("sum", due, g.whole(SETTLED)), due)
    return [If(g.make("same", following, due), (), merged)], chosen, {due: (g.whole(SETTLED), due_later)}


def _either(g: Graph, a: int, b: int) -> int:
    return g.make("not", g.both([g.make("not", a), g.make("not", b)]))


def bodies(code: Code, integrator: str, reaches: Sequence[Reach]) -> list[Body]:
    """Build the step for each of some reaches, in one graph."""
    if is_looped(code, integrator):
        return [Body(code, rk4_looped(code))]
    graph = Graph()
    return [Body(code, STEPS[integrator](code, reach), into=graph) for reach in reaches]


SAFETY, SHRINK, GROW = 0.9, 0.2, 10.0  # factors of step size control, usual values: safety, smallest and largest change


def adaptive(code: Code, plain: bool = False) -> Routine:
    """Build the routine `integrate(y, p, times, samples, report; rtol, atol, longest, least, h; count, limit)` for one trajectory.

    DOP853 with the step size controlled by the tolerances. Steps end at each of `count` times, where the state is stored; `times`
    has two more entries. The first step is h and no step is longer than `longest`. The integration stops when a step becomes
    shorter than `least` or after `limit` steps. It leaves the state reached in y and in `report`: samples stored, steps accepted,
    steps attempted, the time reached. Source: Hairer, Norsett and Wanner, Solving Ordinary Differential
    Equations I (1993), section II.10.
    """
    body = Body(code, dop853(code, EXACT, plain, estimated=True), plain)
    g, step = body.graph, body.step
    assert step.error is not None
    i, due, tried, count = (g.count(f"%{x}") for x in ("i", "due", "tried", "count"))
    t, h, wanted, taken, goal = (g.leaf(f"%{x}") for x in ("t", "h", "wanted", "taken", "goal"))
    later, due_later, one, zero = g.count("%later"), g.count("%due_later"), g.whole(1), g.whole(0)
    sample = Store("samples", step.out, g.make("times", i, payload=body.rows))
    store = If(g.make("same", due, one), [sample], {later: (g.make("sum", i, one), i)})
    root = step.error
    for _ in range(4):  # `error` is the squared error norm, ~ h^16: its 16th root is proportional to h
        root = g.make("sqrt", root)
    sound = g.both([step.regular, step.within])
    good = g.both([sound, g.make("le", step.error, g.const(1.0))])
    # step size controller: h_new = h clip(SAFETY / root, SHRINK, GROW), no growth right after a refused step
    ideal = g.make("div", g.const(SAFETY), g.add(root, g.const(TINY)))
    refused = g.make("mask", payload="%refused")
    most = g.make("select", refused, g.const(1.0), g.const(GROW))
    factor = g.maximum(g.minimum(ideal, most), g.const(SHRINK))
    factor = g.make("select", sound, factor, g.const(SHRINK))
    new = g.mul(h, factor)
    # a step cut short by a sample must not reduce the next
    best = g.make("select", g.both([good, g.make("lt", new, wanted)]), wanted, new)
    best = g.minimum(best, g.leaf("%longest"))
    ahead = g.make("sub", goal, t)
    reached = g.both([good, g.make("le", ahead, h)])
    t_new = g.make("select", reached, goal, g.make("select", good, g.add(t, h), t))
    place = If(g.make("any", reached), [], {due_later: (one, zero)})
    further = g.make("sum", later, due_later)
    # if the next sample is less than two steps away, halve the distance: that avoids a tiny last step
    left = g.make("sub", g.leaf("%next"), t_new)
    half = g.mul(g.const(0.5), left)
    shorter = g.make("select", g.make("lt", left, g.mul(g.const(2.0), best)), half, best)
    planned = g.make("select", g.make("le", left, best), left, shorter)
    first = [g.leaf(f"%{x}") for x in ("start", "end")]
    settling, chosen, counted = _settling(body, g.make("sum", tried, one))  # a refused step leaves settling to the next one
    carried = counted | {x: (a, g.make("select", good, chosen.get(x, b), x)) for x, (a, b) in body.carried.items()}
    carried |= {t: (first[0], t_new), goal: (first[1], g.leaf("%next")), h: (g.leaf("%h0"), planned), wanted: (g.leaf("%h0"), best)}
    carried |= {taken: (g.const(0.0), g.add(taken, g.flag(good))), tried: (zero, g.make("sum", tried, one))}
    carried |= {i: (zero, later), due: (one, due_later), refused: (g.all(False), g.make("not", good))}
    hopeless = g.both([g.make("not", good), g.make("lt", planned, g.leaf("%least"))])
    again = g.make("also", g.make("below", later, count), g.make("below", tried, g.count("%limit")))
    again = g.make("also", again, g.make("nowhere", hopeless))
    complete = g.make("everywhere", g.make("same", later, count))
    loads = [Load("times", {first[0]: 0, first[1]: 1}), Load("times", {g.leaf("%next"): 0}, further)]
    loop = Loop(carried, [*body.statements, store, place, *settling, loads[1]], again)
    report = [g.make("number", later), taken, g.make("number", tried), t]
    statements: list[Statement] = [*body.entry, loads[0], loop, body.store_end(complete), Store("report", report)]
    arrays = {"y": Array(body.rows), **body.arrays, "times": Array(1), "samples": Array(1), "report": Array(4)}
    numbers = ("rtol", "atol", "longest", "least", "h0")
    return Routine("integrate", g, arrays, numbers, ("count", "limit"), statements, complete, body.operations)


def plain_body(code: Code, integrator: str) -> Body:
    """Build the step without a reach, whose sines and order of operations are left to the target."""
    return Body(code, STEPS[integrator](code, REACHES[integrator][-1], library=True), plain=True)


def acceleration(code: Code, plain: bool = False, margin: bool = False) -> Routine:
    """Build the routine that evaluates accelerations; sines are computed from scratch, or by the target if `plain`.

    Its last output is 1 if the guards hold; with `margin`, the smallest pivot over its threshold, 0 if a number is not finite.
    """
    b = Builder(code, EXACT, library=plain)
    a = b.acceleration(b.t, b.q, b.v)
    within = b.within(a)
    return _at_one_state("accelerate", b, a, b.margin(within) if margin else b.g.flag(b.g.both([*b.pivots, within])), plain)


def settling(code: Code) -> Routine:
    """Build the routine `settle(y, p, t, out)`, which projects a state back onto the constraint rows of the program.

    It needs code with projection. Positions get as many chord-Newton corrections as a step of the exact reach, then the velocity
    one. `out` has one row more than y, which is 1 if the guards hold and the last correction was at rounding level.
    """
    b = Builder(code, EXACT)
    q, _ = b.correct_position(b.t, b.q, [], b.q)
    v = b.correct_velocity(q)
    return _at_one_state("settle", b, [*q, *v], b.g.flag(b.g.both([*b.pivots, b.within(v)])), plain=False)


def _at_one_state(name: str, b: Builder, values: Sequence[int], last: int, plain: bool) -> Routine:
    """Build the routine name(y, p, t, out), which stores `values` and then `last`."""
    n, n_p, roots, g = b.n, b.code.program.n_parameters, [*values, last], b.g
    if not plain:
        g, roots = rewrite(g, roots)
    needed = live(g, roots) if plain else order(g, live(g, roots), {str(k): x for k, x in enumerate(roots)})
    rows = {"y": [*(f"%q{i}" for i in range(n)), *(f"%v{i}" for i in range(n))], "p": [f"%p{i}" for i in range(n_p)], "t": ["%t"]}
    loads = [Load(array, {g.leaf(x): k for k, x in enumerate(leaves)}) for array, leaves in rows.items()]
    arrays = {array: Array(len(leaves)) for array, leaves in rows.items()} | {"out": Array(len(roots))}
    sound = g.make("lt", g.const(0.0), roots[-1])
    statements: list[Statement] = [*loads, Compute(needed), Store("out", roots)]
    return Routine(name, g, arrays, (), (), statements, sound, count_operations(g, needed))
