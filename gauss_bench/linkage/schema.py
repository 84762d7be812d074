"""The grammar of linkage files as types: which keys each table has, and what values they take.

There are two editions, planar-linkage/1 and /2: the second has every key of the first, and those that a table here calls `second`.
A file that uses one of them must say so, so that a reader of the first does not misread it. One key means something else: `c` of
`joint_damping` on a pin through several links acts between every two of them, no longer between neighbours in the list alone.
Names that refer to each other, and everything geometric, are checked in `references.py` and `closure.py`.
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
from gauss_bench.mechanism.model import (
    AxisSpringDamper,
    CoulombFriction,
    JointDamping,
    KnifeEdge,
    PointForce,
    RotationalSpringDamper,
    SpringDamper,
    Torque,
)

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
    """A table, whose class says of every key whether a motion follows from it (`physics`) or not (`other`): see `digest.py`.

    `second` names the keys, all of them said to be one or the other too, that the second edition of the grammar brought.

    Raises:
        TypeError: a class that says nothing of a key, or names one that it does not have.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    physics: ClassVar[frozenset[str]] = frozenset()
    other: ClassVar[frozenset[str]] = frozenset()
    second: ClassVar[frozenset[str]] = frozenset()

    def __init_subclass__(cls, physics: str = "", other: str = "", second: str = "", **more: Any) -> None:
        super().__init_subclass__(**more)

    @classmethod
    def __pydantic_init_subclass__(cls, physics: str = "", other: str = "", second: str = "", **more: Any) -> None:
        super().__pydantic_init_subclass__(**more)
        for kind, keys_of_it in (("physics", physics), ("other", other), ("second", second)):
            inherited: list[frozenset[str]] = [getattr(base, kind, frozenset()) for base in cls.__bases__]
            setattr(cls, kind, frozenset(keys_of_it.split()).union(*inherited))
        keys = {field.alias or name for name, field in cls.model_fields.items()}
        wrong = (cls.physics & cls.other) | (keys ^ (cls.physics | cls.other))
        if wrong:
            raise TypeError(f"{cls.__name__}: each key is declared physics or other, once: {', '.join(sorted(wrong))}")


def one_of(key: str, kinds: Mapping[str, Any]) -> Any:
    """Return the type of a table whose `key` says which of these kinds it is."""
    tagged: Any = reduce(or_, [Annotated[table, Tag(name)] for name, table in kinds.items()])
    return Annotated[tagged, Discriminator(lambda x: str(x.get(key)) if isinstance(x, dict) else None)]


class PointTable(Table, physics="r deg xy from"):
    r: NotNegative | None = None
    deg: Number | None = None
    xy: Pair | None = None
    from_: Annotated[Text | None, Field(alias="from")] = None


PointValue = Annotated[
    Annotated[Pair, Tag("<list>")] | Annotated[PointTable, Tag("<table>")],
    Discriminator(lambda value: "<table>" if isinstance(value, dict) else "<list>"),
]
Points = dict[Name, PointValue]


class GroundTable(Table, physics="points"):
    points: Points = {}


class PointMassTable(Table, physics="point mass"):
    point: Text
    mass: Positive


class LinkTable(Table, physics="points bars kg_per_m mass com inertia point_masses", second="point_masses"):
    points: Annotated[Points, Field(min_length=1)]
    bars: list[Couple] = []
    kg_per_m: Positive | None = None
    mass: Positive | None = None
    com: Pair | None = None
    inertia: Positive | None = None
    point_masses: list[PointMassTable] = []


class AngledTable(Table, physics="angle_deg angle"):
    angle_deg: Number | None = None
    angle: Number | None = None


class WeldTable(AngledTable, physics="link to origin points"):
    link: Text
    to: Text
    origin: Pair | None = None
    points: Annotated[list[Couple], Field(min_length=1, max_length=2)] | None = None


class CylinderPartTable(Table, physics="length mass kg_per_m com inertia"):
    length: Positive
    mass: Positive | None = None
    kg_per_m: Positive | None = None
    com: Number | None = None
    inertia: Positive | None = None


class CylinderTable(Table, physics="between barrel rod"):
    between: Couple
    barrel: CylinderPartTable
    rod: CylinderPartTable


class RevoluteTable(Table, physics="type at"):
    type: Literal["revolute"]
    at: Annotated[list[Text], Field(min_length=2)]


class PrismaticTable(AngledTable, physics="type guide block block_angle_deg block_angle offset"):
    type: Literal["prismatic"]
    guide: Text
    block: Text
    block_angle_deg: Number | None = None
    block_angle: Number | None = None
    offset: Number = 0.0


class KnifeEdgeTable(AngledTable, physics="type point"):
    read: ClassVar = KnifeEdge.read
    type: Literal["knife_edge"]
    point: Text


