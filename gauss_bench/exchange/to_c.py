"""Export as plain C: the kernel of a linkage and a small `main`, with the standard library only."""

from typing import TYPE_CHECKING

import numpy as np

from gauss_bench.engines.base import Choice
from gauss_bench.engines.programs import coordinates, rates
from gauss_bench.exchange.scripts import write_program
from gauss_bench.exchange.text import C_WORDS, identifiers
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.trajectory import RunFailure, Status

if TYPE_CHECKING:
    from gauss_bench.compiler.kernel import Kernel

TRIED = 5.0  # [s] of motion, at most, during which the choice of independent coordinates must remain valid
LOOKED_AT = 2000  # states, at least, at which the pivots of that motion are looked at
CLOSING = {
    "none": "Joints are held by accelerations alone, without stabilisation.",
    "baumgarte": "Joints are kept closed by Baumgarte's terms.",
    "projection": "Joints are kept closed by a projection of positions and velocities in every step.",
}


def write(mechanism: Mechanism, choice: Choice, head: list[str]) -> str:
    """Return the source of the program.

    Raises:
        RunFailure: no code can be generated for the linkage, or the motion needs other independent coordinates on its way.
    """
    from gauss_bench.compiler.kernel import KernelError

    try:
        kernel = choose_kernel(mechanism, choice)
    except KernelError as error:
        raise RunFailure(Status.SKIP, str(error)) from error
    names = coordinates(mechanism)
    places = identifiers([*names, *rates(mechanism)], C_WORDS).values()
    given = {
        "places": list(places),
        "kernel": kernel.c_source(choice.integrator),
        "closing": CLOSING[choice.stabilization],
        "independent": ", ".join(names[k] for k in kernel.partitions[0]) or "none, as all motion is driven",
    }
    return write_program("program.c.jinja", mechanism, choice, head, **given)


def choose_kernel(mechanism: Mechanism, choice: Choice) -> "Kernel":
    """Return a kernel whose choice of independent coordinates serves the whole motion: its own first choice, else another.

    Raises:
        RunFailure: none does; KernelError: no code can be generated for the linkage.
    """
    from gauss_bench.compiler.elimination.program import partitions
    from gauss_bench.compiler.kernel import KernelError, compile_kernel

    kernel = compile_kernel(mechanism, "gauss", choice.stabilization)
    end = find_end(kernel, mechanism, choice)
    if end is None:
        return kernel
    for independent in partitions(mechanism):
        if independent in kernel.partitions[:1]:
            continue
        try:
            other = compile_kernel(mechanism, "gauss", choice.stabilization, independent=independent)
        except KernelError:
            continue
        if find_end(other, mechanism, choice) is None:
            return other
    reason = "a file has one choice of independent coordinates, and this motion needs another on its way"
    at = f", at t = {end:.3g} s for any step" if np.isfinite(end) else ", or a shorter step"
    raise RunFailure(Status.SKIP, f"{reason}{at}")


def find_end(kernel: "Kernel", mechanism: Mechanism, choice: Choice) -> float | None:
    """Return the time [s] up to which the first program of a kernel goes, or None if it goes as far as it is tried.

    A step may pass over a zero of a pivot by chance, and a user's smaller step would not. So the pivots are looked at along the
    motion with steps that are short enough to follow it, and one that changes its sign is the end too. NaN if the program stops
    without one, as with a step that is too long.
    """
    tried = min(mechanism.duration, TRIED)
    steps = int(np.ceil(tried / choice.step))
    count = max(steps, LOOKED_AT)
    every, h = count // LOOKED_AT, tried / count
    q, v = kernel.rollout(mechanism.q0, mechanism.v0, h, count, every=every, integrator=choice.integrator)
    t = h * np.minimum(every * np.arange(len(q) + 1), count)
    with np.errstate(all="ignore"):  # a motion that is lost is NaN from there on, and changes no sign
        pivots = kernel.pivots(t, np.vstack([mechanism.q0, q]), np.vstack([mechanism.v0, v]))
    changed = (np.sign(pivots) * np.sign(pivots[0]) < 0).any(axis=1)
    if changed.any():
        return float(t[changed.argmax()])
    alone = kernel.alone(mechanism.q0, mechanism.v0, choice.step, steps, integrator=choice.integrator)
    return None if alone else float("nan")
