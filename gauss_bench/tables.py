"""Every table of a run: its columns with their types, units and meanings, for whoever writes, reads or shows them.

A row is a mapping from column to value: a text, a number or a flag as the schema says. A missing text is empty, a missing number
NaN, a missing flag None. Writing refuses what the schema does not know, so that no column appears by accident. Reading takes the
schema's columns and leaves alone what others may have added to a file. The folder of a run carries the format's number and the
schema itself in `tables.json`; a folder without it is of format 1 and is brought up to date while it is read (`migrated`), one of
a later format is refused. A new table is one entry of TABLES.

What a clock decides lies apart, in files of the folder `times` with the same names, rounded to what its spread supports: a run that
is made again changes those files and, of all others, the rows whose figures moved. Whoever reads a table gets both parts as one.
Where, when and with what a run was made stands in `environment.json` alone.
"""

import csv
import io
import json
import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Literal

FORMAT = 5
APART = 4  # the first format in which what a clock decides lies in files of its own
BASELINE_FORMAT = 3  # of the accuracy gate's baseline, which tells its own
TIMES = "times"  # the folder of what a clock decides
SCHEMA_FILE = "tables.json"
ENVIRONMENT = "environment.json"  # where, when and with what a run was made
DIGITS = 10  # of a number in a CSV file: errors mean something in their first digits, and two runs differ where a number does
DRAWN = 4  # of a curve, whose values are kept to 13 bits

Row = Mapping[str, Any]


class TableError(ValueError):
    """A file that cannot be read as the table it should be; the message names file and column."""


@dataclass(frozen=True)
class Column:
    """One column.

    Attributes:
        name: the heading in files.
        kind: what its values are.
        meaning: in words.
        unit: "" for texts, flags, counts and ratios.
        exact: whether a number keeps all its digits in a CSV file.
        timed: whether a clock decides it: it lies apart then, and is rounded.
        added: whether files of this format may lack it, since it came later: it is missing in their rows then.
    """

    name: str
    kind: Literal["text", "number", "flag"]
    meaning: str
    unit: str = ""
    exact: bool = False
    timed: bool = False
    added: bool = False


@dataclass(frozen=True)
class Table:
    """A table: what a row is, and its columns; the first `keys` of them tell rows apart.

    Attributes:
        timed: whether a clock decides which rows there are: all of it lies apart then.
        curves: whether its numbers are points of curves, which are kept as exactly as they are drawn.
    """

    meaning: str
    columns: tuple[Column, ...]
    keys: int = 0
    suffix: Literal["csv", "parquet"] = "csv"
    timed: bool = False
    curves: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(c.name for c in self.columns)

    @property
    def parts(self) -> "dict[str, tuple[Column, ...]]":
        """The columns of its files, by the folder that each lies in: "" or `times`, the latter with the key and what is timed."""
        apart = tuple(c for c in self.columns if c.timed)
        if self.timed:
            return {TIMES: self.columns}
        if not apart:
            return {"": self.columns}
        return {"": tuple(c for c in self.columns if not c.timed), TIMES: (*self.key, *apart)}

    @property
    def key(self) -> tuple[Column, ...]:
        """The columns that tell rows apart."""
        return self.columns[: self.keys]


def text(name: str, meaning: str) -> Column:
    return Column(name, "text", meaning)


def flag(name: str, meaning: str) -> Column:
    return Column(name, "flag", meaning)


def number(name: str, meaning: str, unit: str = "", exact: bool = False) -> Column:
    return Column(name, "number", meaning, unit, exact)


def spread(name: str, meaning: str, unit: str = "") -> tuple[Column, ...]:
    """A lower quartile or a ratio of two, with its 5 and 95 percent points."""
    return (
        number(name, meaning, unit),
        number(f"{name}_low", f"{meaning}: least that a second race may find; of one process, the 5 percent point", unit),
        number(f"{name}_high", f"{meaning}: most that a second race may find; of one process, the 95 percent point", unit),
    )


def by_clock(*columns: Column) -> tuple[Column, ...]:
    """The same columns, as what a clock decides."""
    return tuple(replace(c, timed=True) for c in columns)


def add_columns(*columns: Column) -> tuple[Column, ...]:
    """The same columns, as what older files lack."""
    return tuple(replace(c, added=True) for c in columns)


WHERE = (text("mechanism", "name of the linkage"), text("scenario", "of the linkage file"))
METHOD = (
    text("engine", "as the command line calls it"),
    text("settings", "label of the engine's options"),
    text("integrator", "as the engine calls it"),
    text("stabilization", "as the engine calls it"),
)
CASE = (
    *WHERE,
    *METHOD,
    number("step", "of the integration, or spacing of samples where the integrator chooses its own", "s"),
    number("t_end", "end of the run", "s"),
)
KEY = tuple(c.name for c in CASE)
OUTCOME = (text("status", "ok, or how it ended"), text("message", "why it did not end ok"))
SECONDS = by_clock(*spread("seconds", "lower quartile of processor time", "s"))
RIVALS = by_clock(number("rival_seconds", "the same of what it is compared with", "s"), *spread("ratio", "rival_seconds / seconds"))
AIM = (number("target", "what was aimed at"), flag("met", "whether it is reached"))
TIMED_AIM = (AIM[0], *by_clock(AIM[1]))
CHECKPOINTS = {"t05": 0.5, "t1": 1.0, "t2": 2.0}  # [s]


