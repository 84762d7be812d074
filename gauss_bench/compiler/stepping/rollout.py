"""Routines that integrate the motion of a linkage, in a loop whose state stays in registers, and that evaluate it at one state.

    rollout(y, p, samples, report; h, t0; n, every, slots)

takes n steps of h from the time t0 for a group of trajectories, one in each lane of a vector. The arrays have these rows, each with
one number for each trajectory:

    y, 2 n_q rows: q and v at the start; on return, if a trajectory stopped early, the state at which it stopped.
    p, n_p rows: number arguments: the numbers of the linkage that are not constants in the code.
    samples, slots x 2 n_q rows: states after every `every`-th step and after the last; slots = ceil(n / every), at least one.
    report, 3 rows: number of steps done; 1 if all were done; 1 if the only fault of a step was that a link turned too far.

A guard is a condition for a valid step, above all that no pivot is too small. A trajectory stops before the first step at which a
guard fails, and this step is not counted. The trajectories in other lanes continue; in the lane of a stopped trajectory, a
selection between the old and the new state keeps the old one. A sample is the state at the beginning of a step, where projection
has corrected the velocities. The loop therefore runs once more than there are steps.

Another routine evaluates one state:

    accelerate(y, p, t, out): `out` gets n_q accelerations, then 1 if all guards are satisfied, else 0.

The code of one step is a `Body`, in which all stages are written out: equal expressions of different stages are one value, sines
are updated by rotations from stage to stage, and the processor overlaps the stages. A body is valid for a step in which no link
turns by more than a limit, the reach of the body (`steps.Reach`). A routine has several bodies, each with a larger reach than the
one before.

The code grows with the linkage. If the acceleration has more than `steps.LONG` operations, the body of the classical Runge-Kutta
method contains the code of the acceleration only once, in a loop over the stages.
"""

from collections.abc import Mapping, Sequence

from gauss_bench.compiler.machine.code import Code
from gauss_bench.compiler.machine.graph import Graph, count_operations
from gauss_bench.compiler.machine.rewrite import rewrite
from gauss_bench.compiler.machine.routine import Array, Compute, If, Load, Loop, Routine, Statement, Store
from gauss_bench.compiler.machine.schedule import order
from gauss_bench.compiler.machine.trigonometry import sincos
from gauss_bench.compiler.stepping.steps import EXACT, REACHES, STEPS, TINY, Builder, Reach, Step, dop853, is_looped, rk4_looped

Carried = dict[int, tuple[int, int]]  # variable of a loop (a leaf) -> its value in the first and in the next iteration

# Number of steps after which the state is projected onto the constraints if rows are redundant and there is no stabilisation.
# Otherwise redundant rows would drift apart and count as independent: dense linear algebra would find a linkage that cannot move.
SETTLED = 32


