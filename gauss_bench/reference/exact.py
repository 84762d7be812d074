"""Motions that are known in closed form, to forty digits: a third source of certificates, besides two numerical computations.

Each closed form belongs to one built-in linkage, which is recognised by its name and its digest.
"""

from collections.abc import Callable, Sequence
from typing import Any

import mpmath
import numpy as np
from numpy.typing import NDArray

from gauss_bench.linkage import generate
from gauss_bench.linkage.build import build_mechanism
from gauss_bench.linkage.errors import LinkageError
from gauss_bench.linkage.load import decimal_document, document_of, load
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reference.motion import Motion

DIGITS = 40

Numbers = NDArray[Any]  # array of mpmath's numbers
States = tuple[Numbers, Numbers, Numbers]  # q, v, a (k, n)


def closed_form(mechanism: Mechanism, times: Sequence[str]) -> Motion | None:
    """Return the exact motion at times (decimal texts) [s], or None if no closed form is known."""
    name = "n_four_bar" if mechanism.name.startswith("n_four_bar_") else mechanism.name
    form = FORMS.get((name, mechanism.scenario))
    try:
        if form is None or load(mechanism.name, mechanism.scenario).digest != mechanism.digest:
            return None
    except LinkageError:  # no built-in linkage has this name
        return None
    with mpmath.workdps(DIGITS + 5):  # five more digits, for rounding in the formulas
        q, v, a = form(mechanism.name, [mpmath.mpf(t) for t in times])
    method = f"closed form in {DIGITS} digits, mpmath {mpmath.__version__}"
    return Motion(tuple(times), q, v, a, None, (0.0, 0.0), "", method)


def sample(coordinates: Callable[[Any], Numbers], t: Sequence[Any]) -> States:
    """Return q, v, a (k, n) at times t (k,), by numerical derivatives of the coordinates (n,) as a function of time.

    mpmath uses as many additional digits as the differences lose. Values as small as rounding errors become zero.
    """
    chop = np.vectorize(mpmath.chop, otypes=[object])
    q, v, a = (chop([mpmath.diff(coordinates, x, order) for x in t]) for order in range(3))
    return q, v, a


def stack_bodies(bodies: Sequence[tuple[Any, Any]]) -> Numbers:
    """Return the coordinates (3 bodies,) of bodies, given the position (a complex number) and the angle of each."""
    return np.array([x for place, angle in bodies for x in (place.real, place.imag, angle)])


def _pendulum_angle(k: Any, t: Any, speed: Any) -> Any:
    """Return the angle phi [rad] from the upright position at time t of a pendulum that turns over: phi'' = k sin(phi).

    The motion begins at phi = 0 with phi' = `speed`. With s^2 = speed^2 + 4 k, m = 4 k / s^2, the complete elliptic integral K(m)
    and Jacobi's amplitude am, phi / 2 = pi / 2 + am(s t / 2 - K(m), m).
    """
    s = mpmath.sqrt(speed**2 + 4 * k)
    m = 4 * k / s**2
    K = mpmath.ellipk(m)
    turns = mpmath.floor(s * t / (4 * K))
    u = s * t / 2 - 2 * K * turns - K
    half = mpmath.atan2(mpmath.ellipfun("sn", u, m=m), mpmath.ellipfun("cn", u, m=m))
    return 2 * half + mpmath.pi * (1 + 2 * turns)


def _n_four_bar(name: str, t: list[Any]) -> States:
    """Return the motion of N coupled four-bars, which are parallelograms: N + 1 uprights on the ground, and N horizontal bars.

    All bars have equal mass and the length l. The uprights turn like a pendulum, with phi the angle from the vertical:
    phi'' = k sin(phi), where k = ((N+1)/2 + N) g / (((N+1)/3 + N) l) is the torque of gravity over the inertia.
    """
    count, length, gravity = int(name.rpartition("_")[2]), mpmath.mpf(str(generate.LENGTH)), mpmath.mpf("9.81")
    k = (mpmath.mpf(count + 1) / 2 + count) * gravity / ((mpmath.mpf(count + 1) / 3 + count) * length)
    speed = mpmath.mpf(str(generate.SPEED)) / length  # angular velocity of the uprights [rad/s]

    def coordinates(time: Any) -> Numbers:
        """Return the coordinates (n,) of all bars at a time [s]."""
        theta = mpmath.pi / 2 - _pendulum_angle(k, time, speed)
        top, zero = length * mpmath.expj(theta), mpmath.mpf(0)  # top of the first upright, and the angle of a horizontal bar
        uprights = [(top / 2 + i * length, theta) for i in range(count + 1)]
        return stack_bodies(uprights + [(top + (i + 0.5) * length, zero) for i in range(count)])

    return sample(coordinates, t)


