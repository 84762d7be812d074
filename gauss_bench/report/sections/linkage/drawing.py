"""The drawing of the linkage."""

from gauss_bench.linkage.errors import LinkageError
from gauss_bench.report.content import Section, Text, count
from gauss_bench.report.linkages import pose_in
from gauss_bench.report.rows import Run

PLACE = 10
TABLES = ()


def section(run: Run, name: str) -> Section | None:
    """The size of a linkage; nothing of one whose file an older run did not keep."""
    try:
        mechanism, _, _ = pose_in(run, name)
    except LinkageError:
        return None
    loops = len(mechanism.joints) - len(mechanism.links)
    words = (
        f"{mechanism.title}: {count(len(mechanism.links), 'moving link')}, {count(len(mechanism.joints), 'joint')}, "
        f"{count(loops, 'loop')}; {mechanism.n} coordinates, {mechanism.n - mechanism.dof + mechanism.redundant} constraint rows, "
        f"{count(mechanism.dof, 'degree')} of freedom."
    )
    return Section("The linkage", f"{name}-linkage", (Text(words),))