class Body:
    """One step of an integrator as statements inside the loop of a routine, which keeps the state in registers between steps.

    Attributes:
        rows: length 2 n_q of a state.
        values: the values of the step in the order in which they are computed.
        state: leaves of the state: q, then v.
        arrays: arguments of the routine besides y, samples and report.
        carried: variable of the loop (a leaf) -> its value at the first step, and its value at the next step.
        settled: variable of the loop (a leaf) -> projected value, which replaces the next value in `carried` after every SETTLED
            steps; empty if the body never projects in this way.
    """

    def __init__(self, code: Code, step: Step, plain: bool = False, into: Graph | None = None):
        """Put the operations of a step in order, unless `plain`, and make the statements that load inputs and compute the step.

        The operations are added to the graph `into`, which may have other bodies of the same routine; None for a new graph.
        """
        self.step = step = step if plain else step.rewrite_into(into)
        self.graph, self.rows = step.graph, 2 * code.program.n
        g = self.graph
        self.values = order(g, step.roots(), step.carried, plain)
        self.operations = count_operations(g, self.values)
        self.statements: list[Statement] = [Compute(self.values)]
        if step.stages:  # a loop over the four stages comes first; another stage follows the stages 0, 1 and 2
            next_values = [x for _, x in step.stages.values()]
            again = g.make("below", g.count("%stage"), g.whole(3))
            in_order = order(g, next_values, {str(k): x for k, x in enumerate(next_values)})
            self.statements.insert(0, Loop(step.stages, [Compute(in_order)], again))
        # leaves: %q0, %v0 ... are the state in the loop, %y0 ... the initial state, %p0 ... the number arguments of the code; %s
        # and %c are sines and cosines of angles, which one step hands to the next
        names = [f"%{letter}{i}" for letter in "qv" for i in range(code.program.n)]
        y = [g.leaf(f"%y{k}") for k in range(self.rows)]
        self.state = [g.leaf(name) for name in names]
        parameters = {g.leaf(f"%p{k}"): k for k in range(len(code.program.parameters))}
        self.arrays = {"p": Array(len(parameters))}
        self.entry = [Load("y", {x: k for k, x in enumerate(y)}), Load("p", parameters)]
        first = dict(zip(names, y, strict=True))  # name of a leaf -> its value at the first step
        if any(name.startswith("%s") for name in step.carried):  # the step hands sines to the next one
            for i in code.angles:
                first[f"%s{i}"], first[f"%c{i}"] = sincos(g, y[i])
        self.carried: Carried = {g.leaf(name): (first[name], x) for name, x in step.carried.items()}
        self.settled = {g.leaf(name): x for name, x in step.settled.items()}

    def store_end(self, complete: int) -> Store:
        """Store the last state in y: the projected one where the mask `complete` is true, else the state before the failed step."""
        pairs = zip(self.step.out, self.state, strict=True)
        return Store("y", [self.graph.make("select", complete, projected, before) for projected, before in pairs])


def rollout(bodies: Sequence[Body], many: bool) -> Routine:
    """Build the routine `rollout` for one trajectory or, if `many`, for groups of trajectories.

    The bodies share one graph, and each is valid for larger rotations of links per step (its reach) than the one before. The first
    body is used until a link turns by more than its reach in a step; the next body continues from there. All lanes of a vector
    change to the next body at the same step, as soon as one of them needs it.
    """
    # built from the last body to the first: each loop of steps contains, after its end, a branch with the loops of later bodies
    first, statements = bodies[0], list[Statement]()
    for level in reversed(range(len(bodies))):
        steps, all_done, too_far = _step_in_loop(bodies, level, many)
        further = [If(first.graph.make("any", too_far), statements, {})] if statements else []
        statements, complete = [*steps, *further], all_done
    arrays = {"y": Array(first.rows), **first.arrays, "samples": Array(first.rows, "slots"), "report": Array(3)}
    counts, operations = ("n", "every", "slots"), max(body.operations for body in bodies)
    return Routine("rollout", first.graph, arrays, ("h", "t0"), counts, [*first.entry, *statements], complete, operations)


