"""The grammar of linkage files as types: the keys of each table, and the values that they take.

There are two editions of the grammar, planar-linkage/1 and /2. A file with a key of the second edition, which a `Table` lists as
`second`, must say format = "planar-linkage/2", so that a reader of the first edition does not misread it. One key has two meanings:
`c` of `joint_damping`, on a pin through several links, acts between neighbours in the list of links in the first edition, and
between every two of the links in the second.

`references.py` checks names and combinations of keys, `closure.py` the geometry.
"""

import copy
import hashlib
import json
import tomllib
from collections.abc import Iterator, Mapping
from decimal import Decimal
from functools import reduce
from operator import or_
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BaseModel, ConfigDict, Discriminator, Field, StringConstraints, Tag, ValidationError

from gauss_bench.linkage.errors import Fault
from gauss_bench.mechanism import model

FORMAT = "planar-linkage/1"
SECOND = "planar-linkage/2"
GRAMMAR = tomllib.loads(Path(__file__).with_name("grammar.toml").read_text(encoding="utf-8"))

Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0)]
NotNegative = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0)]
Pair = Annotated[list[Number], Field(min_length=2, max_length=2)]
Text = Annotated[str, Field(strict=True)]
Couple = Annotated[list[Text], Field(min_length=2, max_length=2)]
Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_]+$")]


class Table(BaseModel):
    """A table of the file; class arguments list keys: `other` and `second` as "key key", `units` as "key: unit; key: unit".

    Attributes:
        other: keys that do not affect a motion, such as a title; all other keys enter `physics_digest`.
        second: keys that only the second edition of the grammar has.
        units: key -> unit of its numbers, "1" if they have none; angles KEY_deg [deg] and KEY [rad] need no entry.

    Raises:
        TypeError: a class argument lists a key that the table does not have.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    other: ClassVar[frozenset[str]] = frozenset()
    second: ClassVar[frozenset[str]] = frozenset()
    units: ClassVar[dict[str, str]] = {}

    def __init_subclass__(cls, other: str = "", second: str = "", units: str = "", **more: Any) -> None:
        """Do not pass this module's class arguments on to pydantic; `__pydantic_init_subclass__` uses them."""
        super().__init_subclass__(**more)  # the keys of the table are not known yet

    @classmethod
    def __pydantic_init_subclass__(cls, other: str = "", second: str = "", units: str = "", **more: Any) -> None:
        """Set `other`, `second` and `units` to those of the parent class and those of the class arguments."""
        super().__pydantic_init_subclass__(**more)
        cls.other |= {*other.split()}
        cls.second |= {*second.split()}
        keys = {key_of(cls, name) for name in cls.model_fields}
        angles = {key.removesuffix("_deg") for key in keys if key.endswith("_deg")}
        units_of_angles = dict.fromkeys(angles, "rad") | {f"{key}_deg": "degrees" for key in angles}
        cls.units = units_of_angles | cls.units | dict(x.split(": ") for x in units.split("; ") if x)
        unknown = (cls.other | cls.second | cls.units.keys()) - keys
        if unknown:
            raise TypeError(f"{cls.__name__} has no key {', '.join(sorted(unknown))}")


def key_of(kind: type[Table], name: str) -> str:
    """Return the key in the file of the field `name`; they differ if the key is a Python keyword, such as `from`."""
    return kind.model_fields[name].alias or name


def one_of(key: str, kinds: Mapping[str, Any]) -> Any:
    """Return the union type of several kinds of table; the value of `key` in a table names its kind."""
    tagged: Any = reduce(or_, [Annotated[table, Tag(name)] for name, table in kinds.items()])
    return Annotated[tagged, Discriminator(lambda x: str(x.get(key)) if isinstance(x, dict) else None)]


class PointTable(Table, units="r: m; deg: degrees; xy: m"):
    r: NotNegative | None = None
    deg: Number | None = None
    xy: Pair | None = None
    from_: Annotated[Text | None, Field(alias="from")] = None


PointValue = Annotated[
    Annotated[Pair, Tag("<list>")] | Annotated[PointTable, Tag("<table>")],
    Discriminator(lambda value: "<table>" if isinstance(value, dict) else "<list>"),
]
Points = dict[Name, PointValue]


class GroundTable(Table, units="points: m"):
    points: Points = {}


class PointMassTable(Table, units="mass: kg"):
    point: Text
    mass: Positive


class LinkTable(Table, second="point_masses", units="points: m; kg_per_m: kg/m; mass: kg; com: m; inertia: kg m²"):
    points: Annotated[Points, Field(min_length=1)]
    bars: list[Couple] = []
    kg_per_m: Positive | None = None
    mass: Positive | None = None
    com: Pair | None = None
    inertia: Positive | None = None
    point_masses: list[PointMassTable] = []


