"""Make random lists of arguments, sound and hostile, for every verb with all of its options."""

import argparse
import random
from collections.abc import Collection, Iterator, Sequence
from functools import cache
from itertools import count
from typing import Any

from gauss_bench.api.options import parser
from gauss_bench.cli import ACTIONS

SOUND = (
    "four_bar", "crank_slider", "pendulum", "projectile", "parallelogram", "six_bar", "n_four_bar_3", "pendulums_2",
    "good/four_bar.toml",
)  # fmt: skip
LINKAGES = (
    *SOUND * 3, "n_four_bar_400", "pendulums_150", "n_four_bar_999", "nothing", "", ".", "/", "/dev/null", "/dev/zero",
    "/proc/self/mem", "good", "bad.toml", "empty.toml", "model.xml", "\x00", "a\nb", "\x1b[31m", "x" * 5000, "-", "--",
    "four_bar\x1b[2J", "\ud800",
)  # fmt: skip
NUMBERS = (
    "0", "1", "-1", "2", "7", "1e-3", "0.01", "0.1", "1e9", "1e12", "1e-12", "1e-300", "5e-324", "1e300", "1e308", "1e400",
    "nan", "inf", "-inf", "1e-9", "1e6", "99999999999999999999", "-1e-3", "abc", "", " ", "0x10", "1,5", "1e", "\u0661",
    "1_000",
)  # fmt: skip
TEXTS = (
    "", " ", "default", "tuned", "gauss", "mujoco", "dop853", "rk4", "crank", "crank.A", "coupler.P", "torque", "driven",
    "cycloid", "motor=3", "crank=90", "A=0", "crank=nan", "crank=1e300", "B", "slide", "=", "a=b", "a=b,c", ",,,", "constant",
    "constant:speed=1e300", "sine:travel_deg=1e12", "sine:time=1e-300", "poly345:time=0", "table", "table:file=nothing",
    "table:file=rows.txt", "table:file=/dev/zero", "constant:speed=abc", "constant:link=rocker", "\x1b[31m", "\x00", "a\nb",
    "x"*3000, "\ud800", "<b>", "é", "reason", "models", "metrics", "singular", "step", "quick", "gate", "full", "kernel",
    "../..", "none", "projection", "../x.toml",
)  # fmt: skip
PATHS = (
    "out.csv", "out.svg", "out.png", "out.gif", "out.html", "out.toml", "out.npz", "out.txt", "out", "good", ".", "/", "",
    "csv", "/dev/full", "/dev/null", "/proc/x/y.svg", "no/such/folder/out.svg", "good/four_bar.toml", "x"*300 + ".svg",
    "a\x00b.svg", "\ud800.svg", "out.SVG", "\x1b[31m.svg", "/dev/full/x.csv",
)  # fmt: skip
ENGINES = (
    "gauss", "lagrange", "schur", "gauss-native", "minimal", "mujoco", "pinocchio", "exudyn", "casadi", "c", "nothing", "",
    "a:b", "os:system", "math:pi", "gauss,lagrange", "x"*3000, "\x1b[31m", "no.such:Class", ":", "gauss_bench.cli:main",
)  # fmt: skip
IN_PLACE = ("built_in",)  # options that write into the folder of the suite
QUICK = ("show", "import")  # verbs that have no long work to do


@cache
def _verbs() -> dict[str, argparse.ArgumentParser]:
    (found,) = (x for x in parser(ACTIONS)._actions if isinstance(x, argparse._SubParsersAction))
    return dict(found.choices)


def verbs() -> tuple[str, ...]:
    return tuple(_verbs())


def hostile_lists(seed: int, only: Collection[str] = ()) -> Iterator[tuple[list[str], bool]]:
    """Yield different lists with whether they may take long; of these verbs alone if some are given."""
    known = set[tuple[str, ...]]()
    for index in count():
        made, may_work = hostile_list(seed, index, only)
        if tuple(made) not in known:
            known.add(tuple(made))
            yield made, may_work


def hostile_list(seed: int, index: int, only: Collection[str] = ()) -> tuple[list[str], bool]:
    """Return the list with this number, and whether it may take long; verbs take turns."""
    rng = random.Random(f"list {seed} {index}")
    known = [x for x in verbs() if x in only or not only]
    verb = known[index % len(known)]
    made = [verb]
    actions = [x for x in _verbs()[verb]._actions if x.dest != "help"]
    for action in actions:
        if not action.option_strings:
            made += _positional(action, rng)
    options = [x for x in actions if x.option_strings and x.dest not in IN_PLACE]
    required = [x for x in options if x.required and rng.random() < 0.95]
    chosen = rng.sample(options, min(len(options), rng.choice((0, 1, 1, 2, 2, 3, 4))))
    for action in (*required, *chosen):
        made.append(rng.choice(action.option_strings))
        if action.nargs != 0 and rng.random() < 0.98:
            made.append(_value(action, rng))
    if rng.random() < 0.04:
        made.insert(rng.randrange(len(made) + 1), rng.choice((*TEXTS, "--nothing", "-x", "--", "--json", "--help", "--version")))
    if rng.random() < 0.02:
        rng.shuffle(made)
    return made, verb not in QUICK


def _positional(action: argparse.Action, rng: random.Random) -> list[str]:
    count = {"?": rng.randrange(2), "*": rng.choice((0, 1, 1, 1, 2, 3))}.get(str(action.nargs), 1)
    pool: Sequence[str] = ENGINES if action.dest == "engine" else PATHS if action.dest in ("certificates", "model") else LINKAGES
    return [rng.choice((*pool, "model.xml", "bad.toml") if action.dest == "model" else pool) for _ in range(count)]


def _value(action: argparse.Action, rng: random.Random) -> str:
    if rng.random() < 0.08:
        return rng.choice((*NUMBERS, *TEXTS, *PATHS))
    if action.choices:
        return str(rng.choice([*action.choices]))
    kind: Any = action.type
    if action.dest in ("engine", "engines"):
        return rng.choice(ENGINES)
    if kind in (float, int) or action.dest in ("at", "steps", "step", "until", "budget", "jobs", "samples", "seed"):
        return ",".join(rng.choice(NUMBERS) for _ in range(rng.choice((1, 1, 1, 3))))
    if getattr(kind, "__name__", "") == "Path" or action.dest in ("out", "plot", "animate", "svg", "against", "baseline"):
        return rng.choice(PATHS)
    if action.dest == "linkage":
        return rng.choice(LINKAGES)
    return rng.choice(TEXTS)


def places(folder: Any, four_bar: bytes) -> None:
    """Make the files that the lists name in a folder."""
    (folder / "good").mkdir(parents=True, exist_ok=True)
    (folder / "good" / "four_bar.toml").write_bytes(four_bar)
    (folder / "bad.toml").write_text("links = 3\n")
    (folder / "empty.toml").write_text("")
    (folder / "rows.txt").write_text("0 0\n1 90\n2 0\n")
    (folder / "model.xml").write_text("<mujoco><worldbody><body><geom size='1'/></body></worldbody></mujoco>")
