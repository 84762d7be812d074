"""Only files whose subject is planar ask for the kind of a joint, or count on three numbers per link.

A spatial linkage or a third kind of joint needs new code there and nowhere else.
"""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "gauss_bench"
KINDS = {"Revolute", "Prismatic", "KnifeEdge"}
WORDS = {"pin", "slide", "revolute", "prismatic", "knife_edge"}
MAY_ASK = {  # a file, or a room that ends with a stroke, and why
    "mechanism/model.py": "what the kinds are",
    "linkage/": "the grammar, and the first assembly of what it describes",
    "engines/": "each engine has joint types of its own",
    "reference/": "derived again on purpose",
    "exchange/": "other programs have joint types of their own",
    "studio/": "drawings in the plane",
    "report/drawings/": "drawings in the plane",
    "kinematics/loop_equations.py": "link units are planar",
    "kinematics/topology.py": "link units are planar",
    "papers/": "the papers are about the plane",
}


def asks(node: ast.AST) -> bool:
    """Tell whether a node asks for a kind by its class or its name, or multiplies, divides or strides by three."""
    match node:
        case ast.Call(func=ast.Name(id="isinstance"), args=[_, kinds]):
            return any(names_a_kind(x) for x in ast.walk(kinds))
        case ast.MatchClass(cls=kind):
            return names_a_kind(kind)
        case ast.Compare():
            return any(names_a_kind(x) for side in (node.left, *node.comparators) for x in (side, *getattr(side, "elts", ())))
        case ast.MatchValue(value=value) | ast.Subscript(slice=value):
            return names_a_kind(value)
        case ast.Dict(keys=keys):
            return any(names_a_kind(x) for x in keys)
        case ast.BinOp(op=ast.Mult() | ast.FloorDiv() | ast.Mod(), left=left, right=right):
            return is_three(left) or is_three(right)
        case ast.Slice(step=step):
            return is_three(step)
    return False


def names_a_kind(node: ast.AST | None) -> bool:
    """Tell whether a node is the class of a kind, or its word in the grammar."""
    return getattr(node, "id", None) in KINDS or getattr(node, "value", None) in WORDS


def is_three(node: ast.AST | None) -> bool:
    return isinstance(node, ast.Constant) and type(node.value) is int and node.value == 3


def questions(source: str) -> Iterator[str]:
    """Yield the lines with such a question, each with its number."""
    lines = source.splitlines()
    for node in ast.walk(ast.parse(source)):
        if asks(node):
            yield f"{node.lineno}: {lines[node.lineno - 1].strip()}"  # type: ignore[attr-defined]


ASKING = [
    "isinstance(x, Prismatic)", "isinstance(x, (Law, Revolute))", "type(x) is Revolute", 'kind == "slide"', '"pin" == kind',
    'kind in ("weld", "pin")', '{Revolute: 1}["x"]', '{"pin": 1}', 'table["revolute"]', "q[3 * i]", "n // 3", "i % 3", "q[2::3]",
    "q[:, 2::3]", "match j:\n    case Revolute():\n        pass", 'match j:\n    case "prismatic":\n        pass',
]  # fmt: skip
SILENT = ["isinstance(x, Law)", "3.0 * x", "q[::2]", "30 * i", 'kind == "weld"', "x[3]", "3 + i"]


@pytest.mark.parametrize("line", [*ASKING, *SILENT])
def test_a_question_is_found_and_nothing_else(line):
    assert bool([*questions(line)]) == (line in ASKING)


def test_no_file_asks_but_those_that_may():
    found = {}
    for path in PACKAGE.rglob("*.py"):
        name = path.relative_to(PACKAGE).as_posix()
        if not name.startswith(tuple(MAY_ASK)) and (asked := [*questions(path.read_text(encoding="utf-8"))]):
            found[name] = asked
    assert found == {}