class AngledTable(Table):
    angle_deg: Number | None = None
    angle: Number | None = None


class WeldTable(AngledTable, units="origin: m"):
    link: Text
    to: Text
    origin: Pair | None = None
    points: Annotated[list[Couple], Field(min_length=1, max_length=2)] | None = None


class CylinderPartTable(Table, units="length: m; mass: kg; kg_per_m: kg/m; com: m; inertia: kg m²"):
    length: Positive
    mass: Positive | None = None
    kg_per_m: Positive | None = None
    com: Number | None = None
    inertia: Positive | None = None


class CylinderTable(Table):
    between: Couple
    barrel: CylinderPartTable
    rod: CylinderPartTable


class RevoluteTable(Table):
    type: Literal["revolute"]
    at: Annotated[list[Text], Field(min_length=2)]


class PrismaticTable(AngledTable, units="offset: m"):
    type: Literal["prismatic"]
    guide: Text
    block: Text
    block_angle_deg: Number | None = None
    block_angle: Number | None = None
    offset: Number = 0.0


class KnifeEdgeTable(AngledTable):
    read: ClassVar = model.KnifeEdge.read
    type: Literal["knife_edge"]
    point: Text


class TableOverTime(Table, units="rows: s, 1"):
    law: Literal["table"]
    rows: Annotated[list[Pair], Field(min_length=2)]


class RampOverTime(Table, units="start: s; time: s"):
    law: Literal["ramp"]
    start: Number = 0.0
    time: Positive


class StepOverTime(Table, units="start: s"):
    law: Literal["step"]
    start: Number


class SineOverTime(Table, units="frequency: Hz"):
    law: Literal["sine"]
    frequency: Positive
    phase_deg: Number | None = None
    phase: Number | None = None


class AgainstTable(Table, units="share: 1; speed: rad/s or m/s"):
    share: Number
    speed: Positive


OverTime = one_of("law", {"table": TableOverTime, "ramp": RampOverTime, "step": StepOverTime, "sine": SineOverTime})


class VaryingTable(Table, second="over_time against"):
    over_time: OverTime | None = None  # type: ignore[valid-type]
    against: AgainstTable | None = None


class TorqueTable(VaryingTable, units="value: N m"):
    read: ClassVar = model.Torque.read
    type: Literal["torque"]
    link: Text
    reaction: Text = "ground"
    value: Number


class ForceTable(VaryingTable, units="value: N"):
    read: ClassVar = model.PointForce.read
    type: Literal["force"]
    point: Text
    value: Pair
    frame: Text = "ground"


class LinearTable(Table):
    k: Number = 0.0
    c: Number = 0.0
    rest: Number = 0.0


class SpringDamperTable(LinearTable, units="k: N/m; c: N s/m; rest: m"):
    read: ClassVar = model.SpringDamper.read
    type: Literal["spring_damper"]
    between: Couple


class AxisSpringDamperTable(AngledTable, LinearTable, units="k: N/m; c: N s/m; rest: m"):
    read: ClassVar = model.AxisSpringDamper.read
    type: Literal["axis_spring_damper"]
    point: Text
    origin: Text | None = None


class RotationalSpringDamperTable(LinearTable, units="k: N m/rad; c: N m s/rad"):
    read: ClassVar = model.RotationalSpringDamper.read
    type: Literal["rotational_spring_damper"]
    links: Couple
    rest_deg: Number | None = None


class JointDampingTable(Table, units="c: N m s/rad or N s/m"):
    read: ClassVar = model.JointDamping.read
    type: Literal["joint_damping"]
    joint: Text
    c: NotNegative


class CoulombFrictionTable(Table, units="mu: 1; radius: m; speed: rad/s or m/s"):
    read: ClassVar = model.CoulombFriction.read
    type: Literal["coulomb_friction"]
    joint: Text
    mu: NotNegative
    radius: Positive | None = None
    speed: Positive


class CoordinateTable(Table):
    link: Text | None = None
    joint: Text | None = None
    between: Couple | None = None


class DrivenTable(CoordinateTable, units="start: rad or m"):
    start_deg: Number | None = None
    start: Number | None = None


class ConstantLaw(DrivenTable, units="speed: rad/s or m/s"):
    law: Literal["constant"]
    speed: Number


class RiseLaw(DrivenTable, units="travel: rad or m; time: s"):
    law: Literal["sine", "cosine", "poly345"]
    travel_deg: Number | None = None
    travel: Number | None = None
    time: Positive