SIZE = (
    number("step", "of the integration", "s"),
    number("tolerance", "relative, where the integrator chooses its own steps"),
)
REQUIRED = (("position", "centre of mass", "m"), ("angle", "link's angle", "rad"), ("force", "component of a joint's force", "N"))
MEASURED = (
    text("measured", "the coordinate whose error is told apart: an angle, a slide or a place"),
    text("measured_unit", "its unit: rad or m"),
)


def _apart(when: str) -> tuple[Column, ...]:
    """The largest errors of links, lengths and angles kept apart."""
    return (
        number("length_error", f"largest of any link's centre of mass {when}", "m"),
        number("angle_error", f"largest of any link's angle {when}", "rad"),
    )


def _levels(meaning: str) -> tuple[Column, ...]:
    return tuple(number(level, f"{meaning} of {level}s") for level in ("position", "velocity", "acceleration"))


LINK_AT = (text("link", "of the linkage file"), number("t", "time", "s"))


def _pose(ends: str, which: str) -> tuple[Column, ...]:
    """A place and an angle, or what is added to one."""
    return (
        number(f"x{ends}", f"{which} x of the centre of mass", "m"),
        number(f"y{ends}", f"{which} y of the centre of mass", "m"),
        number(f"angle{ends}", f"{which} angle", "rad"),
    )


def _over_processes(name: str, meaning: str, unit: str = "", ties: bool = False) -> tuple[Column, ...]:
    """A median over several processes, and where that of a second race falls; with whatever ties."""
    of = ", whatever ties wins" if ties else ""
    return by_clock(
        number(name, f"{meaning}: median of the processes", unit),
        number(f"{name}_low", f"{meaning}: least that a second race may find{of}", unit),
        number(f"{name}_high", f"{meaning}: most that a second race may find{of}", unit),
    )


def _claim(begins: str, meaning: str) -> tuple[Column, ...]:
    """A ratio from several processes, and whether its spread lies above 1, below, or neither."""
    return (*_over_processes(f"{begins}ratio", meaning), *by_clock(text(f"{begins}verdict", "holds, open or reversed")))


RACED = _over_processes("seconds", "lower quartile of processor time", "s")

RESULTS = Table(
    "one case of the accuracy suites: a linkage, an engine and everything that was chosen for it",
    (
        *CASE,
        *OUTCOME,
        text("note", "what the engine told of its run"),
        *add_columns(text("in_python", "what of the suite's own runs in Python inside its time")),
        text("flag", "why a run that ended counts for nothing"),
        text("link_errors", "JSON: largest position and velocity error of each link"),
        flag("valid", "whether the run passed the validity gate"),
        flag("control", "whether the engine is a negative control, wrong on purpose"),
        number("steps", "steps taken"),
        number("evaluations", "of the equations of motion"),
        number("acceleration_error_median", "of the relative error at the same states"),
        number("acceleration_error_max", "of the relative error at the same states"),
        *MEASURED,
        *(
            number(f"measured_error_{k}", f"of the measured coordinate after {t:g} s", "measured_unit")
            for k, t in CHECKPOINTS.items()
        ),
        *(
            number(f"measured_error_bar_{k}", f"of the reference's positions after {t:g} s", "m, rad")
            for k, t in CHECKPOINTS.items()
        ),
        *_apart("over all times"),
        number("compared", "times at which a truth is known"),
        number("position_error", "largest over links and times", "m, rad"),
        number("velocity_error", "largest over links and times", "m/s, rad/s"),
        number("position_error_bar", "of the reference", "m, rad"),
        number("velocity_error_bar", "of the reference", "m/s, rad/s"),
        number("observed_order", "from this step and the next larger one"),
        number("position_drift", "largest residual of the constraints", "m, rad"),
        number("velocity_drift", "largest rate of it", "m/s, rad/s"),
        number("acceleration_residual", "largest second rate of it", "m/s^2, rad/s^2"),
        number("energy_error", "largest error of the balance of energy, work and losses", "J"),
        number("energy_error_bar", "of that balance's quadrature", "J"),
        *by_clock(
            number("build_time", "of the model and its first step, generated code taken from the store", "s"),
            number("cold_build_time", "the same of the first model in a new process, with nothing stored", "s"),
        ),
        *(
            column
            for name, words in (
                ("step", "one step called from Python"),
                ("native_step", "one step in the engine's own loop"),
                ("acceleration", "one acceleration called from Python"),
            )
            for column in by_clock(
                number(f"{name}_time", words, "s"), *spread(f"{name}_ratio", f"{words}, to the baseline engine's")
            )
        ),
    ),
    len(CASE),
)

