"""Export as plain C: the kernel of a linkage and a small `main`, with the standard library only."""

import numpy as np

from gauss_bench.engines.base import Choice
from gauss_bench.exchange.scripts import coordinates, write_program
from gauss_bench.exchange.text import C_WORDS, identifiers
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.trajectory import RunFailure, Status

TRIED = 5.0  # [s] of motion, at most, during which the first choice of independent coordinates must remain valid


def write(mechanism: Mechanism, choice: Choice, head: list[str]) -> str:
    """Return the source of the program.

    Raises:
        RunFailure: no code can be generated for the linkage, or the motion needs other independent coordinates on its way.
    """
    from gauss_bench.compiler.kernel import KernelError, compile_kernel

    try:
        kernel = compile_kernel(mechanism, "gauss", choice.stabilization)
    except KernelError as error:
        raise RunFailure(Status.SKIP, str(error)) from error
    steps = int(np.ceil(min(mechanism.duration, TRIED) / choice.step))
    if not kernel.alone(mechanism.q0, mechanism.v0, choice.step, steps, integrator=choice.integrator):
        reason = "a file has one choice of independent coordinates, and this motion needs another on its way"
        raise RunFailure(Status.SKIP, reason)
    places = identifiers([*coordinates(mechanism), *coordinates(mechanism, ("vx", "vy", "omega"))], C_WORDS).values()
    given = {"places": list(places), "kernel": kernel.c_source(choice.integrator)}
    return write_program("program.c.jinja", mechanism, choice, head, **given)