class TableLaw(DrivenTable, units="rows: s, degrees or m"):
    law: Literal["table"]
    rows: Annotated[list[Pair], Field(min_length=2)]


class StartTable(Table, units="speed: rad/s; slides: m; points: m; speeds: rad/s; slide_speeds: m/s; point_velocities: m/s"):
    crank_deg: Number | None = None
    crank: Number | None = None
    speed: Number = 0.0
    angles_deg: dict[Text, Number] = {}
    angles: dict[Text, Number] = {}
    slides: dict[Text, Number] = {}
    points: dict[Text, Pair] = {}
    speeds: dict[Text, Number] = {}
    slide_speeds: dict[Text, Number] = {}
    point_velocities: dict[Text, Pair] = {}


JOINTS = {"revolute": RevoluteTable, "prismatic": PrismaticTable}
FORCES: dict[str, Any] = {
    "torque": TorqueTable,
    "force": ForceTable,
    "spring_damper": SpringDamperTable,
    "axis_spring_damper": AxisSpringDamperTable,
    "rotational_spring_damper": RotationalSpringDamperTable,
    "joint_damping": JointDampingTable,
    "coulomb_friction": CoulombFrictionTable,
}
CONSTRAINTS: dict[str, Any] = {"knife_edge": KnifeEdgeTable}
LAWS = {"constant": ConstantLaw, **dict.fromkeys(("sine", "cosine", "poly345"), RiseLaw), "table": TableLaw}
JointTable, ForceEntry, ConstraintTable = (one_of("type", x) for x in (JOINTS, FORCES, CONSTRAINTS))
DriverTable = one_of("law", LAWS)


class ScenarioTable(Table, other="duration override hold", second="hold", units="duration: s"):
    duration: NotNegative
    hold: list[Text] = []
    forces: list[Text] = []
    override: dict[str, Any] = {}
    driver: DriverTable | None = None  # type: ignore[valid-type]
    drivers: Annotated[list[DriverTable], Field(min_length=1)] = []  # type: ignore[valid-type]
    start: StartTable | None = None


class AssemblyTable(Table, units="sketch: m"):
    sketch: dict[Text, Pair] = {}
    angles_deg: dict[Text, Number] = {}
    angles: dict[Text, Number] = {}


class ObserveTable(Table):
    points: list[Text] = []
    links: list[Text] = []


class MeasureTable(CoordinateTable):
    point: Text | None = None
    angle_deg: Number | None = None
    angle: Number | None = None


class ExpectTable(Table):
    dof: Annotated[int, Field(strict=True, ge=0)] | None = None
    redundant: Annotated[int, Field(strict=True, ge=0)] | None = None
    loops: Annotated[int, Field(strict=True, ge=0)] | None = None


class LinkageTable(Table, other="format name title expect observe measure", second="welds cylinders", units="gravity: m/s²"):
    format: Literal["planar-linkage/1", "planar-linkage/2"]
    name: Name
    title: Text = ""
    crank: Text | None = None
    gravity: Pair = [0.0, -9.81]
    expect: ExpectTable = ExpectTable()
    ground: GroundTable = GroundTable()
    links: Annotated[dict[Name, LinkTable], Field(min_length=1)]
    welds: dict[Name, WeldTable] = {}
    cylinders: dict[Name, CylinderTable] = {}
    joints: dict[Name, JointTable] = {}  # type: ignore[valid-type]
    constraints: dict[Name, ConstraintTable] = {}  # type: ignore[valid-type]
    forces: dict[Name, ForceEntry] = {}  # type: ignore[valid-type]
    assembly: AssemblyTable = AssemblyTable()
    observe: ObserveTable = ObserveTable()
    measure: MeasureTable | None = None
    scenarios: Annotated[dict[Name, ScenarioTable], Field(min_length=1)]


def check_grammar(document: dict[str, Any]) -> tuple[list[Fault], dict[str, Any]]:
    """Return every fault of keys and values, and the document with None in place of each refused value.

    A key that only the second edition has is a fault in a file of the first.
    """
    try:
        linkage = LinkageTable.model_validate(document)
    except ValidationError as error:
        faults, accepted = [], copy.deepcopy(document)
        for problem in error.errors(include_url=False):
            keys = _keys_to(problem["loc"], document)
            faults.append(Fault(_join_keys(keys), _describe_problem(dict(problem))))
            _put_none(accepted, keys)
        return faults, accepted
    if linkage.format == SECOND:
        return [], document
    message = f"a key of {SECOND}, and the file says format = {FORMAT!r}"
    return [Fault(path, message) for path in _keys_of_second(linkage)], document


