"""Export as plain C: the kernel of a linkage and a small `main`, which need only the standard library."""

from typing import TYPE_CHECKING

import numpy as np

from gauss_bench.engines.base import Choice
from gauss_bench.engines.programs import coordinates, rates
from gauss_bench.exchange.scripts import write_program
from gauss_bench.exchange.text import C_WORDS, make_identifiers
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.trajectory import RunFailure, Status

if TYPE_CHECKING:
    from gauss_bench.compiler.kernel import Kernel

TEST_TIME = 5.0  # [s] longest part of the motion for which a choice of independent coordinates is tested
TEST_STEPS = 2000  # least number of steps of that test
CLOSING = {
    "none": "Joints are held by accelerations alone, without stabilisation.",
    "baumgarte": "Joints are kept closed by Baumgarte's terms.",
    "projection": "Joints are kept closed by a projection of positions and velocities in every step.",
}


def write(mechanism: Mechanism, choice: Choice, head: list[str]) -> str:
    """Return the source of a C program that simulates the mechanism with the kernel generated for it.

    Raises:
        RunFailure: no code can be generated for the linkage, or no choice of independent coordinates is valid for the motion.
    """
    from gauss_bench.compiler.kernel import KernelError

    try:
        kernel = choose_kernel(mechanism, choice)
    except KernelError as error:
        raise RunFailure(Status.SKIP, str(error)) from error
    names = coordinates(mechanism)
    return write_program(
        "program.c.jinja",
        mechanism,
        choice,
        head,
        # the names of the C enum by which the program addresses the entries of its state y = [q, v]
        places=list(make_identifiers([*names, *rates(mechanism)], C_WORDS).values()),
        kernel=kernel.c_source(choice.integrator),
        closing=CLOSING[choice.stabilization],
        independent=", ".join(names[k] for k in kernel.partitions[0]) or "none, as all motion is driven",
    )


def choose_kernel(mechanism: Mechanism, choice: Choice) -> "Kernel":
    """Return a kernel whose first choice of independent coordinates, the only one in a program, is valid for the tested motion.

    Raises:
        KernelError: no code can be generated for the linkage.
        RunFailure: no single choice of independent coordinates is valid for the tested motion.
    """
    from gauss_bench.compiler.elimination.program import partitions
    from gauss_bench.compiler.kernel import KernelError, compile_kernel

    kernel = compile_kernel(mechanism, "gauss", choice.stabilization)
    end = find_end(kernel, mechanism, choice)
    if end is None:
        return kernel
    for independent in partitions(mechanism):
        if independent in kernel.partitions[:1]:  # the choice that is invalid
            continue
        try:
            other = compile_kernel(mechanism, "gauss", choice.stabilization, independent=independent)
        except KernelError:
            continue
        if find_end(other, mechanism, choice) is None:
            return other
    # `end` is the time at which a pivot of the first choice vanished; if it is NaN, none did, and the step may be too long
    reason = "a program has one choice of independent coordinates, but this motion needs a second"
    remark = f", at t = {end:.3g} s for any step" if np.isfinite(end) else ", or a shorter step"
    raise RunFailure(Status.SKIP, f"{reason}{remark}")


def find_end(kernel: "Kernel", mechanism: Mechanism, choice: Choice) -> float | None:
    """Return the time [s] at which a kernel's first choice of independent coordinates becomes invalid, or None if it stays valid.

    The choice is invalid when a pivot of its elimination changes its sign. The test takes small steps, because a run with the
    file's step may jump over a zero that a user's smaller step would meet. The time is NaN if no pivot changes its sign but the run
    with the file's step stops early.
    """
    duration = min(mechanism.duration, TEST_TIME)  # [s] of the test
    steps = int(np.ceil(duration / choice.step))
    count = max(steps, TEST_STEPS)  # number of steps of the test
    every, h = count // TEST_STEPS, duration / count  # steps between the states at which pivots are computed; step size [s]
    q, v = kernel.rollout(mechanism.q0, mechanism.v0, h, count, every=every, integrator=choice.integrator)  # (k, n) both
    t = h * np.minimum(every * np.arange(len(q) + 1), count)
    with np.errstate(all="ignore"):  # after the motion is lost all pivots are NaN, which changes no sign
        pivots = kernel.pivots(t, np.vstack([mechanism.q0, q]), np.vstack([mechanism.v0, v]))  # (k + 1, pivots)
    changed = (np.sign(pivots) * np.sign(pivots[0]) < 0).any(axis=1)
    if changed.any():
        return float(t[changed.argmax()])
    # `alone` runs the program of the first choice with the step of the file, and tells whether it reaches the end
    reaches_end = kernel.alone(mechanism.q0, mechanism.v0, choice.step, steps, integrator=choice.integrator)
    return None if reaches_end else float("nan")
