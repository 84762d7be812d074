"""Files that ask for a joint's kind or count on three numbers a link, where no spatial linkage or third kind of joint fits.

What is planar or apart by its subject may ask: the grammar and first assembly, engines, references, exchange, studio, drawings,
link units, papers. Others should not, and the numbers below may only fall.
"""

import ast
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

PACKAGE = Path(__file__).parents[1] / "gauss_bench"
KINDS = {"Revolute", "Prismatic", "KnifeEdge"}
MAY_ASK = (
    "mechanism/model.py",
    "mechanism/spaces.py",
    "mechanism/frames.py",
    "linkage/",
    "engines/",
    "reference/",
    "exchange/",
    "studio/",
    "report/drawings/",
    "kinematics/loop_equations.py",
    "kinematics/topology.py",
    "papers/",
)
STILL: dict[str, int] = {}


def questions(source: str) -> Iterator[ast.AST]:
    """Nodes that ask: isinstance and match by a kind of joint; products, quotients and strides by three."""
    for node in ast.walk(ast.parse(source)):
        match node:
            case ast.Call(func=ast.Name(id="isinstance"), args=[_, kinds]):
                asks = any(isinstance(x, ast.Name) and x.id in KINDS for x in ast.walk(kinds))
            case ast.MatchClass(cls=ast.Name(id=name)):
                asks = name in KINDS
            case ast.BinOp(op=ast.Mult() | ast.FloorDiv() | ast.Mod(), left=left, right=right):
                asks = any(isinstance(x, ast.Constant) and type(x.value) is int and x.value == 3 for x in (left, right))
            case ast.Slice(step=ast.Constant(value=3)):
                asks = True
            case _:
                asks = False
        if asks:
            yield node


def test_questions_are_found() -> None:
    asking = "isinstance(x, Prismatic)\nq[3 * i]\nq[2::3]\nmatch j:\n    case Revolute():\n        pass\n"
    assert len([*questions(asking)]) == 4
    assert [*questions("isinstance(x, Law)\n3.0 * x\nq[::2]\n30 * i\n")] == []


def test_no_more_files_ask_for_kinds_or_dimensions() -> None:
    found = Counter[str]()
    for path in PACKAGE.rglob("*.py"):
        name = path.relative_to(PACKAGE).as_posix()
        if not name.startswith(MAY_ASK):
            found[name] += len([*questions(path.read_text(encoding="utf-8"))])
    assert {name: count for name, count in sorted(found.items()) if count} == STILL
