"""The papers' claim, that n - m unknowns are cheaper than n + m, with nothing else that differs.

Both formulations come from one eliminator with one search for pivots, are compiled by one code generator and race in one run. The
textbook's form of both, dense numpy on the same terms, races too. Operations, divisions and the longest chain of dependent
operations are those of one acceleration with its guards. The verdict follows from the measured ratio alone: it is open where the
ratio's spread covers 1.
"""

from gauss_bench.bench.clock import Key, Measured, Missing, Row, row
from gauss_bench.bench.context import Context
from gauss_bench.bench.measurements.cost import ACCELERATION, BATCH, NATIVE, measured_by_linkage
from gauss_bench.bench.tasks import Tables, Task
from gauss_bench.compiler.elimination.program import costs, known_program
from gauss_bench.compiler.errors import KernelError
from gauss_bench.mechanism.load import load
from gauss_bench.suites.schema import Claim, Suite

FORMULATIONS = ("gauss", "lagrange")


def exact(suite: Suite, context: Context) -> list[Task]:
    """Counts of operations on every linkage that both formulations race on."""
    if not suite.claim:
        return []
    places = [x for part in suite.cost for x in part.linkages.items()]
    return [context.task("kernel_claim", counted, x, *x) for x in dict.fromkeys(places)]


def counted(linkage: str, scenario: str) -> Tables:
    """Unknowns and operations of both formulations, as far as they can be compiled."""
    mechanism = load(linkage, scenario or None)
    rows = mechanism.n - mechanism.dof
    start: Row = {"mechanism": mechanism.name, "scenario": mechanism.scenario, "n": mechanism.n, "rows": rows}
    start |= {"unknowns_gauss": mechanism.dof, "unknowns_lagrange": mechanism.n + rows}
    for formulation in FORMULATIONS:
        try:
            told = costs(known_program(mechanism, formulation, (), None, None))
        except KernelError:
            continue  # the race tells why
        start |= {f"{x}_{formulation}": getattr(told, x) for x in ("operations", "divisions", "critical")}
    return {"kernel_claim": [start]}


def complete(suite: Suite, tables: Tables) -> None:
    """Fill in the ratios and the verdict."""
    races = measured_by_linkage(tables)
    for part in suite.claim:
        for number, start in enumerate(tables.get("kernel_claim", [])):
            measured = races.get((start["mechanism"], start["scenario"]), Measured({}, {}))
            tables["kernel_claim"][number] = claim_row(start, part, measured)


def claim_row(start: Row, part: Claim, measured: Measured) -> Row:
    """What both formulations cost, and how many times longer the one with many unknowns takes."""

    def make() -> Row:
        times = measured.compared(*(Key(NATIVE, x) for x in part.compiled))
        return times | {"verdict": verdict(times["ratio_low"], times["ratio_high"])}

    others = {
        "projected": [Key(NATIVE, x, stabilization="projection") for x in part.compiled],
        "batch": [Key(BATCH, x) for x in part.compiled],
        "numpy": [Key(ACCELERATION, x) for x in part.numpy],
    }
    made = row(start, make)
    for name, keys in others.items():
        made |= _ratio(name, keys, measured)
    return made


def _ratio(name: str, keys: list[Key], measured: Measured) -> Row:
    """The ratio under another name; nothing where it was not measured."""
    try:
        times = measured.compared(*keys)
    except Missing:
        return {}
    return {f"{name}_{x}": times[x] for x in ("ratio", "ratio_low", "ratio_high")}


def verdict(low: float, high: float) -> str:
    """Whether fewer unknowns are faster, from the spread of the time with many over that with few."""
    if low > 1.0:
        return "holds"
    return "reversed" if high < 1.0 else "open"
