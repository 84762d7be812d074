"""Motions known in closed form, to forty digits: a third source of certificates, next to the two pipelines.

A pendulum and the N-four-bar are elliptic functions, Chaplygin's sleigh is a hyperbola and a quadrature, a free body is a parabola.
Each belongs to one linkage of the suite, recognised by its digest and not only by its name.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss_bench.linkage import generate
from gauss_bench.linkage.build import build_mechanism
from gauss_bench.linkage.errors import LinkageError
from gauss_bench.linkage.load import decimal_document, document_of, load
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reference.motion import Motion

DIGITS = 40

Objects = NDArray[Any]  # of mpmath's numbers
States = tuple[Objects, Objects, Objects]  # q, v, a (k, n)


def closed_form(mechanism: Mechanism, times: Sequence[str]) -> Motion | None:
    """Return the exact motion at times given as decimals, or None if no closed form is known."""
    import mpmath

    name = "n_four_bar" if mechanism.name.startswith("n_four_bar_") else mechanism.name
    form = FORMS.get((name, mechanism.scenario))
    if form is None or not _is_ours(mechanism):
        return None
    with mpmath.workdps(DIGITS):
        q, v, a = form(mechanism.name, [mpmath.mpf(t) for t in times])
    method = f"closed form in {DIGITS} digits, mpmath {mpmath.__version__}"
    return Motion(tuple(times), q, v, a, None, (0.0, 0.0), "", method)


def _is_ours(mechanism: Mechanism) -> bool:
    try:
        return load(mechanism.name, mechanism.scenario).digest == mechanism.digest
    except LinkageError:
        return False


def rotor(k: Any, t: Sequence[Any], speed: Any) -> States:
    """Angle from upright, rate and acceleration of phi'' = k sin(phi) that turns over, from phi = 0 at `speed`.

    With s^2 = speed^2 + 4 k and m = 4 k / s^2 the half angle, turned by a quarter, is Jacobi's amplitude of s t / 2 - K(m).
    """
    import mpmath

    s = mpmath.sqrt(speed**2 + 4 * k)
    m = 4 * k / s**2
    K = mpmath.ellipk(m)
    angles = []
    for x in t:
        turns = mpmath.floor(s * x / (4 * K))
        u = s * x / 2 - 2 * K * turns - K
        half = mpmath.atan2(mpmath.ellipfun("sn", u, m=m), mpmath.ellipfun("cn", u, m=m))
        angles.append(2 * half + mpmath.pi * (1 + 2 * turns))
    phi = np.array(angles)
    rate = np.array([mpmath.sqrt(speed**2 + 4 * k * mpmath.sin(x / 2) ** 2) for x in phi])
    return phi, rate, np.array([k * mpmath.sin(x) for x in phi])


def turning(arm: Any, theta: Any, w: Any, alpha: Any) -> Objects:
    """Return position, velocity and acceleration, as complex numbers, of the end of an arm that turns about the origin."""
    import mpmath

    e = arm * mpmath.expj(theta)
    return np.array([e, 1j * w * e, (1j * alpha - w**2) * e])


def stack_bodies(instants: list[list[tuple[Any, Any]]]) -> States:
    """q, v, a (k, 3 bodies) of bodies at k instants, each by three levels of its place and of its angle."""
    rows = [[[z.real, z.imag, angle] for z, angle in zip(*body, strict=True)] for bodies in instants for body in bodies]
    levels = np.array(rows, dtype=object).reshape(len(instants), -1, 3, 3).transpose(2, 0, 1, 3)
    q, v, a = levels.reshape(3, len(instants), -1)
    return q, v, a


def _n_four_bar(name: str, t: list[Any]) -> States:
    """On the parallelogram branch phi'' = k sin(phi), k = ((N+1)/2 + N) g / (((N+1)/3 + N) l), for any number of windows N."""
    import mpmath

    count, length, gravity = int(name.rpartition("_")[2]), mpmath.mpf(str(generate.LENGTH)), mpmath.mpf("9.81")
    k = (mpmath.mpf(count + 1) / 2 + count) * gravity / ((mpmath.mpf(count + 1) / 3 + count) * length)
    instants = []
    for phi, w, alpha in zip(*rotor(k, t, mpmath.mpf(str(generate.SPEED)) / length), strict=True):
        bar = mpmath.pi / 2 - phi, -w, -alpha
        top, still = turning(length, *bar), [mpmath.mpf(0)] * 3
        along = np.array([length, 0, 0])  # from one pin of the ground to the next, which rest
        bars = [(top / 2 + i * along, bar) for i in range(count + 1)]
        instants.append(bars + [(top + (i + mpmath.mpf("0.5")) * along, still) for i in range(count)])
    return stack_bodies(instants)


def start_of(name: str) -> dict[str, Any]:
    """Return the start of a generated linkage's only scenario."""
    (scenario,) = document_of(name)[0]["scenarios"].values()
    start: dict[str, Any] = scenario["start"]
    return start