def start_of(name: str) -> dict[str, Any]:
    """Return the table `start` in the only scenario of a generated linkage."""
    (scenario,) = document_of(name)[0]["scenarios"].values()
    start: dict[str, Any] = scenario["start"]
    return start


def _pendulum(name: str, t: list[Any]) -> States:
    """Return the motion of a uniform bar of length l on a pin at its end, released from rest at the angle A.

    The angle phi is measured from the hanging position, and phi(0) = A. With the Jacobi function cd of the modulus sin(A/2),
    sin(phi/2) = sin(A/2) cd(w0 t), w0^2 = 3 g / (2 l).
    """
    length, gravity = mpmath.mpf(str(generate.LENGTH)), mpmath.mpf("9.81")
    A = mpmath.pi / 2 + mpmath.radians(mpmath.mpf(str(start_of(name)["crank_deg"])))  # crank_deg is measured from the x axis
    w0, k = mpmath.sqrt(3 * gravity / (2 * length)), mpmath.sin(A / 2)

    def coordinates(time: Any) -> Numbers:
        """Return the coordinates (3,) of the bar at a time [s]."""
        theta = 2 * mpmath.asin(k * mpmath.ellipfun("cd", w0 * time, m=k**2)) - mpmath.pi / 2
        return stack_bodies([(length / 2 * mpmath.expj(theta), theta)])

    return sample(coordinates, t)


def _projectile(name: str, t: list[Any]) -> States:
    """Return the motion of a free body: its centre of mass moves on a parabola, and its spin is constant."""
    gravity, start = mpmath.mpf("9.81"), start_of(name)
    spin, vx, vy = (mpmath.mpf(str(x)) for x in (start["speeds"]["bar"], *start["point_velocities"]["bar.M"]))
    return sample(lambda x: np.array([vx * x, vy * x - gravity * x**2 / 2, spin * x]), t)


def _sleigh(name: str, t: list[Any]) -> States:
    """Return the motion of Chaplygin's sleigh, a body on a knife edge, which can move only along the edge.

    The knife edge lies at the distance `lead` behind the centre of mass. With v the velocity of the edge along the sleigh, w the
    angular velocity, b^2 = (I + m lead^2) / m and the constant V^2 = v^2 + b^2 w^2,

        v = V tanh(kappa t + c),   b w = V sech(kappa t + c),   kappa = lead V / b^2

    The constant c follows from the start. The angle is known in closed form; the position of the edge is the numerical integral of
    its velocity. Source: Neimark and Fufaev, Dynamics of Nonholonomic Systems (1972), section III.2.
    """
    document = decimal_document(name)
    start = document["scenarios"]["glide"]["start"]
    body = build_mechanism(document, "glide", "", "", mpmath.mpf).links[0]
    lead, omega = body.com[0] - body.points["edge"][0], mpmath.mpf(str(start["speeds"]["body"]))
    speed = mpmath.mpf(str(start["point_velocities"]["body.edge"][0]))
    b = mpmath.sqrt((body.inertia + body.mass * lead**2) / body.mass)
    V = mpmath.sqrt(speed**2 + b**2 * omega**2)
    kappa, c = lead * V / b**2, mpmath.atanh(speed / V)

    def angle(x: Any) -> Any:
        """Return the angle of the sleigh [rad] at a time x [s]."""
        return 2 * b / lead * (mpmath.atan(mpmath.tanh((kappa * x + c) / 2)) - mpmath.atan(mpmath.tanh(c / 2)))

    def velocity(x: Any) -> Any:
        """Return the velocity of the edge in the world, a complex number."""
        return V * mpmath.tanh(kappa * x + c) * mpmath.expj(angle(x))

    def from_edge(x: Any) -> Numbers:
        """Return the coordinates (3,) of the sleigh, with its centre of mass relative to the knife edge."""
        return stack_bodies([(lead * mpmath.expj(angle(x)), angle(x))])

    def edge_rate(x: Any) -> Numbers:
        """Return the rates (3,) that the coordinates would have without turning, at the velocity of the edge."""
        return stack_bodies([(velocity(x), mpmath.mpf(0))])

    q, v, a = sample(from_edge, t)
    edge_velocity, edge_acceleration, _ = sample(edge_rate, t)
    edges, edge, last = [], mpmath.mpc(0), mpmath.mpf(0)  # positions of the knife edge, which starts at the origin
    for x in t:
        if x > last:
            edge += mpmath.quad(velocity, [last, x])
        last = x
        edges.append(stack_bodies([(edge, mpmath.mpf(0))]))
    return q + np.array(edges), v + edge_velocity, a + edge_acceleration


FORMS: dict[tuple[str, str], Callable[[str, list[Any]], States]] = {
    ("n_four_bar", "fall"): _n_four_bar,
    ("pendulum", "swing"): _pendulum,
    ("projectile", "flight"): _projectile,
    ("sleigh", "glide"): _sleigh,
}