TABLES: dict[str, Table] = {
    "results": RESULTS,
    "references": Table(
        "the motion that errors are measured against",
        (
            *WHERE,
            number("t_end", "until where", "s"),
            text("method", "how it was found"),
            number("error_bar_q", "of positions", "m, rad"),
            number("error_bar_v", "of velocities", "m/s, rad/s"),
            number("floor_q", "what rounding all parameters moves positions by", "m, rad"),
            *MEASURED,
            *(
                number(f"measured_{k}", f"measured coordinate after {t:g} s", "measured_unit", exact=True)
                for k, t in CHECKPOINTS.items()
            ),
        ),
        3,
    ),
    "series": Table(
        "one case at one time: the curves of the figures",
        (
            *CASE,
            number("t", "time", "s"),
            number("measured_error", "of the measured coordinate", "rad or m"),
            *_apart("then"),
            number("position_drift", "largest residual of the constraints", "m, rad"),
            number("velocity_drift", "largest rate of it", "m/s, rad/s"),
            number("energy_error", "of the balance of energy, work and losses", "J"),
        ),
        len(CASE) + 1,
        "parquet",
        curves=True,
    ),
    "motions": Table(
        "a link at one time of the true motion, as exactly as it is drawn",
        (*WHERE, number("t_end", "until where", "s"), *LINK_AT, *_pose("", "true")),
        5,
        "parquet",
        curves=True,
    ),
    "poses": Table(
        "a link at one time of a run that is played: its pose there is motions + ahead + gap, and without gap all loops are closed",
        (*CASE, *LINK_AT, *_pose("_ahead", "to the nearest pose with closed loops: true +"), *_pose("_gap", "from there:")),
        len(CASE) + 2,
        "parquet",
        curves=True,
    ),
    "samples": Table(
        "one block of one interleaved race",
        (
            *WHERE,
            *METHOD,
            text("quantity", "what was timed"),
            number("step", "of the steps that were timed", "s"),
            number("process", "its number"),
            number("round", "of the race"),
            number("seconds", "processor time of one repetition", "s"),
        ),
        8,
        "parquet",
        timed=True,
    ),
    "lost": Table(
        "a task whose worker was lost, of tables whose rows have no status",
        (text("table", "that it was to fill"), *WHERE, *OUTCOME),
        3,
    ),
    "untimed": Table(
        "what could not be timed", (*WHERE, *METHOD, text("quantity", "what was to be timed"), *OUTCOME), 7, timed=True
    ),
    "agreement": Table(
        "kinematics of a driven turn, one way against another",
        (text("mechanism", "name of the linkage"), text("first", "one way"), text("second", "the other"), *_levels("difference")),
        3,
    ),
    "singular": Table(
        "a position at which a coordinate reverses",
        (
            text("mechanism", "name of the linkage"),
            text("coordinate", "that reverses"),
            text("kind", "limit or dead centre"),
            number("crank_deg", "angle of the crank there", "deg"),
        ),
        4,
    ),
    "basins": Table(
        "a search for the assembly from random starts",
        (
            text("mechanism", "name of the linkage"),
            text("form", "of the equations"),
            text("method", "of the search"),
            number("spread", "of the starts", "rad or m"),
            number("right", "share that ends in the assembly"),
            number("other", "share that ends in another root"),
            number("iterations", "mean"),
        ),
        4,
    ),
    "driving": Table(
        "a driven turn: torque and joint forces from an engine's accelerations",
        (
            text("mechanism", "name of the linkage"),
            *METHOD,
            *OUTCOME,
            number("torque_error", "relative to the largest torque"),
            number("mean_torque", "over the turn, relative to the largest"),
            number("force_error", "of joint forces, relative to the largest"),
        ),
        5,
    ),
    "audit": Table(
        "one statement of a paper",
        (
            text("paper", "short reference"),
            text("equation", "number"),
            text("name", "what is stated"),
            text("printed", "as it stands there"),
            text("intended", "as it should read, where that differs"),
            text("measured", "what the discrepancy is"),
            text("reason", "why the tolerance is what it is"),
            text("sentence", "what follows for a reader"),
            text("cited", "the paper, in full, and how it was read"),
            text("assumed", "what its numbers need that it does not give"),
            text("cause", "of failing, short; lines with one cause are one mistake"),
            text("cause_text", "why the line fails"),
            text("doubt", "why it may be the extracted text's fault and not the paper's"),
            text("verdict", "ok, misprint, wrong, loose, not given or unreadable"),
            number("printed_off", "discrepancy of the printed form", "as measured"),
            number("intended_off", "discrepancy of the right form", "as measured"),
            number("tolerance", "largest discrepancy of a right form", "as measured"),
            flag("stands", "whether the measurement agrees with the verdict"),
            text("faults", "where it does not"),
            text("example", "a number to check by hand"),
            number("example_printed", "as the printed form has it"),
            number("example_intended", "as the right form has it"),
            number("example_true", "as it is"),
        ),
        3,
    ),
    "reproduction": Table(
        "one quantity of the first paper's example",
        (
            text("group", "of quantities"),
            text("key", "unique name"),
            text("quantity", "in words"),
            number("value", "in its unit", "unit"),
            text("unit", "of the value"),
            number("bracket", "uncertainty", "unit"),
            text("verdict", "refuted, holds or not shown, for claims"),
            text("statement", "what is assumed here, for what is left out"),
        ),
        2,
    ),
    "paper_motion": Table(
        "the motion of that example at one time",
        (
            number("t", "time", "s"),
            *(
                number(f"{x}{rate}", words, unit + per)
                for x, words, unit in (
                    ("x1", "crank's centre", "m"),
                    ("y1", "crank's centre", "m"),
                    ("theta1", "crank's angle", "rad"),
                    ("x3", "slider", "m"),
                )
                for rate, per in (("", ""), ("_rate", "/s"))
            ),
        ),
        1,
    ),
    "published": Table(
        "a published value held against a certified one",
        (
            *WHERE,
            number("t", "time", "s"),
            text("quantity", "its name"),
            text("published", "as printed"),
            text("certified", "to as many digits"),
            number("difference", "of the two"),
            number("printed_digits", "count"),
            number("true_digits", "count"),
            number("error_bar", "of the certified value"),
            number("floor", "what rounding all parameters moves it by"),
        ),
        4,
    ),
    "certificates": Table(
        "a certified scenario, or why it is none",
        (
            *OUTCOME,
            *WHERE,
            number("digits", "of positions and velocities"),
            number("until", "certified until", "s"),
            number("duration", "of the scenario", "s"),
            flag("complete", "whether it is certified to its end"),
            *(number(f"error_{x}", f"bar of {x} at the end", "SI") for x in ("q", "v", "a", "multipliers")),
            *(number(f"floor_{x}", f"what rounding all parameters moves {x} by", "SI") for x in ("q", "v", "a")),
            *MEASURED,
            number("measured_end", "measured coordinate at the end", "measured_unit"),
            number("samples", "stored"),
            number("step", "of the collocation", "s"),
            text("method", "of the stored values"),
            *(
                column
                for name in ("taylor", "collocation")
                for column in (
                    number(f"{name}_until", "reached", "s"),
                    number(f"{name}_off_closed_form", "largest position error", "m, rad"),
                    text(f"{name}_stopped", "why it ended"),
                    text(f"{name}_method", "in words"),
                    number(f"{name}_drift_q", "residual of the constraints", "m, rad"),
                    number(f"{name}_drift_v", "rate of it", "m/s, rad/s"),
                )
            ),
        ),
    ),
    "kernel_machine": Table(
        "the processor, measured and named",
        (
            text("key", "unique name"),
            text("quantity", "in words"),
            text("unit", "of the value"),
            *OUTCOME,
            *by_clock(*spread("value", "measured", "unit")),
            text("statement", "of what is not measured"),
        ),
        1,
        timed=True,
    ),
    "kernel_steps": Table(
        "a step of a compiled formulation in its own loop, against another engine's",
        (
            *WHERE,
            text("formulation", "which is compiled"),
            text("stabilization", "of the compiled one"),
            text("rival", "engine"),
            text("settings", "of the rival"),
            number("step", "of both", "s"),
            *OUTCOME,
            *SECONDS,
            *RIVALS,
            *TIMED_AIM,
        ),
        6,
        timed=True,
    ),
    "claim_races": Table(
        "n - m unknowns against n + m in one process",
        (
            *WHERE,
            number("process", "its number"),
            text("what", "is raced: step, projected step or batch"),
            *OUTCOME,
            *SECONDS,
            *RIVALS,
        ),
        4,
        timed=True,
    ),
    "kernel_claim": Table(
        "n - m unknowns against n + m, with nothing else that differs",
        (
            *WHERE,
            number("n", "coordinates"),
            number("rows", "independent constraint rows"),
            number("unknowns_gauss", "n - m"),
            number("unknowns_lagrange", "n + m"),
            *(
                number(f"{what}_{name}", f"{words} of one acceleration")
                for name in ("gauss", "lagrange")
                for what, words in (("operations", "count"), ("divisions", "count"), ("critical", "cycles of the longest chain"))
            ),
            *OUTCOME,
            number("processes", "that raced to an end"),
            *_claim("", "time with n + m / with n - m unknowns, of a step"),
            *_claim("projected_", "the same of steps that end on the constraints"),
            *_claim("batch_", "the same of many trajectories in lanes"),
        ),
        2,
    ),
    "search_knobs": Table(
        "something about an engine that searches may turn",
        (
            text("engine", "as the command line calls it"),
            text("knob", "its name"),
            text("meaning", "in words"),
            text("source", "address where it is documented, or why it is our own search"),
        ),
        2,
    ),
    "search_space": Table(
        "a variant of an engine that was searched",
        (*METHOD, text("size", "what its ladder walks over: step or tolerance"), text("options", "JSON: every other knob")),
        4,
    ),
    "search_ladder": Table(
        "one evaluation: a variant at one size, with its errors over the whole run",
        (
            *WHERE,
            *METHOD,
            *SIZE,
            number("until", "end of the run", "s"),
            number("steps", "steps taken"),
            *(number(f"{kind}_error", f"largest of any {words} over the run", unit) for kind, words, unit in REQUIRED),
            *add_columns(number("end_error", "largest of any centre of mass at the end of the run", "m")),
            *OUTCOME,
            text("ended", "why this variant was tried no further, at its last evaluation"),
        ),
        8,
        "parquet",
    ),
    "search_races": Table(
        "one block of one process of the race of a linkage; of an engine that was lost in it, why",
        (
            *WHERE,
            *METHOD,
            *SIZE,
            number("process", "its number"),
            number("round", "of the race"),
            *OUTCOME,
            number("seconds", "processor time of a whole run", "s"),
        ),
        10,
        "parquet",
        timed=True,
    ),
    "search_times": Table(
        "a variant at one size in the race of a linkage",
        (*WHERE, *METHOD, *SIZE, *OUTCOME, *RACED),
        8,
        timed=True,
    ),
    "search_winners": Table(
        "the cheapest way of an engine that is as exact as required",
        (
            *WHERE,
            text("required", "what must be exact: position, angle or force over the whole run, or position at its end"),
            number("accuracy", "the largest error that is required", "unit"),
            text("unit", "of accuracy and error: m, rad or N"),
            *METHOD,
            *SIZE,
            number("steps", "steps taken"),
            number("error", "of the winner; where nothing passed, the least that was seen", "unit"),
            *OUTCOME,
            *RACED,
            *_over_processes("ratio", "seconds / those of the cheapest own way", ties=True),
            flag("own", "whether it is that way"),
            flag("ours", "whether the engine is the suite's own"),
            *AIM,
            text("options", "JSON: the winner's knobs"),
            number("variants", "in the engine's space"),
            number("evaluations", "of all of them together"),
            number("budget", "evaluations that each might take"),
            number("most_steps", "of a run"),
            number("passing", "variants that pass at some size"),
            number("raced", "of those, near enough to the cheapest to be raced"),
            text("tied", "those that cannot be told from the fastest, first of the file first"),
            *add_columns(text("in_python", "what of the suite's own runs in Python inside its time")),
        ),
        6,
        timed=True,
    ),
    "kernel_batch": Table(
        "many trajectories from different states on one core, against another engine's",
        (
            *WHERE,
            number("states", "trajectories"),
            number("steps", "steps of each"),
            text("rival", "engine"),
            text("settings", "of the rival"),
            number("rival_steps", "steps of each"),
            *OUTCOME,
            *SECONDS,
            *RIVALS,
            number("lanes", "of a vector"),
            number("lanes_error", "largest difference from single runs", "m, rad"),
            number("lost", "trajectories that ended early"),
            *TIMED_AIM,
        ),
        2,
    ),
    "kernel_rhs": Table(
        "one right-hand side, a state in and its accelerations out",
        (
            *WHERE,
            text("own", "how the compiled formulation is asked"),
            text("rival", "how the engine is asked"),
            text("engine", "the rival"),
            text("settings", "of the rival"),
            *OUTCOME,
            *SECONDS,
            *RIVALS,
            *TIMED_AIM,
        ),
        6,
        timed=True,
    ),
    "kernel_bounds": Table(
        "how near a step comes to what the processor allows",
        (
            *WHERE,
            text("quantity", "one trajectory or a batch"),
            *OUTCOME,
            *SECONDS,
            number("cycles", "of the longest chain of operations"),
            number("flops", "operations of a step"),
            *by_clock(number("bound", "least time", "s"), number("share", "of the bound that is reached")),
        ),
        3,
    ),
    "kernel_agreement": Table(
        "accelerations of a compiled formulation against the same in numpy",
        (
            *WHERE,
            text("formulation", "which is compiled"),
            text("place", "where the states are taken from"),
            number("states", "compared"),
            *OUTCOME,
            number("error", "worst relative difference"),
            number("numpy_error", "the same of two formulations in numpy"),
            text("against", "what it is compared with"),
            *AIM,
        ),
        4,
    ),
    "kernel_long": Table(
        "a long run with projection where no energy is lost or gained",
        (
            *WHERE,
            text("formulation", "which is compiled"),
            number("step", "of the integration", "s"),
            number("t_end", "end of the run", "s"),
            *OUTCOME,
            number("position_drift", "largest residual of the constraints", "m, rad"),
            number("velocity_drift", "largest rate of it", "m/s, rad/s"),
            number("energy", "largest kinetic energy", "J"),
            number("energy_first", "largest error in the first tenth", "J"),
            number("energy_last", "largest error in the last tenth", "J"),
            number("energy_max", "largest error", "J"),
            *AIM,
            number("order", "of the energy's error, from the run at twice the step"),
        ),
        4,
    ),
    "kernel_energy": Table(
        "the energy error of a long run, tenth by tenth",
        (
            *WHERE,
            text("formulation", "which is compiled"),
            number("step", "of the integration", "s"),
            number("t", "end of the tenth", "s"),
            number("energy_error", "largest in it", "J"),
        ),
        5,
    ),
    "kernel_kinematics": Table(
        "positions with velocities and accelerations over a turn of the crank",
        (
            *WHERE,
            number("samples", "of the turn"),
            text("method", "in words"),
            *OUTCOME,
            *SECONDS,
            *by_clock(*spread("rate", "positions per second", "1/s")),
            *(number(f"{x}_error", f"of {x}s, relative to the largest") for x in ("position", "velocity", "acceleration")),
            *TIMED_AIM,
        ),
        4,
    ),
    "scaling_races": Table(
        "one right-hand side of a chain of four-bars in one process",
        (
            text("engine", "and its way"),
            text("quantity", "how it is asked"),
            number("size", "windows of the chain"),
            number("process", "its number"),
            number("n", "coordinates"),
            *OUTCOME,
            number("generate_seconds", "to generate the code or build the model", "s"),
            number("compile_seconds", "to compile it", "s"),
            number("error", "of the accelerations, relative to the largest"),
            *SECONDS,
        ),
        4,
        timed=True,
    ),
    "scaling": Table(
        "one right-hand side of a chain of four-bars, over several processes",
        (
            text("engine", "and its way"),
            text("quantity", "how it is asked"),
            number("size", "windows of the chain"),
            number("n", "coordinates"),
            *OUTCOME,
            *by_clock(
                number("generate_seconds", "to generate the code or build the model", "s"),
                number("compile_seconds", "to compile it", "s"),
            ),
            number("error", "of the accelerations, relative to the largest"),
            *add_columns(number("processes", "that timed it")),
            *by_clock(
                number("seconds", "lower quartile of processor time, the median over the processes", "s"),
                number("low", "least that a second race may find; of one process, the 5 percent point", "s"),
                number("high", "most that a second race may find; of one process, the 95 percent point", "s"),
            ),
        ),
        3,
    ),
    "kernel_growth": Table(
        "how that time grows",
        (
            text("engine", "and its way"),
            text("quantity", "how it is asked"),
            number("sizes", "that the exponent is taken from"),
            number("from", "windows of the smallest of them"),
            *add_columns(number("processes", "that timed all of them")),
            *by_clock(number("exponent", "p of seconds ~ size^p")),
            *add_columns(
                *by_clock(
                    number("exponent_low", "least that a second race may find; none from one process"),
                    number("exponent_high", "most that a second race may find; none from one process"),
                )
            ),
        ),
        2,
        timed=True,
    ),
    "atlas": Table(
        "how far one way of an engine goes along one axis of difficulty; written by the verb atlas, not by a suite",
        (
            text("axis", "what grows along it"),
            *METHOD,
            text("unit", "of the axis"),
            number("easiest", "value of the axis"),
            number("hardest", "value of the axis"),
            number("passes_to", "hardest value with a pass"),
            number("ends_at", "hardest value that did not fail"),
            number("breaks_at", "first value that does not pass"),
            text("last", "verdict on the hardest value that was run"),
            number("error", "there, of the linkage's size, or in radians"),
            number("runs", "that it took"),
            text("reason", "why it is no pass"),
            text("commit", "of the code that was run"),
        ),
        5,
    ),
    "baseline": Table(
        "one figure of the accuracy gate",
        (
            *CASE,
            text("metric", "column of the results, or of the references"),
            text("value", "accepted"),
            text("accepted", "date and reason"),
            number("format", "of this table"),
        ),
        len(CASE) + 1,
    ),
}
LATER = {f"{old}_{k}": f"{new}_{k}" for old, new in (("crank", "measured"), ("crank_error", "measured_error")) for k in CHECKPOINTS}
LATER |= {f"crank_error_bar_{k}": f"measured_error_bar_{k}" for k in CHECKPOINTS}
LATER |= {"crank_error": "measured_error", "crank_end": "measured_end"}
RENAMED: dict[str, dict[str, str]] = {  # table -> column of format 1 -> column of today
    "results": LATER,
    "references": LATER,
    "series": LATER,
    "certificates": LATER,
}
ALWAYS_MEASURED = {"measured": "angle of the crank or of the first link", "measured_unit": "rad"}  # in format 1


