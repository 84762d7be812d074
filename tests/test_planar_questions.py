"""Only files whose subject is planar ask for the kind of a joint, or count on three numbers per link.

A spatial linkage or a third kind of joint needs new code there and nowhere else. Other files ask a joint, driver or force for what
they need: the coordinates that it holds or leaves free, their units, its names in linkage files.
"""

import ast
import re
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "gauss_bench"
JOINTS = {"Revolute", "Prismatic", "KnifeEdge"}
DRIVERS = {"AngleDriver", "SlideDriver", "LengthDriver"}
FORCES = {"Torque", "PointForce", "SpringDamper", "AxisSpringDamper", "RotationalSpringDamper", "JointDamping"}
KINDS = JOINTS | DRIVERS | FORCES | {"Angle", "Along", "Distance", "Weighted"}
WORDS = re.compile("pin|slide|revolute|prismatic|knife_edge|[RP]{3}")  # a dyad such as RPR has the letters of its joints
ATTRIBUTES = {"pins", "slides"}
MAY_ASK = {  # a file, or a room that ends with a stroke, and why
    "mechanism/model.py": "what the kinds are",
    "mechanism/coordinates.py": "what the value and the gradient of each kind of coordinate are",
    "mechanism/equations.py": "what the two kinds of load exert",
    "linkage/": "the grammar, and the first assembly of what it describes",
    "engines/": "each engine has joint types of its own",
    "reference/": "derived again on purpose",
    "exchange/": "other programs have joint types of their own",
    "studio/": "drawings in the plane",
    "report/drawings/": "drawings in the plane",
    "report/site/view.py": "a drawing in the plane",
    "kinematics/loop_equations.py": "link units are planar",
    "kinematics/topology.py": "link units are planar",
    "kinematics/points.py": "points of the plane are complex numbers",
    "kinematics/point_equations.py": "points of the plane are complex numbers",
    "kinematics/dragging.py": "locks have the names of the studio's pins and slides",
    "papers/": "the papers are about the plane",
    "diagnosis/explanations.py": "only some kinds of force have a link or a direction that may be wrong",
    "docs/pages/template/": "a plug-in with joint types of its own",
}


def asks(node):
    """Tell whether a node asks for a kind by its class, name or attribute, or counts on three numbers per link."""
    match node:
        case ast.Call(func=ast.Name(id="isinstance"), args=[_, kinds]):
            return any(names_a_kind(x) for x in ast.walk(kinds))
        case ast.MatchClass(cls=kind):
            return names_a_kind(kind)
        case ast.Compare():
            return any(names_a_kind(x) for side in (node.left, *node.comparators) for x in (side, *getattr(side, "elts", ())))
        case ast.MatchValue(value=value):
            return names_a_kind(value)
        case ast.Subscript(slice=value):
            return names_a_kind(value) or is_angle_of_link(value)
        case ast.Dict(keys=keys):
            return any(names_a_kind(x) for x in keys)
        case ast.Attribute(attr=name):
            return name in ATTRIBUTES
        case ast.BinOp(op=ast.Mult() | ast.FloorDiv() | ast.Mod(), left=left, right=right):
            return is_three(left) or is_three(right)
        case ast.Slice():
            return is_three(node.step) or is_body(node)
        case ast.Call(func=ast.Name(id="range"), args=[_, _, step]):
            return is_three(step)
        case ast.Call(func=ast.Attribute(attr="reshape"), args=[_, *_, last]):
            return is_three(last)
        case ast.Tuple(elts=[first, *_, last]):  # a shape; a tuple of constants is none
            return is_three(last) and not isinstance(first, ast.Constant)
    return False


def names_a_kind(node):
    """Tell whether a node is the class of a kind, or its word in the grammar."""
    word = getattr(node, "value", None)
    return getattr(node, "id", getattr(node, "attr", None)) in KINDS or (
        isinstance(word, str) and WORDS.fullmatch(word) is not None
    )


def is_three(node):
    return number(node) == 3


def number(node):
    """Return a whole number that stands in the code, or None."""
    return node.value if isinstance(node, ast.Constant) and type(node.value) is int else None


def is_body(part):
    """Tell whether a slice has the three numbers of one link, such as 3:6."""
    lower, upper = number(part.lower), number(part.upper)
    return lower is not None and upper is not None and lower % 3 == 0 and upper == lower + 3


def is_angle_of_link(index):
    """Tell whether an index of the last axis takes the third of a link's numbers, as in x[..., 2] and x[..., 2:]."""
    match index:
        case ast.Tuple(elts=[*_, ast.Constant(value=x), last]) if x is Ellipsis:
            return number(last.lower if isinstance(last, ast.Slice) else last) == 2
    return False


def questions(source):
    """Yield the lines with such a question, each with its number."""
    lines = source.splitlines()
    for node in ast.walk(ast.parse(source)):
        if asks(node):
            yield f"{node.lineno}: {lines[node.lineno - 1].strip()}"


ASKING = [
    "isinstance(x, Prismatic)", "isinstance(x, (Law, Revolute))", "type(x) is Revolute", 'kind == "slide"', '"pin" == kind',
    'kind in ("weld", "pin")', '{Revolute: 1}["x"]', '{"pin": 1}', 'table["revolute"]', "q[3 * i]", "n // 3", "i % 3", "q[2::3]",
    "q[:, 2::3]", "match j:\n    case Revolute():\n        pass", 'match j:\n    case "prismatic":\n        pass',
    "mechanism.pins", "x.slides[0]", "isinstance(x, AngleDriver)", "isinstance(x, Torque | Law)", 'dyad.kind != "RPR"',
    "match x:\n    case Along(a, b):\n        pass", "x.reshape(-1, 3)", "x.reshape((k, 3))", "np.zeros((len(x), 3))",
    "shape = (k, links, 3)", "q[0:3]", "q[3:6]", "range(0, n, 3)", "x[..., 2]", "x[..., 2:]",
]  # fmt: skip
SILENT = [
    "isinstance(x, Law)", "3.0 * x", "q[::2]", "30 * i", 'kind == "weld"', "x[3]", "3 + i", "joint.held", 'unit == "m"',
    "x[..., :2]", "np.zeros((3, k))", "x.reshape(3, -1)", "(1, 3)", "q[2:6]", "q[:3]", "range(3)", "range(1, 3)", 'word == "RRRR"',
]  # fmt: skip


@pytest.mark.parametrize("line", [*ASKING, *SILENT])
def test_a_question_is_found_and_nothing_else(line):
    assert bool([*questions(line)]) == (line in ASKING)


def found_in_package():
    """Return file -> its questions, for every file that asks."""
    sources = {path.relative_to(PACKAGE).as_posix(): path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.py")}
    found = {name: [*questions(source)] for name, source in sources.items()}
    return {name: asked for name, asked in found.items() if asked}


def test_no_file_asks_but_those_that_may():
    assert {name: asked for name, asked in found_in_package().items() if not name.startswith(tuple(MAY_ASK))} == {}


def test_every_exception_is_needed():
    asking = found_in_package()
    assert [place for place in MAY_ASK if not any(name.startswith(place) for name in asking)] == []
