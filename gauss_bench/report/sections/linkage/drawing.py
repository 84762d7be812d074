"""What the linkage looks like."""

from gauss_bench.mechanism.errors import LinkageError
from gauss_bench.mechanism.load import built_in
from gauss_bench.report.content import Section, Text, count
from gauss_bench.report.drawings.pose import posed
from gauss_bench.report.rows import Run

PLACE = 10
TABLES = ()


def section(run: Run, name: str) -> Section | None:
    """The size of a linkage that comes with the suite; nothing of others, whose file the report does not have."""
    if name not in built_in():
        return None
    try:
        mechanism, _, _ = posed(name)
    except LinkageError:
        return None
    loops = len(mechanism.joints) - len(mechanism.links)
    words = (
        f"{mechanism.title}: {count(len(mechanism.links), 'moving link')}, {count(len(mechanism.joints), 'joint')}, "
        f"{count(loops, 'loop')}; {mechanism.n} coordinates, {mechanism.n - mechanism.dof + mechanism.redundant} constraint rows, "
        f"{count(mechanism.dof, 'degree')} of freedom."
    )
    return Section("The linkage", f"{name}-linkage", (Text(words),))
