"""The whole audit: every line of the three papers, read from their data files and measured.

A data file holds what a paper says, line by line, in its order; `forms` holds the functions that its lines name. The file decides
nothing: whether a line is right as printed is measured, and only why it fails is said there, once for all lines with that cause.
"""

import tomllib
from collections.abc import Callable, Iterable
from functools import cache
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any, cast

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from gauss_bench.papers.line import SAME_TEXT, Cause, Example, Line, Verdict, row
from gauss_bench.untrusted import parse_toml

FOLDER = Path(__file__).parent
PAPERS = ("yuan_ge_2016", "wang_2010", "men_2009")
ROOM = "gauss_bench.papers"


class FileTable(BaseModel):
    """A table of a data file: no key is left unread."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class ToleranceTable(FileTable):
    """Largest discrepancy of a right form, and why."""

    value: float = Field(ge=0, allow_inf_nan=False)
    reason: str


class CauseTable(FileTable):
    """See `line.Cause`."""

    kind: Verdict
    text: str
    doubt: str = ""


class NumberTable(FileTable):
    """A number that a reader can check by hand: what it is, with its unit, and the function that gives its true value."""

    text: str
    truth: str


class ExampleEntry(FileTable):
    """The number that a form gives, and the function that computes it from the form."""

    number: str
    of: str


class LineEntry(FileTable):
    """A line: right as printed, with one `form`, or not, with `intended`, a `cause` and both forms."""

    place: str
    name: str
    printed: str
    measure: str
    tolerance: str
    remark: str
    form: str | None = None
    intended: str | None = None
    cause: str | None = None
    printed_form: str | None = None
    intended_form: str | None = None
    example: ExampleEntry | None = None


class Chapter(FileTable):
    """Lines whose functions are those of one module of `forms`; `measure` says in words what each measure gives."""

    title: str
    forms: str
    measure: dict[str, str]
    line: tuple[LineEntry, ...]


class Paper(FileTable):
    """A data file.

    Attributes:
        paper: its short name; authors, title, source: where it is to be found.
        extract: in what form it was read.
        assumed: what its numbers need that it does not give.
    """

    paper: str
    authors: str
    title: str
    source: str
    extract: str
    assumed: str
    tolerance: dict[str, ToleranceTable]
    cause: dict[str, CauseTable]
    number: dict[str, NumberTable] = {}
    chapter: tuple[Chapter, ...]


@cache
def lines() -> tuple[Line, ...]:
    """In the order of the papers and their equations."""
    return tuple(line for name in PAPERS for line in lines_of(FOLDER / f"{name}.toml"))


def audit() -> dict[str, Any]:
    """{"audit": rows}: see `line.row` for their columns."""
    return {"audit": [row(line) for line in lines()]}


def read(path: Path) -> Paper:
    """The data file.

    Raises:
        ValueError: it is not TOML, or a key is missing, unknown or of the wrong type; the message names file, table and key.
    """
    try:
        return Paper.model_validate(parse_toml(path.read_text(encoding="utf-8")))
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"{path.name}: TOML syntax: {error}") from error
    except ValidationError as error:
        first = error.errors()[0]
        raise ValueError(f"{path.name}: {'.'.join(map(str, first['loc']))}: {first['msg']}") from error


def lines_of(path: Path) -> tuple[Line, ...]:
    """The lines of a data file with their functions.

    Raises:
        ValueError: `read` refuses the file; a name of a function, tolerance, cause or number is unknown; one is given that no
            line uses; two lines have one name; or a line is neither right as printed nor corrected.
    """
    paper = read(path)
    for chapter in paper.chapter:
        list_used(path, "chapter.measure", chapter.measure, (entry.measure for entry in chapter.line))
    entries = [entry for chapter in paper.chapter for entry in chapter.line]
    list_used(path, "tolerance", paper.tolerance, (entry.tolerance for entry in entries))
    list_used(path, "cause", paper.cause, (entry.cause for entry in entries if entry.cause))
    list_used(path, "number", paper.number, (entry.example.number for entry in entries if entry.example))
    names = [entry.name for entry in entries]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise ValueError(f"{path.name}: chapter.line: name: two lines are called {twice[0]!r}")
    return tuple(line_of(path, paper, chapter, entry) for chapter in paper.chapter for entry in chapter.line)


def list_used(path: Path, table: str, given: Iterable[str], named: Iterable[str]) -> None:
    """Every key of a table is named by a line, and every name is a key."""
    given, named = set(given), set(named)
    for names, fault in ((named - given, "no such key, though a line names it"), (given - named, "no line names it")):
        if names:
            raise ValueError(f"{path.name}: {table}.{min(names)}: {fault}")


def line_of(path: Path, paper: Paper, chapter: Chapter, entry: LineEntry) -> Line:
    """The line of an entry."""
    where = f"{path.name}: chapter {chapter.title!r}, line {entry.name!r}"
    corrected = (entry.intended, entry.cause, entry.printed_form, entry.intended_form)
    if not (all(corrected) and entry.form is None) and not (entry.form and not any(corrected)):
        raise ValueError(f"{where}: either `form`, or all of `intended`, `cause`, `printed_form` and `intended_form`")
    module = module_of(f"{where}, forms", f"forms.{chapter.forms}")

    def named(key: str, name: str) -> Callable[..., Any]:
        return function(f"{where}, {key}", module, name)

    cause = None
    if entry.cause:
        told = paper.cause[entry.cause]
        cause = Cause(entry.cause, told.kind, told.text, told.doubt)
        if cause.kind == Verdict.OK or (cause.kind == Verdict.UNREADABLE and not cause.doubt):
            raise ValueError(f"{where}: cause {entry.cause!r}: it is not ok, and what is unreadable says by its `doubt` why")
    example = None
    if entry.example:
        number = paper.number[entry.example.number]
        example = Example(number.text, named("example.of", entry.example.of), named(f"number.{entry.example.number}", number.truth))
    tolerance = paper.tolerance[entry.tolerance]
    return Line(
        paper=paper.paper,
        equation=entry.place,
        name=entry.name,
        printed=entry.printed,
        intended=entry.intended or SAME_TEXT,
        verdict=cause.kind if cause else Verdict.OK,
        printed_form=named("printed_form", entry.form or entry.printed_form or ""),
        intended_form=named("intended_form", entry.form or entry.intended_form or ""),
        measure=named("measure", entry.measure),
        measured=chapter.measure[entry.measure],
        tolerance=tolerance.value,
        reason=tolerance.reason,
        sentence=entry.remark,
        cause=cause,
        example=example,
        cited=f"{paper.authors}: {paper.title}. {paper.source}. {paper.extract}",
        assumed=paper.assumed,
    )


def module_of(where: str, name: str) -> ModuleType:
    """A module of this room."""
    try:
        return import_module(f"{ROOM}.{name}")
    except ModuleNotFoundError as error:
        raise ValueError(f"{where}: no module {ROOM}.{name}") from error


def function(where: str, module: ModuleType, name: str) -> Callable[..., Any]:
    """A function by its name in the module, or by its path in this room, such as `crank_slider.mass`."""
    path, _, plain = name.rpartition(".")
    owner = module_of(where, path) if path else module
    value = getattr(owner, plain, None)
    if not callable(value):
        raise ValueError(f"{where}: no function {plain!r} in {owner.__name__}")
    return cast(Callable[..., Any], value)