class TableOverTime(Table, physics="law rows"):
    law: Literal["table"]
    rows: Annotated[list[Pair], Field(min_length=2)]


class RampOverTime(Table, physics="law start time"):
    law: Literal["ramp"]
    start: Number = 0.0
    time: Positive


class StepOverTime(Table, physics="law start"):
    law: Literal["step"]
    start: Number


class SineOverTime(Table, physics="law frequency phase_deg phase"):
    law: Literal["sine"]
    frequency: Positive
    phase_deg: Number | None = None
    phase: Number | None = None


class AgainstTable(Table, physics="share speed"):
    share: Number
    speed: Positive


OverTime = one_of("law", {"table": TableOverTime, "ramp": RampOverTime, "step": StepOverTime, "sine": SineOverTime})


class VaryingTable(Table, physics="over_time against", second="over_time against"):
    over_time: OverTime | None = None  # type: ignore[valid-type]
    against: AgainstTable | None = None


class TorqueTable(VaryingTable, physics="type link reaction value"):
    read: ClassVar = Torque.read
    type: Literal["torque"]
    link: Text
    reaction: Text = "ground"
    value: Number


class ForceTable(VaryingTable, physics="type point value frame"):
    read: ClassVar = PointForce.read
    type: Literal["force"]
    point: Text
    value: Pair
    frame: Text = "ground"


class LinearTable(Table, physics="k c rest"):
    k: Number = 0.0
    c: Number = 0.0
    rest: Number = 0.0


class SpringDamperTable(LinearTable, physics="type between"):
    read: ClassVar = SpringDamper.read
    type: Literal["spring_damper"]
    between: Couple


class AxisSpringDamperTable(AngledTable, LinearTable, physics="type point origin"):
    read: ClassVar = AxisSpringDamper.read
    type: Literal["axis_spring_damper"]
    point: Text
    origin: Text | None = None


class RotationalSpringDamperTable(Table, physics="type links k c rest_deg rest"):
    read: ClassVar = RotationalSpringDamper.read
    type: Literal["rotational_spring_damper"]
    links: Couple
    k: Number = 0.0
    c: Number = 0.0
    rest_deg: Number | None = None
    rest: Number | None = None


class JointDampingTable(Table, physics="type joint c"):
    read: ClassVar = JointDamping.read
    type: Literal["joint_damping"]
    joint: Text
    c: NotNegative


class CoulombFrictionTable(Table, physics="type joint mu radius speed"):
    read: ClassVar = CoulombFriction.read
    type: Literal["coulomb_friction"]
    joint: Text
    mu: NotNegative
    radius: Positive | None = None
    speed: Positive


class DrivenTable(Table, physics="link joint between start_deg start"):
    link: Text | None = None
    joint: Text | None = None
    between: Couple | None = None
    start_deg: Number | None = None
    start: Number | None = None


class ConstantLaw(DrivenTable, physics="law speed"):
    law: Literal["constant"]
    speed: Number


class RiseLaw(DrivenTable, physics="law travel_deg travel time"):
    law: Literal["sine", "cosine", "poly345"]
    travel_deg: Number | None = None
    travel: Number | None = None
    time: Positive


class TableLaw(DrivenTable, physics="law rows"):
    law: Literal["table"]
    rows: Annotated[list[Pair], Field(min_length=2)]


class StartTable(Table, physics="crank_deg crank speed angles_deg angles slides points speeds slide_speeds point_velocities"):
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


class ScenarioTable(Table, physics="forces driver drivers start", other="duration override hold", second="hold"):
    duration: NotNegative
    hold: list[Text] = []
    forces: list[Text] = []
    override: dict[str, Any] = {}
    driver: DriverTable | None = None  # type: ignore[valid-type]
    drivers: Annotated[list[DriverTable], Field(min_length=1)] = []  # type: ignore[valid-type]
    start: StartTable | None = None


class AssemblyTable(Table, physics="sketch angles_deg angles"):
    sketch: dict[Text, Pair] = {}
    angles_deg: dict[Text, Number] = {}
    angles: dict[Text, Number] = {}


class ObserveTable(Table, other="points links"):
    points: list[Text] = []
    links: list[Text] = []


class MeasureTable(Table, other="link joint between point angle_deg angle"):
    link: Text | None = None
    joint: Text | None = None
    between: Couple | None = None
    point: Text | None = None
    angle_deg: Number | None = None
    angle: Number | None = None


class ExpectTable(Table, other="dof redundant loops"):
    dof: Annotated[int, Field(strict=True, ge=0)] | None = None
    redundant: Annotated[int, Field(strict=True, ge=0)] | None = None
    loops: Annotated[int, Field(strict=True, ge=0)] | None = None