def row_of(table: Table, values: Row) -> dict[str, Any]:
    """A row with every column of the table and its type.

    Raises:
        KeyError: the schema knows a given column not.
        TypeError, ValueError: a value is not of its column's type.
    """
    strange = values.keys() - set(table.names)
    if strange:
        raise KeyError(f"columns without a place in the schema: {', '.join(sorted(map(str, strange)))}")
    return {column.name: type_column(column, values.get(column.name)) for column in table.columns}


def type_column(column: Column, value: Any) -> Any:
    """A value, or what is written of it, as its column's type."""
    missing = value is None or value == "" or (isinstance(value, float) and math.isnan(value))
    match column.kind:
        case "text":
            return "" if missing else str(value)
        case "number":
            return math.nan if missing else float(value)
        case "flag":
            if missing or isinstance(value, bool):
                return value if isinstance(value, bool) else None
            words = {"true": True, "false": False, "1": True, "0": False, "1.0": True, "0.0": False}
            if str(value).lower() not in words:
                raise ValueError(f"{value!r} is neither true nor false")
            return words[str(value).lower()]


def write_rows(column: Column, value: Any, digits: int = DIGITS) -> str:
    """A typed value as a CSV file has it."""
    if column.kind == "number":
        return "" if math.isnan(value) else repr(value) if column.exact else f"{value:.{digits}g}"
    return "" if value is None else str(value)


