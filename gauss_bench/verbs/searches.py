"""Run many cases: `recommend` searches for settings, `sweep` varies numbers of a linkage, and `atlas` finds limits of engines."""

from argparse import Namespace
from typing import Annotated, Any

from gauss_bench.advice.truth import NoTruth
from gauss_bench.api.files import usable_folder, writable
from gauss_bench.api.recommend import Recommendation, list_owned, order_engines
from gauss_bench.api.recommend import recommend as recommend_settings
from gauss_bench.api.telling import Answer, Told
from gauss_bench.atlas import chart, survey, table
from gauss_bench.atomic import write_text
from gauss_bench.bench.provenance import environment
from gauss_bench.runs.offers import check_budget
from gauss_bench.sweep.halving import text as describe_half_step_check
from gauss_bench.sweep.run import Backend, Options, SweepSummary
from gauss_bench.sweep.run import sweep as run_sweep
from gauss_bench.sweep.summary import text
from gauss_bench.tables import TABLES, refuse_foreign, write_table


def recommend(options: Namespace, told: Told) -> Recommendation | Answer[None]:
    """Find each engine's cheapest setting that meets the required accuracy; with --out, write a program for each setting."""
    engines, files = options.engines or [], {}
    if options.out is not None:
        usable_folder(options.out)
        asked = engines or order_engines()
        # the settings that an engine's authors contributed get a program of their own, ENGINE-authors
        for name in [*asked, *(f"{x}-authors" for x in list_owned(asked, options.authors))]:
            # because of the hyphen, Python cannot import a program instead of the engine's library
            files[name] = writable(options.out / f"run-{name}.py", options.replace, "--out", options.out, ".py", options.linkage)
    names = ("position", "angle", "force", "until", "scenario", "settings", "budget", "authors")
    try:
        result = recommend_settings(options.linkage, engines=engines, told=told, **{x: getattr(options, x) for x in names})
    except NoTruth as reason:
        notices = (f"{options.linkage}: nothing can be recommended: {reason}",)
        return Answer(None, succeeded=False, text="", notices=notices)
    for answer in result.answers:
        name = f"{answer.engine}-authors" if answer.owner else answer.engine
        if answer.snippet and name in files:
            options.out.mkdir(exist_ok=True)
            write_text(files[name], answer.snippet)
            told(f"{files[name]}")
    return result


def sweep(options: Namespace, told: Told) -> Answer[SweepSummary]:
    """Run one linkage with many values of some numbers, and report how much the results change with half the step."""
    names = ("scenario", "settings", "integrator", "stabilization", "step", "until", "budget")
    # in the order of the fields of `Options`; its field `limit` is the option --budget
    how, where = Options(*(getattr(options, x) for x in names)), Backend(options.backend, options.scheduler, options.jobs)
    planned = (options.samples, options.sampling, options.seed)
    engines = options.engines or ["gauss-native"]
    summary = run_sweep(options.linkage, options.vary, options.out, engines, *planned, how, where, told)
    sweeps = summary["engines"].values()  # one for each engine
    all_ok = all(x["half_the_step"] is None or x["half_the_step"]["ok"] for x in sweeps)
    all_ok = all_ok and all(set(x["status"]) <= {"ok", "not_assembled"} for x in sweeps)
    remarks = tuple(f"{name}: {describe_half_step_check(x['half_the_step'])}" for name, x in summary["engines"].items())
    return Answer(summary, all_ok, text(summary["engines"]), remarks)


def atlas(options: Namespace, told: Told) -> Answer[Annotated[list[dict[str, Any]], TABLES["atlas"]]]:
    """For each axis of the atlas and each engine, find the hardest value on the axis at which the engine still passes.

    An axis is a family of linkages that become harder to simulate as one number, the value, changes. The table is written into the
    folders `options.out` and `options.into`, and the pages only into `options.out`.
    """
    folders = [x for x in (options.out, options.into) if x is not None]
    for folder in folders:
        usable_folder(folder)
        refuse_foreign({folder / "atlas.csv": table.HEAD})
    if options.out is not None:
        refuse_foreign({options.out / name: chart.TITLE for name in ("atlas.svg", "index.html")})
    chosen, along = survey.choose_settings(options.engines), survey.choose_axes(options.axes)
    reaches = survey.survey(chosen, along, check_budget(options.budget, survey.BUDGET), options.jobs, told)
    rows = table.rows_of(reaches, environment()["commit"]) if folders else []
    for folder in folders:
        told(f"{write_table('atlas', rows, folder)[0]}")
    if options.out is not None:
        for name, content in {"atlas.svg": chart.chart(reaches), "index.html": chart.page(reaches)}.items():
            write_text(options.out / name, content)
            told(f"{options.out / name}")
    return Answer([table.row(x) for x in reaches], text=table.text(reaches))
