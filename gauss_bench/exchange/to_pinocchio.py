"""Pinocchio: what the adapter builds its model with, call by call; forces as it tabulates them, and steps of Runge and Kutta.

Pinocchio has no springs and no integrator for constrained systems. Forces that are affine in the joints' coordinates are the
adapter's own matrices; the others are written as a table, with the few lines that read it.
"""

from typing import Any

import numpy as np

from gauss_bench.engines.base import Choice
from gauss_bench.exchange.laws import law_functions, law_names
from gauss_bench.exchange.scripts import HEADING, MAIN, PLAN, constants
from gauss_bench.exchange.text import python_comment
from gauss_bench.exchange.transcript import Script, python
from gauss_bench.mechanism.model import GROUND, Along, Angle, Distance, Law, LengthDriver, Load, Mechanism, Point, PointForce, loads
from gauss_bench.trajectory import RunFailure, Status

STATEMENTS = {
    "Model": "model",
    "addJoint": "joint_",
    "appendBodyToJoint": "",
    "StdVec_RigidConstraintModel": "constraints",
    "RigidConstraintModel": "closure_",
    "append": "",
}
IMPORTS = """import math

import numpy as np
import pinocchio as pin

"""
OTHERS = '''

def placed(q, v, point):
    """Position, velocity and arm about the centre of mass of a point (link, x, y); link -1 is the ground."""
    link, x, y = point
    if link < 0:
        return np.array([x, y]), np.zeros(2), np.zeros(2)
    c, s = math.cos(q[3 * link + 2]), math.sin(q[3 * link + 2])
    arm = np.array([c * x - s * y, s * x + c * y])
    return q[3 * link : 3 * link + 2] + arm, v[3 * link : 3 * link + 2] + v[3 * link + 2] * np.array([-arm[1], arm[0]]), arm


def forces(q, v):
    """Generalised forces on the links, of those that are not affine in y and dy."""
    Q = np.zeros(len(q))

    def push(point, arm, force):
        if point[0] >= 0:
            Q[3 * point[0] : 3 * point[0] + 3] += [*force, arm[0] * force[1] - arm[1] * force[0]]

    for a, b, k, c, rest in SPRINGS:  # tension k (L - rest) + c dL/dt between two points
        (A, vA, armA), (B, vB, armB) = placed(q, v, a), placed(q, v, b)
        L = math.hypot(*(B - A))
        if L > 0:
            u = (B - A) / L
            F = k * (rest - L) - c * (u @ (vB - vA))
            push(b, armB, F * u)
            push(a, armA, -F * u)
    for origin, point, angle, k, c, rest in SLIDES:  # k (rest - x) - c dx/dt along an axis of the origin's link
        (A, vA, armA), (B, vB, armB) = placed(q, v, origin), placed(q, v, point)
        turn, omega = (q[3 * origin[0] + 2], v[3 * origin[0] + 2]) if origin[0] >= 0 else (0.0, 0.0)
        u = np.array([math.cos(turn + angle), math.sin(turn + angle)])
        beside = u[0] * (B - A)[1] - u[1] * (B - A)[0]
        F = k * (rest - u @ (B - A)) - c * (u @ (vB - vA) + omega * beside)
        push(point, armB, F * u)
        push(origin, armA, -F * u)
        if origin[0] >= 0:
            Q[3 * origin[0] + 2] += F * beside
    for point, frame, x, y in PUSHES:  # a force that turns with a link
        turn = q[3 * frame + 2] if frame >= 0 else 0.0
        F = [math.cos(turn) * x - math.sin(turn) * y, math.sin(turn) * x + math.cos(turn) * y]
        push(point, placed(q, v, point)[2], F)
    return Q
'''
RUN = '''
data, kinematics = model.createData(), model.createData()
constraint_data = pin.StdVec_RigidConstraintData()
for constraint in constraints:
    constraint_data.append(constraint.createData())
{ready}


def absolute(y):
    """Centres of mass and angles q of the links, and the matrix T of dq/dt = T dy/dt."""
    J = pin.computeJointJacobians(model, kinematics, y)
    centres = np.array([kinematics.oMi[joint].act(centre) for joint, centre in LINKS])
    q, T = np.empty(3 * len(LINKS)), np.empty((3 * len(LINKS), len(y)))
    q[0::3], q[1::3], q[2::3] = centres[:, 0], centres[:, 1], ANGLES + TURNS @ y
    T[0::3] = CARRIED * (J[0] - centres[:, 1, None] * J[5])
    T[1::3] = CARRIED * (J[1] + centres[:, 0, None] * J[5])
    T[2::3] = TURNS
    return q, T
'''
ALGORITHMS = {  # what makes ready, and what solves
    "constraintDynamics": ("pin.initConstraintDynamics(model, data, constraints, constraint_data)", "pin.constraintDynamics"),
    "lcaba": ("pin.computeJointMinimalOrdering(model, data, constraints)", "pin.lcaba"),
}
ACCELERATION = '''

def acceleration(t, y, dy):
    """Accelerations of the joints by {solve}."""
    tau = CONSTANT + STIFFNESS @ y + DAMPING @ dy{others}
    return np.array({solve}(model, data, y, dy, tau, constraints, constraint_data, PROXIMAL))
'''
DRIVEN = '''

def acceleration(t, y, dy):
    """Accelerations of the joints by {solve}, under the torques that make what is driven follow its law.

    They are affine in those torques: without them, and with a probe of each alone, tells how large they are.
    """
    tau = CONSTANT + STIFFNESS @ y + DAMPING @ dy{others}

    def under(more):
        return np.array({solve}(model, data, y, dy, tau + more, constraints, constraint_data, PROXIMAL))

    x, speed, second = np.array([law(t) for law in LAWS]).T
    free = under(0.0)
    missing = second - KD * (DRIVEN @ dy - speed) - KP * (DRIVEN_AT_ZERO + DRIVEN @ y - x) - DRIVEN @ free
    probes = INERTIAS * np.maximum(1.0, np.abs(missing))
    effects = np.array([under(probe) - free for probe in probes[:, None] * DRIVEN])
    return free + np.linalg.solve(DRIVEN @ effects.T, missing) @ effects
'''
ADVANCE = {  # method -> its name, what it is imported from, and a step
    "rk4": (
        "the classical method of Runge and Kutta",
        "",
        '''

def advance(t, y, dy, h):
    """A step of h."""
    a1 = acceleration(t, y, dy)
    v2 = dy + h / 2 * a1
    a2 = acceleration(t + h / 2, y + h / 2 * dy, v2)
    v3 = dy + h / 2 * a2
    a3 = acceleration(t + h / 2, y + h / 2 * v2, v3)
    v4 = dy + h * a3
    a4 = acceleration(t + h, y + h * v3, v4)
    return y + h / 6 * (dy + 2 * v2 + 2 * v3 + v4), dy + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
''',
    ),
    "semi_implicit_euler": (
        "the semi-implicit Euler method",
        "",
        '''

def advance(t, y, dy, h):
    """A step of h."""
    dy = dy + h * acceleration(t, y, dy)
    return y + h * dy, dy
''',
    ),
    "dop853_fixed": (
        "the twelve stages of DOP853, without error control",
        "from scipy.integrate import DOP853\n",
        '''

def advance(t, y, dy, h):
    """A step of h."""
    n, start, rates = len(y), np.concatenate([y, dy]), []
    for node, row in zip(DOP853.C[:12], DOP853.A[:12]):
        x = start + h * sum(c * rate for c, rate in zip(row, rates))
        rates.append(np.concatenate([x[n:], acceleration(t + node * h, x[:n], x[n:])]))
    x = start + h * sum(c * rate for c, rate in zip(DOP853.B, rates))
    return x[:n], x[n:]
''',
    ),
}
SIMULATE = '''

def simulate(end=END, step=STEP):
    """Rows [t, *q, *v] at equally spaced times, by {method}, in the joints' coordinates."""
    steps, every = plan(end, step)
    h, y, dy = end / steps, Y0.copy(), DY0.copy()
    rows = [[0.0, *Q0, *V0]]
    for k in range(steps):
        y, dy = advance(k * h, y, dy, h)
        if (k + 1) % every == 0:
            q, T = absolute(y)
            rows.append([(k + 1) * h, *q, *(T @ dy)])
    return rows
'''
ADAPTIVE = '''

def simulate(end=END, step=STEP):
    """Rows [t, *q, *v] at equally spaced times, by SciPy's DOP853 in the joints' coordinates; `step` is the rows' distance."""
    n, times = len(Y0), np.linspace(0.0, end, max(1, math.ceil(end / step - 1e-9)) + 1)

    def rate(t, x):
        return np.concatenate([x[n:], acceleration(t, x[:n], x[n:])])

    solution = solve_ivp(rate, (0.0, end), np.concatenate([Y0, DY0]), "DOP853", times, rtol={rtol!r}, atol={atol!r})
    if not solution.success:
        raise RuntimeError(solution.message)
    rows = []
    for t, x in zip(times, solution.y.T):
        q, T = absolute(x[:n])
        rows.append([t, *q, *(T @ x[n:])])
    return rows
'''