def is_supported(table: Table, row: Row) -> dict[str, Any]:
    """A typed row whose times and ratios keep the digits that their spread supports.

    A value and the ends of its spread are rounded to the power of ten that is not above a hundredth of that spread, but keep four
    digits, one more than reports print, so that nothing printed is rounded twice; four where no spread is known.
    """
    rounded = dict(row)
    for column in table.columns:
        x = row[column.name]
        if not column.timed or column.kind != "number" or not math.isfinite(x) or x == 0 or column.name.endswith(("_low", "_high")):
            continue
        ends = [f"{column.name}_low", f"{column.name}_high"]
        low, high = (row.get(end, math.nan) for end in ends)
        first = math.floor(math.log10(abs(x)))
        known = math.isfinite(high - low) and high > low
        last = min(first - 3, math.floor(math.log10((high - low) / 100)) if known else first)
        rounded |= {name: round(row[name], -last) for name in (column.name, *ends) if name in row}
    return rounded


def csv_text(columns: Sequence[Column], rows: Iterable[Row], digits: int = DIGITS) -> str:
    """Typed rows as a CSV file: a head, and a line a row."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow([c.name for c in columns])
    writer.writerows([write_rows(c, row[c.name], digits) for c in columns] for row in rows)
    return out.getvalue()


def write_table(name: str, rows: Iterable[Row], folder: Path) -> tuple[Path, ...]:
    """Write a table of the schema into a folder, in as many files and of such a kind as the schema says; each atomic.

    Two writings of the same rows are the same bytes. What an earlier format wrote of this table elsewhere is taken away.

    Raises:
        KeyError: there is no such table, or a row has a column that it has not.
        ValueError: two rows with times of their own have the same key.
    """
    table = TABLES[name]
    whole = [is_supported(table, row_of(table, row)) for row in rows]
    paths = {}
    for part, columns in table.parts.items():
        apart = part and not table.timed
        some = [row for row in whole if _tells(table, row)] if apart else whole
        if apart and len({_key(table, row) for row in some}) < len(some):
            raise ValueError(f"table {name}: two rows with times have the same key")
        if apart and not some:  # nothing was timed
            continue
        paths[folder / part / f"{name}.{table.suffix}"] = columns, some
    for path, (columns, some) in paths.items():
        if table.suffix == "csv":
            write_text(path, csv_text(columns, some))
        else:
            write_parquet(name, columns, some, path)
    for stale in files_of(name, folder):
        if stale not in paths and name != "baseline":
            stale.unlink()
    return tuple(paths)


def files_of(name: str, folder: Path) -> tuple[Path, ...]:
    """The place of a table in the folder of a run of whatever format."""
    places = [folder / part / f"{name}.{kind}" for part in ("", TIMES) for kind in ("csv", "parquet")]
    return tuple(path for path in places if path.exists())


def _tells(table: Table, row: Row) -> bool:
    """Tell whether a clock has decided anything in a row."""
    return any(write_rows(c, row[c.name]) != "" for c in table.columns if c.timed)


def _key(table: Table, row: Row) -> tuple[str, ...]:
    return tuple(write_rows(c, row[c.name]) for c in table.key)


def write_parquet(name: str, columns: Sequence[Column], rows: Sequence[Row], path: Path) -> None:
    """Typed rows as Parquet, with the format in its metadata; all digits are kept but those of curves."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = TABLES[name]
    curves = [c.name for c in columns if table.curves and c.kind == "number" and c.name not in KEY]
    kinds = {"text": pa.string(), "number": pa.float64(), "flag": pa.bool_()}
    fields = {c.name: pa.float32() if c.name in curves else kinds[c.kind] for c in columns}
    drawn = {*curves} - {c.name for c in table.key}
    arrays = {n: pa.array([_pick_drawn(row[n]) if n in drawn else row[n] for row in rows], type=t) for n, t in fields.items()}
    content = pa.table(arrays).replace_schema_metadata({b"gauss_bench": json.dumps({"table": name, "format": FORMAT}).encode()})
    measured = [c.name for c in columns if c.kind == "number" and c.name not in KEY]
    packed = {"compression": "zstd", "compression_level": 19, "use_dictionary": [n for n in fields if n not in measured]}
    packed |= {"write_statistics": False}  # for readers that skip parts of large files; of a small one they are half
    atomically(path, lambda part: pq.write_table(content, part, use_byte_stream_split=measured, **packed))


