"""Questions that readers come with: each has its answer in one sentence on the first screen, and a link to the rows behind it."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from gauss_bench.linkage.errors import LinkageError
from gauss_bench.report.cases import end_error, may_rank
from gauss_bench.report.content import Finding
from gauss_bench.report.linkages import pose_in
from gauss_bench.report.rows import Run, is_known
from gauss_bench.report.sections import bias
from gauss_bench.report.sections.trajectories import name_most_accurate
from gauss_bench.report.site.engine import explain_time
from gauss_bench.report.site.page import file_name, sentence_of
from gauss_bench.report.site.settings import USUAL, cheapest_stored, describe_setting, describe_size, scenarios
from gauss_bench.report.words import count

CLAIM = "The paper's claim"  # title of the finding on Gauss against Lagrange


@dataclass(frozen=True)
class Question:
    """A question with its answer in one sentence, and the page with the rows from which it follows."""

    question: str
    answer: str
    page: str


def questions(run: Run, findings: Sequence[Finding], preferred: str) -> list[Question]:
    """Return the questions that the rows of a run answer; settings are those of the preferred linkage."""
    asked: tuple[Callable[[], Iterator[Question]], ...] = (
        lambda: ask_setting(run, preferred, "mujoco", "MuJoCo"),
        lambda: ask_redundant(run),
        lambda: ask_time(run, "exudyn", "Exudyn"),
        lambda: ask_claim(findings),
        lambda: ask_bias(run),
    )
    return [one for ask in asked for one in ask()]


def ask_setting(run: Run, linkage: str, engine: str, name: str) -> Iterator[Question]:
    """Yield which settings of an engine hold the usual accuracy."""
    one = cheapest_stored(run, linkage, USUAL).get(engine)
    if one is not None:
        size = f"step {describe_size(one)}" if is_known(one.step) else describe_size(one)
        setting = f"{describe_setting(run, one)}, {size}"
        yield Question(
            f"Which settings hold {1e3 * USUAL:g} mm in {name}?",
            f"On {linkage} the cheapest is {setting}; the page has those of every linkage.",
            f"engine-{file_name(engine)}.html#best",
        )


def ask_redundant(run: Run) -> Iterator[Question]:
    """Yield which engine is the most exact on a linkage with redundant constraint rows."""
    for name in scenarios(run):
        try:
            spare = pose_in(run, name)[0].redundant
        except LinkageError:
            continue
        rows = [r for r in run.of(name) if may_rank(r) and is_known(end_error(r))]
        if spare > 0 and rows:
            yield Question(
                "Which engine is the most exact on redundant loops?",
                f"{name_most_accurate(rows).rstrip('.')}, on {name}, which has {count(spare, 'redundant row')}.",
                f"linkage-{file_name(name)}.html#cases",
            )
            return


def ask_time(run: Run, engine: str, name: str) -> Iterator[Question]:
    """Yield why an engine takes long here."""
    why = explain_time(run, engine)
    if why is not None:
        yield Question(f"Why is {name} slow here?", why[0], f"engine-{file_name(engine)}.html#why")


def ask_claim(findings: Sequence[Finding]) -> Iterator[Question]:
    """Yield whether the papers' formulation is faster than Lagrange's multipliers."""
    for one in findings:
        if one.title == CLAIM:
            yield Question("Is Gauss faster than Lagrange?", sentence_of(one), "papers.html#claim")
            return


def ask_bias(run: Run) -> Iterator[Question]:
    """Yield where the suite may favour its authors' engines."""
    yield Question("Where may this suite be biased?", bias.shorten(run), f"method.html#{bias.ANCHOR}")