def write_pinocchio(mechanism: Mechanism, choice: Choice, head: list[str]) -> str:
    """The script.

    Raises:
        RunFailure: Pinocchio refuses the model, it differs from the linkage, or a length is prescribed.
        ImportError: Pinocchio is not installed.
    """
    from gauss_bench.engines.pinocchio.adapter import PinocchioModel
    from gauss_bench.engines.pinocchio.tree import Multibody
    from gauss_bench.mechanism.tree import Branch

    if choice.stabilization == "projection":
        raise RunFailure(Status.SKIP, "Pinocchio has no projection: the one of this suite is its own")
    if beyond := ", ".join(d.name for d in mechanism.drivers if isinstance(d, LengthDriver)):
        raise RunFailure(Status.SKIP, f"the script holds motion laws of angles and slides only, not of the length {beyond}")

    class Transcribed(Multibody):
        """The adapter's model, with a remark on each link."""

        def _add_link(self, mechanism: Mechanism, b: Branch) -> None:
            script.comment(f"link {mechanism.links[b.link].name}")
            super()._add_link(mechanism, b)

    built = PinocchioModel(mechanism, choice)  # which is compared with the linkage
    script = Script(STATEMENTS)
    body = Transcribed(script.thing("pin"), mechanism, built.tree)
    script.comment("the pins that close the loops")
    damped = choice.stabilization == "baumgarte"
    gains = ("baumgarte_Kp_per_s2", "baumgarte_Kd_per_s")
    body.constraints((float(built.options[gains[0]]), float(built.options[gains[1]])) if damped else (0.0, 0.0))
    y0, dy0 = built.tree.relative(mechanism.q0, mechanism.v0)
    drive = built.stabilized.drive
    o, motion, forces = built.options, built.forces.motion, built.forces
    script.comment("links: the joint that carries each, and its centre of mass there; angles are ANGLES + TURNS y")
    joints = [body.carriers[i][0] for i in range(len(mechanism.links))]
    centres = [centre for _, centre in motion.centres]
    links = ", ".join(f"({joint}, {python(centre)})" for joint, centre in zip(joints, centres, strict=True))
    script.lines.append(f"LINKS = [{links}]")
    named: dict[str, Any] = {
        "ANGLES": motion.theta0,
        "TURNS": motion.turns,
        "CARRIED": motion.carried,
        "CONSTANT": forces.constant,
        "STIFFNESS": forces.stiffness,
        "DAMPING": forces.damping,
        "Y0": y0,
        "DY0": dy0,
    }
    if drive.laws:
        named |= {"DRIVEN": drive.rows, "DRIVEN_AT_ZERO": drive.origin, "INERTIAS": drive.inertias}
        script.lines.append(f"LAWS = [{', '.join(law_names(mechanism.drivers).values())}]")
        script.lines.append("KP, KD = {!r}, {!r}  # of Baumgarte, for what is driven".format(*map(float, drive.gains)))
    script.lines += [f"{name} = {python(np.asarray(x))}" for name, x in named.items()]
    accuracy = ", ".join(repr(float(o[x])) for x in ("absolute_accuracy", "relative_accuracy", "mu"))
    script.lines.append(f"PROXIMAL = pin.ProximalSettings({accuracy}, {int(o['max_iter'])})")
    others = list(loads(forces.others))
    ready, solve = ALGORITHMS[o["algorithm"]]
    if choice.integrator == "dop853":
        method, imported = "SciPy's DOP853", "from scipy.integrate import solve_ivp\n"
        rtol, atol = choice.tolerances(float(o["dop853_rtol"]), float(o["dop853_atol"]))
        run = ADAPTIVE.format(rtol=rtol, atol=atol)
    else:
        method, imported, advance = ADVANCE[choice.integrator]
        run = advance + SIMULATE.format(method=method)
    closed = "with Baumgarte's terms" if damped else "and nothing draws them shut"
    told = [*head, f"Settings: {choice.settings}, {method}. Joints open the loops, which constraints close again, {closed}."]
    acceleration = (DRIVEN if drive.laws else ACCELERATION).format(others=" + generalised(y, dy)" if others else "", solve=solve)
    imports = IMPORTS.replace("import pinocchio as pin\n", f"import pinocchio as pin\n{imported}")
    model = [imports, constants(mechanism, choice), law_functions(mechanism.drivers), "\n", script.text(), RUN.format(ready=ready)]
    parts = [HEADING, python_comment(told), "\n", *model]
    return "".join([*parts, *([table(others), OTHERS, GENERALISED] if others else []), acceleration, PLAN, run, MAIN])


GENERALISED = '''

def generalised(y, dy):
    """The same on the joints."""
    q, T = absolute(y)
    return forces(q, T @ dy) @ T
'''


def table(others: list[Load]) -> str:
    """The loads that are not affine, as the tables that `forces` reads."""
    springs, slides, pushes = [], [], []
    for load in others:
        match load:
            case Law(Distance(a, b), k, c, rest, 0.0):
                springs.append((spot(a), spot(b), k, c, rest))
            case Law(Along(origin, point, angle, across), k, c, rest, 0.0):
                slides.append((spot(origin), spot(point), angle + across * np.pi / 2, k, c, rest))
            case PointForce(_, point, force, frame) if point.link != GROUND:
                pushes.append((spot(point), frame, float(force[0]), float(force[1])))
            case PointForce():
                pass  # on the ground
            case Law(Angle() | Along() | Distance()):
                raise RunFailure(Status.SKIP, "a load of this kind is not written for Pinocchio")
    return f"\nSPRINGS = {python(springs)}\nSLIDES = {python(slides)}\nPUSHES = {python(pushes)}\n"


def spot(point: Point) -> tuple[int, float, float]:
    """Link, and place about its centre of mass; -1 is the ground."""
    return point.link, float(point.local[0]), float(point.local[1])