def _keys_of_second(item: Any, path: str = "") -> Iterator[str]:
    """Yield the paths of all keys in a table, dict or list at `path` that only the second edition has."""
    if isinstance(item, Table):
        for name in item.model_fields_set:  # the fields that the file gives
            key = key_of(type(item), name)
            where = f"{path}.{key}" if path else key
            if key in item.second:
                yield where
            else:
                yield from _keys_of_second(getattr(item, name), where)
    elif isinstance(item, dict):
        for key, value in item.items():
            yield from _keys_of_second(value, f"{path}.{key}")
    elif isinstance(item, list):
        for i, value in enumerate(item):
            yield from _keys_of_second(value, f"{path}[{i}]")


def _keys_to(location: tuple[str | int, ...], document: Any) -> list[Any]:
    """Return the path of keys and indices to a fault: pydantic's location without the tags of unions and keys."""
    keys: list[Any] = []
    parts = [x for x in location if x not in ("<list>", "<table>", "[key]")]
    for part in parts:
        if (isinstance(document, dict) and part in document) or isinstance(document, list):
            keys.append(part)
            document = document[part]  # type: ignore[index]
        # any other part is a tag of `one_of`, which is no key of the document, or at the end a missing key
        elif isinstance(document, dict) and part is location[-1]:  # `is`: an equal tag further up is not the last part
            keys.append(part)  # a missing key
            document = None
    return keys


def _put_none(document: Any, keys: list[Any]) -> None:
    """Replace the value at the path `keys` in a document by None, unless its table is None already."""
    *parents, last = keys
    for key in parents:
        document = document[key]
    if document is not None:
        document[last] = None


def _join_keys(keys: list[Any]) -> str:
    """Return keys and indices as the text of a path, such as joints.A.at[1]."""
    return "".join(f"[{x}]" if isinstance(x, int) else f".{x}" for x in keys).removeprefix(".")


def _describe_problem(error: dict[str, Any]) -> str:
    """Return the text of the fault for one of the errors that pydantic lists."""
    kind, context = error["type"], error.get("ctx", {})
    if error["loc"] == ("format",) and kind == "literal_error":
        return f"unsupported format {error['input']!r}; this version reads {FORMAT!r} and {SECOND!r}"
    if kind == "union_tag_invalid":
        return f"type {context['tag']!r} is not one of {context['expected_tags']}"
    if kind in ("too_short", "too_long"):
        least, most = context.get("min_length"), context.get("max_length")
        count = f"at least {least}" if kind == "too_short" else f"at most {most}"
        if least == most or error["loc"][-1] in ("value", "com", "gravity", "xy"):  # pairs: only the bound that failed is given
            count = str(least if least is not None else most)
        return f"must have {count} entries"
    message: str = error["msg"]
    return str(GRAMMAR["words"].get(kind, message[0].lower() + message[1:]))


def physics_digest(document: dict[str, Any], scenario: str) -> str:
    """Return the SHA-256 of everything that affects the motion of a scenario; its `override` is already applied to `document`."""
    physics = _physics(LinkageTable.model_validate(document))
    chosen = physics.pop("scenarios")[scenario]
    acting = {name: physics["forces"][name] for name in chosen.get("forces", [])}
    physics |= {"forces": acting, "scenario": chosen}
    damped = [physics.get("joints", {}).get(f["joint"], {}) for f in acting.values() if f["type"] == "joint_damping"]
    if document["format"] == SECOND and any(len(joint.get("at", ())) > 2 for joint in damped):
        # a pin through several links: its damping means something else than in the first edition, so the digest must differ
        physics["damping"] = "between every two links of a pin"
    return hashlib.sha256(json.dumps(physics, sort_keys=True).encode()).hexdigest()


def _physics(item: Any) -> Any:
    """Return a table and the tables inside it as dicts, with the keys that the file has and that affect a motion.

    Numbers become decimal texts, which are the same for 1, 1.0 and 1e0: pydantic makes floats of whole numbers too.
    """
    if isinstance(item, Table):
        fields = {key_of(type(item), name): getattr(item, name) for name in item.model_fields_set}  # that the file gives
        return {key: _physics(value) for key, value in fields.items() if key not in item.other}  # other: without effect on a motion
    if isinstance(item, dict):
        return {key: _physics(value) for key, value in item.items()}
    if isinstance(item, list):
        return [_physics(value) for value in item]
    if isinstance(item, float):
        return str(Decimal(repr(item)).normalize() + 0)  # + 0 makes 0 of -0
    return item
