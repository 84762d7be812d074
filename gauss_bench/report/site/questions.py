"""Questions that readers often have; each is answered in one sentence on the first screen, with a link to the rows behind it."""

from collections.abc import Sequence
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
    """A question, its answer in one sentence, and the address of the page with the table rows from which the answer follows."""

    question: str
    answer: str
    page: str


def questions(run: Run, findings: Sequence[Finding], preferred: str) -> list[Question]:
    """Return frequent questions of readers, such as on MuJoCo's settings, that the rows of a run answer.

    Args:
        preferred: the linkage for which the answer names a setting.
    """
    asked = (
        ask_setting(run, preferred, "mujoco", "MuJoCo"),
        ask_redundant(run),
        ask_time(run, "exudyn", "Exudyn"),
        ask_claim(findings),
        Question("Where may this suite be biased?", bias.describe_authorship(run), f"method.html#{bias.ANCHOR}"),
    )
    return [question for question in asked if question is not None]


def ask_setting(run: Run, linkage: str, engine: str, name: str) -> Question | None:
    """Return the question "Which settings does the engine need for the usual accuracy?"; `name` is the engine's name in words."""
    setting = cheapest_stored(run, linkage, USUAL).get(engine)
    if setting is None:
        return None
    size = f"step {describe_size(setting)}" if is_known(setting.step) else describe_size(setting)
    return Question(
        f"Which settings hold {1e3 * USUAL:g} mm in {name}?",
        f"On {linkage} the cheapest is {describe_setting(run, setting)}, {size}; the page has those of every linkage.",
        f"engine-{file_name(engine)}.html#best",
    )


def ask_redundant(run: Run) -> Question | None:
    """Return the question "Which engine is the most exact?", asked of the first linkage with redundant constraint rows."""
    for name in scenarios(run):
        try:
            redundant = pose_in(run, name)[0].redundant
        except LinkageError:
            continue
        rows = [r for r in run.of(name) if may_rank(r) and is_known(end_error(r))]
        if redundant > 0 and rows:
            return Question(
                "Which engine is the most exact on redundant loops?",
                f"{name_most_accurate(rows).rstrip('.')}, on {name}, which has {count(redundant, 'redundant row')}.",
                f"linkage-{file_name(name)}.html#cases",
            )
    return None


def ask_time(run: Run, engine: str, name: str) -> Question | None:
    """Return the question "Why is the engine slow?"; `name` is the engine's name in words."""
    why = explain_time(run, engine)
    return Question(f"Why is {name} slow here?", why[0], f"engine-{file_name(engine)}.html#why") if why else None


def ask_claim(findings: Sequence[Finding]) -> Question | None:
    """Return the question "Is the papers' formulation faster than Lagrange's multipliers?"."""
    claim = next((finding for finding in findings if finding.title == CLAIM), None)
    return Question("Is Gauss faster than Lagrange?", sentence_of(claim), "papers.html#claim") if claim else None