def _step_in_loop(bodies: Sequence[Body], level: int, many: bool) -> tuple[list[Statement], int, int]:
    """Build the loop over time steps that uses the body with the index `level`.

    Return the loop with the statements that store its results; the mask of trajectories of which all steps are done; and the mask
    of those that stopped only because a link turned by more than the body's reach. Each later loop begins where the last one
    stopped.

    The variables of the loop are the state, the time, the counts `i`, `due` and `slot`, the number `done` of steps done, and the
    masks `alive` and `far`.
    """
    body = bodies[level]
    g, is_first, is_last = body.graph, level == 0, level == len(bodies) - 1
    # i: number of the step; due: number of the step at whose beginning the next sample is stored; slot: number of that sample
    i, due, slot, n, every = (g.count(f"%{x}") for x in ("i", "due", "slot", "n", "every"))
    one, zero, always, none = g.whole(1), g.whole(0), g.all(True), g.all(False)
    h, t0, t, done = (g.leaf(f"%{x}") for x in ("h", "t0", "t", "done"))
    # masks of the lanes that have not stopped, and of those that need a body with a larger reach
    alive, far = (g.make("mask", payload=x) for x in ("%alive", "%far")) if many else (always, none)
    # regular: no pivot is too small; within: no link turns by more than the reach. A lane continues if both are true; `beyond`: the
    # step is regular but exceeds the reach, so that code with a larger reach is needed
    beyond = g.both([alive, body.step.regular, g.make("not", body.step.within)])
    going = g.both([alive, body.step.regular, body.step.within])
    # number of the next step, whether there is one, and its time
    following, more = g.make("sum", i, one), g.make("below", i, n)
    later = g.make("add", t0, g.make("mul", g.make("number", following), h))
    due_later, slot_later = g.count("%due_later"), g.count("%slot_later")
    branch, chosen, counter = _settle_regularly(body, following)
    carried: Carried = dict(counter)
    for x, (initial, next_value) in body.carried.items():
        new = chosen.get(x, next_value)
        # a stopped lane keeps its state by selection while the others continue
        carried[x] = initial, g.make("select", going, new, x) if many else new
    carried |= {t: (t0, later), done: (g.const(0.0), g.make("add", done, g.flag(going)))}
    carried |= {i: (zero, following), due: (g.make("least", every, n), due_later), slot: (zero, slot_later)}
    if many:
        carried[alive] = always, going
    if not is_first:  # continue from the values at which the loop of the previous body stopped
        carried = {x: (x, next_value) for x, (_, next_value) in carried.items()}
    if many:
        carried[far] = none, _either(g, far, beyond)
    # stores a sample at the beginning of step `due`, and sets the step and the slot of the next sample
    sample = If(
        g.make("same", i, due),
        [Store("samples", body.step.out, g.make("times", slot, payload=body.rows))],
        {due_later: (g.make("least", g.make("sum", due, every), n), due), slot_later: (g.make("sum", slot, one), slot)},
    )
    again = g.make("also", g.make("any", going), more)
    if many and not is_last:  # all lanes change to the next body as soon as one of them needs it
        again = g.make("also", again, g.make("nowhere", beyond))
    # the last state is valid if the pivots on which its sample depends are large enough, even if the step after it would fail
    complete = g.both([alive, body.step.regular_out, g.make("everywhere", g.make("same", i, n))])
    too_far = g.both([_either(g, far, beyond), g.make("not", complete)])
    report = Store("report", [done, g.flag(complete), g.flag(too_far)])
    loop = Loop(carried, [*body.statements, sample, *branch], again)
    return [loop, body.store_end(complete), report], complete, too_far


def _settle_regularly(body: Body, following: int) -> tuple[list[Statement], dict[int, int], Carried]:
    """Build the projection of the state after every SETTLED steps, if the body has one; `following`: number of the next step.

    Return a branch that is executed after every SETTLED steps; for each variable of the state a variable with its next value,
    projected if the branch is executed; and the loop's counter of the step before which the state is next projected.
    """
    if not body.settled:
        return [], {}, {}
    g = body.graph
    # due, due_later: number of the step before which the state is next projected, now and at the next step
    due, due_later = g.count("%settle"), g.count("%settle_later")
    chosen = {x: g.leaf(f"%next{k}") for k, x in enumerate(body.settled)}
    # leaf -> its value if the branch is taken, and if not
    merged = {chosen[x]: (value, body.carried[x][1]) for x, value in body.settled.items()}
    merged[due_later] = (g.make("sum", due, g.whole(SETTLED)), due)
    return [If(g.make("same", following, due), (), merged)], chosen, {due: (g.whole(SETTLED), due_later)}


def _either(g: Graph, a: int, b: int) -> int:
    """Return the mask that is true where at least one of the masks a and b is true."""
    return g.make("not", g.both([g.make("not", a), g.make("not", b)]))


def bodies(code: Code, integrator: str, reaches: Sequence[Reach]) -> list[Body]:
    """Build the code of a step for each reach (largest rotation per step), all in one graph; looped code has no such limit."""
    if is_looped(code, integrator):  # this code computes every sine from its angle, without rotations
        return [Body(code, rk4_looped(code))]
    graph = Graph()
    return [Body(code, STEPS[integrator](code, reach), into=graph) for reach in reaches]


SAFETY, SHRINK, GROW = 0.9, 0.2, 10.0  # usual factors of step size control: safety, smallest and largest change of the step


