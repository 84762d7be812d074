"""Known limitations, written once; they hold for every run."""

from gauss_bench.report.content import Bullets, Section
from gauss_bench.report.rows import Run

PLACE = 90
TABLES = ()
LIMITATIONS = (
    "**Equal steps are not equal accuracy.** Engines are compared at the error they reach, in the error-against-cost "
    "figures; a table row at the same step compares integrators as much as engines.",
    "**Costs compare only within one machine and one run.** Ratios are taken from interleaved samples of the same run; "
    "microseconds of two runs, or of two machines, say nothing about the engines. They are processor time, in all threads of the "
    "process: other work on the machine does not count, waiting for memory does.",
    "**Python is part of the price of a formulation.** The suite's own formulations are plain numpy code stepped from "
    "Python, foreign engines run compiled code. Where both can be had, a step from Python and a step in the engine's own "
    "loop are separate columns.",
    "**One acceleration of a foreign engine includes the adapter's translation** of the state in Python and back. It is the price "
    "of asking from outside, not of the engine; its steps in its own loop are free of it.",
    "**Foreign integrators are not ours.** An engine that steps with its own integrator is judged on its trajectory as a "
    "whole; only the acceleration at the same state separates its model from its integrator.",
    "**A tree engine's joints cannot drift, except the cut ones.** Engines in relative coordinates keep their tree's joints"
    " exactly and show drift only where a loop was cut. Drift is computed in absolute coordinates for all, so a small "
    "figure may have this reason.",
    "**Accelerations of some foreign engines come from differences** of velocities over a tiny step, because the engine "
    "offers no other way. Those differences, not the formulation, then set the error; the settings say where it is the case.",
    "**A soft constraint is a choice of modelling, not a fault.** Engines made for contact soften their loops by default. "
    "They are run as delivered and with stiffer settings, both printed in full.",
    "**Small residuals do not make a motion right.** The negative control satisfies every constraint and is still wrong; "
    "this is why the motion is compared with a reference, and why the control stays in the tables.",
    "**Settings were chosen by the authors of the suite**, from each engine's documentation. Experts of an engine may do "
    "better; the place to do so is that engine's settings.",
    "**Few linkages, one degree of freedom, one redundant case, no contact, no friction**: nothing here is known of other systems. "
    "Dry friction runs in the numpy formulations alone; it is neither compiled nor certified.",
    "**Valid is not exact.** The judge refuses missing samples, another model, open loops, lost energy, and a link that is off by "
    "a twentieth of a radian or of the linkage's size; how exact a valid run is, the error columns tell.",
    "**Errors end at the reference's own bar, or at the floor of rounded parameters.** What is smaller is printed as below it and "
    "ranks equal.",
)


def section(run: Run) -> Section:
    return Section("Known limitations", "limitations", (Bullets((*LIMITATIONS, *list_left_out(run))),))


def list_left_out(run: Run) -> tuple[str, ...]:
    """List what the suite did not run, each with its reason."""
    told = []
    for rule in run.environment.get("left_out", []):
        words = [
            ", ".join(f"{x:g}" if isinstance(x, float) else f"`{x}`" for x in rule[k]) for k in rule if k not in ("why", "steps")
        ]
        words += [f"at steps of {', '.join(f'{x:g}' for x in rule['steps'])} s"] if rule.get("steps") else []
        told.append(f"**Left out:** {' '.join(words)}, because {rule['why']}.")
    return tuple(told)