def digits_of(name: str) -> int:
    """Digits of a table's numbers: curves are kept as they are drawn."""
    return DRAWN if TABLES[name].curves else DIGITS


def _pick_drawn(x: float) -> float:
    """A value to 1.2e-4, as a binary fraction of 13 bits: a pen's width is 1e-3."""
    if not math.isfinite(x):
        return x
    mantissa, exponent = math.frexp(x)
    return math.ldexp(round(mantissa * 2**13), exponent - 13)


def write_schema(folder: Path) -> None:
    """Write what every column means, and the format of the tables beside it."""
    plain = Column("", "text", "")
    said = {
        name: {
            "meaning": t.meaning,
            "keys": t.keys,
            "files": [str(Path(part) / f"{name}.{t.suffix}") for part in t.parts],
            "columns": [
                {f.name: x for f in fields(c) if (x := getattr(c, f.name)) != getattr(plain, f.name) or f.name == "kind"}
                for c in t.columns
            ],
        }
        for name, t in TABLES.items()
    }
    write_text(folder / SCHEMA_FILE, json.dumps({"format": FORMAT, "tables": said}, indent=1) + "\n")


def read_environment(folder: Path) -> dict[str, Any]:
    """Read the provenance of the run in a folder; nothing where it has none.

    Raises:
        TableError: the file is damaged.
    """
    path = folder / ENVIRONMENT
    try:
        told = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    except ValueError as error:
        raise TableError(f"{path}: no JSON: {error}") from error
    if not isinstance(told, dict):
        raise TableError(f"{path}: not an object")
    return told


