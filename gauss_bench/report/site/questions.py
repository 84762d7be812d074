"""Questions that readers often have; each is answered in one sentence on the first screen, with a link to the rows behind it."""

from collections.abc import Sequence

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


Question = dict[str, str]  # a question, its answer in one sentence, and the address of the page with the rows behind it


def questions(run: Run, findings: Sequence[Finding], preferred: str) -> list[Question]:
    """Return frequent questions of readers, such as on MuJoCo's settings, that the rows of a run answer."""
    asked = [ask_setting(run, preferred, "mujoco", "MuJoCo"), ask_redundant(run)]
    if why := explain_time(run, "exudyn"):
        asked.append(Question(question="Why is Exudyn slow here?", answer=why[0], page=f"engine-{file_name('exudyn')}.html#why"))
    if claim := next((finding for finding in findings if finding.title == CLAIM), None):
        asked.append(Question(question="Is Gauss faster than Lagrange?", answer=sentence_of(claim), page="papers.html#claim"))
    written, page = bias.describe_authorship(run), f"method.html#{bias.ANCHOR}"
    asked.append(Question(question="Where may this suite be biased?", answer=written, page=page))
    return [question for question in asked if question is not None]


def ask_setting(run: Run, linkage: str, engine: str, name: str) -> Question | None:
    """Return the question "Which settings does the engine need for the usual accuracy?"; `name` is the engine's name in words."""
    setting = cheapest_stored(run, linkage, USUAL).get(engine)
    if setting is None:
        return None
    size = f"step {describe_size(setting)}" if is_known(setting.step) else describe_size(setting)
    return Question(
        question=f"Which settings hold {1e3 * USUAL:g} mm in {name}?",
        answer=f"On {linkage} the cheapest is {describe_setting(run, setting)}, {size}; the page has those of every linkage.",
        page=f"engine-{file_name(engine)}.html#best",
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
                question="Which engine is the most exact on redundant loops?",
                answer=f"{name_most_accurate(rows).rstrip('.')}, on {name}, which has {count(redundant, 'redundant row')}.",
                page=f"linkage-{file_name(name)}.html#cases",
            )
    return None
