"""Plain C: the kernel of a linkage, a small `main` around it, and nothing else than the standard library."""

import numpy as np

from gauss_bench.engines.base import Choice
from gauss_bench.exchange.errors import ExchangeError
from gauss_bench.exchange.export import coordinates
from gauss_bench.exchange.scripts import SAMPLES, rates
from gauss_bench.exchange.text import C_WORDS, c_comment, c_string, identifiers
from gauss_bench.mechanism.model import Mechanism

TRIED = 5.0  # [s] of the motion at most, in which the first choice of coordinates has to serve
TOLD = (
    "Compile: cc -O2 -o linkage THIS_FILE -lm    Run: ./linkage [END [STEP]]    It prints t, positions and velocities as CSV.",
    "",
    "int accelerate(double *y, double *p, double *t, double *out)",
    "    out[0 .. N-1]: accelerations of the state y = [q, v] of 2 N numbers at time t[0] (out[N]: how far from a pivot of zero).",
    "int rollout(double *y, double *p, double *samples, double *report, double h, double t0, long n, long every, long slots)",
    "    n steps of h from y at time t0, in place; after each `every` steps the state goes to the next of `slots` samples.",
    "    report[0]: steps taken; report[1]: 1 where they are all.",
    "Both return 0, or 1 where a pivot is too near to zero. p holds nothing. Another main? Compile with -DNO_MAIN.",
    "Joints are kept closed by a projection of positions and velocities in every step.",
)
MAIN = """
#ifndef NO_MAIN
#include <stdio.h>
#include <stdlib.h>

static void print_row(double t, const double *y)
{
    printf("%.17g", t);
    for (int i = 0; i < 2 * N; i++) printf(",%.17g", y[i]);
    printf("\\n");
}

int main(int argc, char **argv)
{
    double end = argc > 1 ? atof(argv[1]) : END, step = argc > 2 ? atof(argv[2]) : STEP;
    double y[2 * N], sample[2 * N], report[3], none[1] = {0};
    if (!(end > 0 && step > 0)) {
        fprintf(stderr, "usage: %s [END [STEP]], in seconds\\n", argv[0]);
        return 2;
    }
    long count = (long)ceil(end / step - 1e-9), every;
    if (count < 1) count = 1;
    every = (count + SAMPLES - 1) / SAMPLES;
    long rows = (count + every - 1) / every;
    double h = end / (double)(rows * every);
    printf("t");
    for (int i = 0; i < 2 * N; i++) printf(",%s", names[i]);
    printf("\\n");
    for (int i = 0; i < 2 * N; i++) y[i] = start[i];
    print_row(0.0, y);
    for (long k = 0; k < rows; k++) {
        if (rollout(y, none, sample, report, h, (double)(k * every) * h, every, every, 1)) {
            fprintf(stderr, "stopped after t = %g s: a pivot is too near to zero; a smaller step may help\\n",
                    ((double)(k * every) + report[0]) * h);
            return 1;
        }
        print_row((double)((k + 1) * every) * h, y);
    }
    return 0;
}
#endif
"""


def write_c(mechanism: Mechanism, choice: Choice, head: list[str]) -> str:
    """The source.

    Raises:
        ExchangeError: no code can be generated for the linkage, or none that runs through its motion.
    """
    from gauss_bench.compiler.kernel import KernelError, compile_kernel

    try:
        kernel = compile_kernel(mechanism, "gauss", choice.stabilization)
    except KernelError as error:
        raise ExchangeError(f"{mechanism.source}: {mechanism.name}: cannot become a C program: {error}") from error
    tried = min(mechanism.duration, TRIED)
    if not kernel.alone(mechanism.q0, mechanism.v0, choice.step, int(np.ceil(tried / choice.step)), integrator=choice.integrator):
        reason = "one file holds one choice of independent coordinates, and on its way this motion needs another"
        raise ExchangeError(
            f"{mechanism.source}: {mechanism.name}, scenario {mechanism.scenario}: cannot become a C program: {reason}"
        )
    names = [*coordinates(mechanism), *rates(mechanism)]
    places = ",\n".join(f"    {x} = {k}" for k, x in enumerate(identifiers(names, C_WORDS).values()))
    texts = ",\n".join(f"    {c_string(x)}" for x in names)
    start = ",\n".join(f"    {float(x)!r}" for x in (*mechanism.q0, *mechanism.v0))
    given = (
        f"#define N {mechanism.n}\n#define END {float(mechanism.duration)!r}\n"
        f"#define STEP {choice.step!r}\n#define SAMPLES {SAMPLES}\n\n"
        f"enum {{  /* places in y: centres of mass and angles q, then their rates */\n{places}\n}};\n\n"
        f"const char *const names[2 * N] = {{\n{texts}\n}};\n\nconst double start[2 * N] = {{\n{start}\n}};\n"
    )
    return "".join([c_comment([*head, *TOLD]), "\n", given, "\n", kernel.c_source(choice.integrator), MAIN])