def format_of(folder: Path) -> int:
    """The format of the tables in a folder; 1 where it does not say.

    Raises:
        TableError: it is a later one than is known here, or `tables.json` is damaged.
    """
    path = folder / SCHEMA_FILE
    if not path.exists():
        return 1
    try:
        version = json.loads(path.read_text(encoding="utf-8"))["format"]
        if not isinstance(version, int) or isinstance(version, bool) or version < 1:
            raise ValueError(f"{version!r} is no format")
    except (ValueError, KeyError, TypeError) as error:
        raise TableError(f"{path}: does not tell the format of the tables beside it: {error}") from error
    return check(version, path)


def check(version: int, path: Path) -> int:
    """A format that can be read.

    Raises:
        TableError: it is later than FORMAT.
    """
    if version > FORMAT:
        raise TableError(f"{path}: format {version} is later than this version of gauss-bench can read, which is {FORMAT}")
    return version


def read_table(name: str, folder: Path) -> tuple[dict[str, Any], ...]:
    """Rows of a table in the folder of a run, typed, in the order of the file; none where there is no such file.

    Raises:
        TableError: a file is damaged, lacks a column, holds what is not of its column's type, is of a later format, or tells times
            of a row that there is not.
    """
    version, table = format_of(folder), TABLES[name]
    if version < APART and name != "baseline":
        old = files_of(name, folder)
        return read_file(name, old[0], version) if old else ()
    parts = []
    for part, columns in table.parts.items():
        path = folder / part / f"{name}.{table.suffix}"
        parts.append(
            (path, read_file(name, path, None if name == "baseline" else version, columns)) if path.exists() else (path, ())
        )
    (_, rows), *others = parts
    for path, times in others:
        rows = _join(table, rows, times, path)
    return rows


def _join(
    table: Table, rows: tuple[dict[str, Any], ...], times: tuple[dict[str, Any], ...], path: Path
) -> tuple[dict[str, Any], ...]:
    """Rows with what a clock decided of them."""
    timed = [c.name for c in table.columns if c.timed]
    clocked = {_key(table, row): {n: row[n] for n in timed} for row in times}
    strange = clocked.keys() - {_key(table, row) for row in rows}
    if strange or len(clocked) < len(times):
        which = " ".join(x for x in min(strange, default=_key(table, times[0])) if x)
        raise TableError(f"{path}: a row of times has no row of its own in the table beside it: {which}")
    return tuple(row | clocked.get(_key(table, row), {}) for row in rows)