def _pendulum(name: str, t: list[Any]) -> States:
    """A uniform bar let go at rest at the angle A from hanging: sin(phi / 2) = sin(A / 2) cd(w0 t), w0^2 = 3 g / (2 l)."""
    import mpmath

    length, gravity = mpmath.mpf(str(generate.LENGTH)), mpmath.mpf("9.81")
    reach = mpmath.pi / 2 + mpmath.radians(mpmath.mpf(str(start_of(name)["crank_deg"])))
    w0, k = mpmath.sqrt(3 * gravity / (2 * length)), mpmath.sin(reach / 2)
    instants = []
    for x in t:
        sn, cn, dn = (mpmath.ellipfun(kind, w0 * x, m=k**2) for kind in ("sn", "cn", "dn"))
        phi = 2 * mpmath.asin(k * cn / dn)
        w = -2 * k * w0 * (1 - k**2) * sn / dn**2 / mpmath.cos(phi / 2)
        bar = phi - mpmath.pi / 2, w, -(w0**2) * mpmath.sin(phi)
        instants.append([(turning(length / 2, *bar), bar)])
    return stack_bodies(instants)


def _projectile(name: str, t: list[Any]) -> States:
    """A free body: its centre of mass on a parabola, its spin constant."""
    import mpmath

    gravity, start = mpmath.mpf("9.81"), start_of(name)
    spin, vx, vy = (mpmath.mpf(str(x)) for x in (start["speeds"]["bar"], *start["point_velocities"]["bar.M"]))
    places = [
        [mpmath.mpc(vx * x, vy * x - gravity * x**2 / 2), mpmath.mpc(vx, vy - gravity * x), mpmath.mpc(0, -gravity)] for x in t
    ]
    return stack_bodies([[(place, (spin * x, spin, 0 * x))] for place, x in zip(places, t, strict=True)])


def _sleigh(name: str, t: list[Any]) -> States:
    """Chaplygin's sleigh, the edge a distance `lead` behind the centre of mass.

    With b^2 = (I + m lead^2) / m and V^2 = v^2 + b^2 w^2,

        v = V tanh(kappa t + c),   b w = V sech(kappa t + c),   kappa = lead V / b^2

    so that the angle is a Gudermannian and the place a quadrature of it.
    Source: Neimark and Fufaev, Dynamics of Nonholonomic Systems (1972), section III.2.
    """
    import mpmath

    document = decimal_document(name)
    start = document["scenarios"]["glide"]["start"]
    body = build_mechanism(document, "glide", "", "", mpmath.mpf).links[0]
    lead, omega = body.com[0] - body.points["edge"][0], mpmath.mpf(str(start["speeds"]["body"]))
    speed = mpmath.mpf(str(start["point_velocities"]["body.edge"][0]))
    b = mpmath.sqrt((body.inertia + body.mass * lead**2) / body.mass)
    V = mpmath.sqrt(speed**2 + b**2 * omega**2)
    kappa, c = lead * V / b**2, mpmath.atanh(speed / V)

    def angle(x: Any) -> Any:
        return 2 * b / lead * (mpmath.atan(mpmath.tanh((kappa * x + c) / 2)) - mpmath.atan(mpmath.tanh(c / 2)))

    def velocity(x: Any) -> Any:
        return V * mpmath.tanh(kappa * x + c) * mpmath.expj(angle(x))

    instants, place, last = [], mpmath.mpc(0), mpmath.mpf(0)
    for x in t:
        place, last = place + mpmath.quad(velocity, [last, x]) if x > last else place, x
        theta, u, w = angle(x), V * mpmath.tanh(kappa * x + c), V / b * mpmath.sech(kappa * x + c)
        rate, turn, e = kappa * (V - u**2 / V), -kappa * w * u / V, mpmath.expj(theta)
        edge = np.array([place, e * u, e * (rate + 1j * w * u)])
        instants.append([(edge + turning(lead, theta, w, turn), (theta, w, turn))])
    return stack_bodies(instants)


FORMS: dict[tuple[str, str], Callable[[str, list[Any]], States]] = {
    ("n_four_bar", "fall"): _n_four_bar,
    ("pendulum", "swing"): _pendulum,
    ("projectile", "flight"): _projectile,
    ("sleigh", "glide"): _sleigh,
}