def adaptive(code: Code, plain: bool = False) -> Routine:
    """Build the routine `integrate(y, p, times, samples, report; rtol, atol, longest, least, h0; count, limit)` for one trajectory.

    DOP853 chooses its steps by the tolerances. A step ends at each of `count` sample times, where the state is stored. `times` has
    count + 2 entries, the last two equal to the last sample time, because the loop reads the sample time of the next step in
    advance. The first step is h0, and no step is longer than `longest`. The integration stops when a step becomes shorter than
    `least`, or after `limit` steps. Afterwards y has the state reached, and `report` has the numbers of stored samples, accepted
    steps and attempted steps, and the time reached. If `plain`, operations are neither regrouped nor put in another order.
    Source: Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I (1993), section II.10.
    """
    body = Body(code, dop853(code, EXACT, plain, estimated=True), plain)
    g, step = body.graph, body.step
    assert step.error is not None
    # i: index of the next sample; due: 1 if it is stored at the beginning of this step, else 0; tried: number of attempted steps
    i, due, tried, count = (g.count(f"%{x}") for x in ("i", "due", "tried", "count"))
    # taken: number of accepted steps; goal: time of the next sample, which this step must not pass; following: time of the sample
    # after that
    t, h, taken, goal, following = (g.leaf(f"%{x}") for x in ("t", "h", "taken", "goal", "next"))
    # later: i after this step's sample; due_later: `due` of the next step
    later, due_later, one, zero = g.count("%later"), g.count("%due_later"), g.whole(1), g.whole(0)
    sample = Store("samples", step.out, g.make("times", i, payload=body.rows))
    store = If(g.make("same", due, one), [sample], {later: (g.make("sum", i, one), i)})
    # the step is accepted if its guards hold (`sound`) and its error is small enough
    sound = g.both([step.regular, step.within])
    good = g.both([sound, g.make("le", step.error, g.const(1.0))])
    best = _choose_step(g, step.error, sound, good)
    # whether the step ends at a sample, which is stored at the beginning of the next one
    reached = g.both([good, g.make("le", g.make("sub", goal, t), h)])
    t_new = g.make("select", reached, goal, g.make("select", good, g.add(t, h), t))
    mark_due = If(g.make("any", reached), [], {due_later: (one, zero)})
    planned = _plan_step(g, g.make("sub", following, t_new), best)
    start, end = g.leaf("%start"), g.leaf("%end")  # the first two times
    # the state is projected after SETTLED attempts, unless the last of them is refused
    branch, chosen, counter = _settle_regularly(body, g.make("sum", tried, one))
    # variables of the loop; %wanted is the step size that the error allowed, before the step was cut short to end at a sample
    carried = dict(counter)
    for x, (initial, next_value) in body.carried.items():
        carried[x] = initial, g.make("select", good, chosen.get(x, next_value), x)
    carried |= {t: (start, t_new), goal: (end, following), h: (g.leaf("%h0"), planned), g.leaf("%wanted"): (g.leaf("%h0"), best)}
    carried |= {taken: (g.const(0.0), g.add(taken, g.flag(good))), tried: (zero, g.make("sum", tried, one))}
    carried |= {i: (zero, later), due: (one, due_later), g.make("mask", payload="%refused"): (g.all(False), g.make("not", good))}
    # the loop ends after the last sample, after `limit` steps, or if a refused step would become too short
    hopeless = g.both([g.make("not", good), g.make("lt", planned, g.leaf("%least"))])
    again = g.make("also", g.make("below", later, count), g.make("below", tried, g.count("%limit")))
    again = g.make("also", again, g.make("nowhere", hopeless))
    complete = g.make("everywhere", g.make("same", later, count))
    first_times, next_time = Load("times", {start: 0, end: 1}), Load("times", {following: 0}, g.make("sum", later, due_later))
    loop = Loop(carried, [*body.statements, store, mark_due, *branch, next_time], again)
    report = [g.make("number", later), taken, g.make("number", tried), t]
    statements: list[Statement] = [*body.entry, first_times, loop, body.store_end(complete), Store("report", report)]
    arrays = {"y": Array(body.rows), **body.arrays, "times": Array(1), "samples": Array(1), "report": Array(4)}
    numbers = ("rtol", "atol", "longest", "least", "h0")
    return Routine("integrate", g, arrays, numbers, ("count", "limit"), statements, complete, body.operations)