def read_file(
    name: str, path: Path, form: int | None = None, columns: Sequence[Column] | None = None
) -> tuple[dict[str, Any], ...]:
    """Rows of a table in a file of the given format, or of the one that its own column `format` tells.

    Args:
        columns: that lie in this file; all of the table, if not given. What it does not hold is missing in every row.

    Raises:
        TableError: as `read_table`.
    """
    table = TABLES[name]
    head, lines = _csv_lines(path) if path.suffix == ".csv" else _parquet_lines(path)
    if not head:  # a table without rows has its columns
        raise TableError(f"{path}: table {name}: is empty, without the names of its columns; it was cut off or never written")
    if form is None:
        form = _own_format(path, head, lines)
    if form < FORMAT:
        head, lines = migrate_rows(name, head, lines, form)
    wanted = [c for c in columns or table.columns if not c.added] if form == FORMAT else table.columns[:1]
    lacking = [c.name for c in wanted if c.name not in head]
    if lacking:
        raise TableError(f"{path}: table {name}: column {lacking[0]!r} is missing")
    rows = []
    for count, line in enumerate(lines, 1):
        row = {}
        for column in table.columns:
            try:
                row[column.name] = type_column(column, line.get(column.name))
            except (TypeError, ValueError) as error:
                raise TableError(f"{path}: table {name}, row {count}, column {column.name!r}: {error}") from error
        rows.append(row)
    return tuple(rows)


def _own_format(path: Path, head: list[str], lines: list[dict[str, Any]]) -> int:
    """The value of the column `format`, or 1 where there is none."""
    try:
        told = {int(float(line["format"])) for line in lines} if "format" in head else {1}
    except (TypeError, ValueError) as error:
        raise TableError(f"{path}: column 'format': {error}") from error
    return check(max(told, default=FORMAT), path)


def migrate_rows(name: str, head: list[str], lines: list[dict[str, Any]], form: int) -> tuple[list[str], list[dict[str, Any]]]:
    """Read a file of an older format under the names of today; what it does not say is missing in every row."""
    names = RENAMED.get(name, {})
    fresh = [{names.get(k, k): x for k, x in line.items()} for line in lines]
    if name == "results" and form < 3:  # whose builds did not include the first step before format 3
        fresh = [{k: v for k, v in x.items() if not k.startswith("build_time")} for x in fresh]
    if name == "results" and form == 1:  # in which stabilised runs were given the times of steps without stabilisation
        timed = [c.name for c in TABLES[name].columns if c.name.startswith(("step_", "native_step_"))]
        fresh = [x if x.get("stabilization") in ("none", "") else {k: v for k, v in x.items() if k not in timed} for x in fresh]
    if name == "samples":  # which were of a single process before format 5
        fresh = [{"process": 0} | x for x in fresh]
    if MEASURED[0] in TABLES[name].columns:
        fresh = [ALWAYS_MEASURED | x for x in fresh]
    if name == "baseline":  # whose rows tell of columns
        metrics = RENAMED.get("results", {}) | RENAMED.get("references", {})
        fresh = [line | {"metric": metrics.get(line.get("metric", ""), line.get("metric", ""))} for line in fresh]
    return [names.get(x, x) for x in head], fresh


def migrate(folder: Path) -> tuple[Path, ...]:
    """Bring every table of a run's folder, and a baseline beside them, to today's format in its place; the files written.

    Nothing is written before all can be read. Texts stay as they are, dates and reasons of a baseline among them; times keep what
    their spread supports. What an older format wrote twice or elsewhere is taken away.

    Raises:
        TableError: as `read_table`.
    """
    path = folder / "baseline.csv"
    read = {name: read_table(name, folder) for name in TABLES if name != "baseline" and files_of(name, folder)}
    baseline = read_file("baseline", path) if path.exists() else ()
    files: list[Path] = []
    for name, rows in read.items():
        files += write_table(name, rows, folder)
    if baseline:
        files += write_table("baseline", [row | {"format": BASELINE_FORMAT} for row in baseline], folder)
    if read:
        write_schema(folder)
    return tuple(files)


def _csv_lines(path: Path) -> tuple[list[str], list[dict[str, Any]]]:
    try:
        with path.open(encoding="utf-8", newline="") as file:
            reader = csv.DictReader(file, strict=True)
            lines = [{k: x for k, x in line.items() if k is not None} for line in reader]
            return list(reader.fieldnames or []), lines
    except (csv.Error, UnicodeDecodeError) as error:
        raise TableError(f"{path}: no CSV file: {error}") from error


def _parquet_lines(path: Path) -> tuple[list[str], list[dict[str, Any]]]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        content = pq.read_table(path)
    except (pa.ArrowInvalid, OSError) as error:
        raise TableError(f"{path}: no Parquet file: {error}") from error
    return content.column_names, content.to_pylist()


def atomically(path: Path, write: Callable[[Path], object]) -> None:
    """Let `write` fill a file beside `path`, then put it in place in one move."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        write(part)
        with part.open("rb") as file:
            os.fsync(file.fileno())
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def refuse_foreign(signs: Mapping[Path, str]) -> None:
    """Let files be written over that are not there, or that gauss-bench wrote: those hold the sign given here.

    Raises:
        FileExistsError: naming a file of somebody else.
    """
    for path, sign in signs.items():
        if path.exists() and sign not in path.read_text(encoding="utf-8", errors="replace"):
            raise FileExistsError(f"{path}: is there already, and gauss-bench did not write it; move it or take another folder")


def write_text(path: Path, content: str) -> None:
    atomically(path, lambda part: part.write_text(content, encoding="utf-8"))


def write_bytes(path: Path, content: bytes) -> None:
    atomically(path, lambda part: part.write_bytes(content))