class LinkageTable(
    Table,
    physics="crank gravity ground links welds cylinders joints constraints forces assembly scenarios",
    other="format name title expect observe measure",
    second="welds cylinders",
):
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

    A key of the second edition is a fault in a file of the first edition.
    """
    try:
        read = LinkageTable.model_validate(document)
    except ValidationError as error:
        faults, sound = [], copy.deepcopy(document)
        for e in error.errors(include_url=False):
            place = _place(e["loc"], document)
            faults.append(Fault(_path(place), _text(dict(e))))
            _put_none(sound, place)
        return faults, sound
    if read.format == SECOND:
        return [], document
    return [Fault(path, f"a key of {SECOND}, and the file says format = {FORMAT!r}") for path in _of_the_second(read)], document


def _of_the_second(item: Any, path: str = "") -> Iterator[str]:
    """List the places of keys of the second edition, at every depth."""
    if isinstance(item, Table):
        for name in item.model_fields_set:
            key = type(item).model_fields[name].alias or name
            where = f"{path}.{key}" if path else key
            if key in item.second:
                yield where
            else:
                yield from _of_the_second(getattr(item, name), where)
    elif isinstance(item, dict):
        for key, value in item.items():
            yield from _of_the_second(value, f"{path}.{key}")
    elif isinstance(item, list):
        for i, value in enumerate(item):
            yield from _of_the_second(value, f"{path}[{i}]")


def _place(loc: tuple[str | int, ...], document: Any) -> list[Any]:
    """Return the keys that lead to a fault, without the names of table kinds that pydantic adds to its location."""
    place: list[Any] = []
    parts: list[Any] = [*loc]
    for part in (x for x in parts if x not in ("<list>", "<table>", "[key]")):
        if isinstance(document, (dict, list)):
            there = part in document if isinstance(document, dict) else True
            if there or part is loc[-1]:
                place.append(part)
                document = document[part] if there else None
    return place


def _put_none(document: Any, place: list[Any]) -> None:
    *way, last = place
    for part in way:
        document = document[part]
    if document is not None:
        document[last] = None


def _path(place: list[Any]) -> str:
    return "".join(f"[{x}]" if isinstance(x, int) else f".{x}" for x in place).removeprefix(".")


def _text(error: dict[str, Any]) -> str:
    kind, context = error["type"], error.get("ctx", {})
    if error["loc"] == ("format",) and kind == "literal_error":
        return f"unsupported format {error['input']!r}; this version reads {FORMAT!r} and {SECOND!r}"
    if kind == "union_tag_invalid":
        return f"type {context['tag']!r} is not one of {context['expected_tags']}"
    if kind in ("too_short", "too_long"):
        exact = context.get("min_length") == context.get("max_length") or error["loc"][-1] in ("value", "com", "gravity", "xy")
        count = context.get("min_length", context.get("max_length"))
        return f"must have {'' if exact else 'at least ' if kind == 'too_short' else 'at most '}{count} entries"
    message: str = error["msg"]
    return str(GRAMMAR["words"].get(kind, message[0].lower() + message[1:]))


def physics_digest(document: dict[str, Any], scenario: str) -> str:
    """Return SHA-256 of everything in a document that affects the motion of a scenario; its override is merged already."""
    physics = _physics(LinkageTable.model_validate(document))
    chosen = physics.pop("scenarios")[scenario]
    acting = {name: physics["forces"][name] for name in chosen.get("forces", [])}
    physics |= {"forces": acting, "scenario": chosen}
    if document["format"] == SECOND:  # the first edition damps a shared pin between the neighbours in its list
        _mark_shared(physics, acting)
    return hashlib.sha256(json.dumps(physics, sort_keys=True).encode()).hexdigest()


def _mark_shared(physics: dict[str, Any], acting: dict[str, Any]) -> None:
    """Mark the physics of a document in which a damped pin joins more than two links: the editions damp such pins differently."""
    damped = [physics.get("joints", {}).get(f["joint"], {}) for f in acting.values() if f["type"] == "joint_damping"]
    if any(len(joint.get("at", ())) > 2 for joint in damped):
        physics["damping"] = "between every two links of a pin"


def _physics(item: Any) -> Any:
    """Return the given keys of a table that are physics, at every depth; equal numbers become equal decimal texts."""
    if isinstance(item, Table):
        given = {type(item).model_fields[name].alias or name: getattr(item, name) for name in item.model_fields_set}
        return {key: _physics(value) for key, value in given.items() if key in item.physics}
    if isinstance(item, dict):
        return {key: _physics(value) for key, value in item.items()}
    if isinstance(item, list):
        return [_physics(value) for value in item]
    if isinstance(item, float):
        return str(Decimal(repr(item)).normalize() + 0)
    return item