def _choose_step(g: Graph, error: int, sound: int, good: int) -> int:
    """Return the value of the next step size according to the error of this step.

        h clip(SAFETY / root, SHRINK, GROW), at most `longest`

    After a refused step, 1 replaces GROW. `error` is the squared norm of the step's error, proportional to h^16, and `root` is the
    16th root of `error`. `sound` is true if all guards are satisfied, and `good` if in addition the error is small enough. If the
    step is not sound, the next step size is h SHRINK.
    """
    h, wanted = g.leaf("%h"), g.leaf("%wanted")
    root = error
    for _ in range(4):  # the 16th root, which is proportional to h
        root = g.make("sqrt", root)
    ideal = g.make("div", g.const(SAFETY), g.add(root, g.const(TINY)))
    most = g.make("select", g.make("mask", payload="%refused"), g.const(1.0), g.const(GROW))  # no growth after a refused step
    factor = g.maximum(g.minimum(ideal, most), g.const(SHRINK))
    by_error = g.mul(h, g.make("select", sound, factor, g.const(SHRINK)))
    # a step may have been cut short to end at a sample time: if it was good, the next step is not shorter than the size `wanted`
    # that was chosen before it was cut
    size = g.make("select", g.both([good, g.make("lt", by_error, wanted)]), wanted, by_error)
    return g.minimum(size, g.leaf("%longest"))


def _plan_step(g: Graph, remaining: int, best: int) -> int:
    """Return the size of the next step from the time `remaining` to the next sample and the size `best` that the error allows.

    The size is `remaining` if remaining <= best, half of `remaining` if remaining < 2 best, so that no tiny step is left before the
    sample, else `best`.
    """
    half = g.mul(g.const(0.5), remaining)
    shorter = g.make("select", g.make("lt", remaining, g.mul(g.const(2.0), best)), half, best)
    return g.make("select", g.make("le", remaining, best), remaining, shorter)


def plain_body(code: Code, integrator: str) -> Body:
    """Build the code of a step for C or Python; it is valid however far the links rotate in the step."""
    return Body(code, STEPS[integrator](code, REACHES[integrator][-1], library=True), plain=True)


def acceleration(code: Code, plain: bool = False, margin: bool = False) -> Routine:
    """Build the routine `accelerate`, which computes accelerations at a state.

    Args:
        plain: whether sines are computed by functions of the target language, and operations are not put in another order.
        margin: if True, the last output of the routine is the smallest ratio of a pivot to its threshold, or 0 if an acceleration
            is not finite. If False, the last output is 1 if all guards are satisfied, else 0.
    """
    b = Builder(code, EXACT, library=plain)
    a = b.acceleration(b.t, b.q, b.v)
    within = b.within(a)  # true where all accelerations are finite
    validity = b.margin(within) if margin else b.g.flag(b.g.both([*b.pivots, within]))
    # array -> names of the leaves in its rows
    rows = {
        "y": [f"%{letter}{i}" for letter in "qv" for i in range(b.n)],
        "p": [f"%p{i}" for i in range(len(code.program.parameters))],
        "t": ["%t"],
    }
    return evaluation("accelerate", b.g, [*a, validity], rows, plain)


def evaluation(name: str, g: Graph, results: list[int], rows: Mapping[str, Sequence[str]], plain: bool = False) -> Routine:
    """Build a routine that stores values of a graph in its array `out`; in C it returns 0 if the last of them is positive, else 1.

    `rows`: each other array -> names of the leaves that are loaded from its rows. If `plain`, operations are neither regrouped nor
    put in another order.
    """
    if not plain:
        g, moved = rewrite(g, results)
        results = [moved[x] for x in results]
    needed = order(g, results, {str(k): x for k, x in enumerate(results)}, plain)
    loads = [Load(array, {g.leaf(x): k for k, x in enumerate(leaves)}) for array, leaves in rows.items()]
    arrays = {array: Array(len(leaves)) for array, leaves in rows.items()} | {"out": Array(len(results))}
    sound = g.make("lt", g.const(0.0), results[-1])
    return Routine(name, g, arrays, (), (), [*loads, Compute(needed), Store("out", results)], sound, count_operations(g, needed))
