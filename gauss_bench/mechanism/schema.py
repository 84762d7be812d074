"""The grammar planar-linkage/1 as types: which keys each table has, and what values they take.

Names that refer to each other, and everything geometric, are checked in `references.py` and `closure.py`.
"""

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Discriminator, Field, StringConstraints, Tag, ValidationError

from gauss_bench.mechanism.errors import Fault

FORMAT = "planar-linkage/1"

Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0)]
NotNegative = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0)]
Pair = Annotated[list[Number], Field(min_length=2, max_length=2)]
Text = Annotated[str, Field(strict=True)]
Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_]+$")]


class Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


def kind_of(key: str) -> Any:
    """Discriminator on a table's `key`; tags are in angle brackets so that they can be told from keys in a path."""
    return Discriminator(lambda value: f"<{value.get(key)}>" if isinstance(value, dict) else "<not a table>")


class PointTable(Table):
    r: NotNegative | None = None
    deg: Number | None = None
    xy: Pair | None = None
    from_: Annotated[Text | None, Field(alias="from")] = None


PointValue = Annotated[
    Annotated[Pair, Tag("<list>")] | Annotated[PointTable, Tag("<table>")],
    Discriminator(lambda value: "<table>" if isinstance(value, dict) else "<list>"),
]
Points = dict[Name, PointValue]


class GroundTable(Table):
    points: Points = {}


class LinkTable(Table):
    points: Annotated[Points, Field(min_length=1)]
    bars: list[Annotated[list[Text], Field(min_length=2, max_length=2)]] = []
    kg_per_m: Positive | None = None
    mass: Positive | None = None
    com: Pair | None = None
    inertia: Positive | None = None


class RevoluteTable(Table):
    type: Literal["revolute"]
    at: Annotated[list[Text], Field(min_length=2)]


class PrismaticTable(Table):
    type: Literal["prismatic"]
    guide: Text
    block: Text
    angle_deg: Number | None = None
    angle: Number | None = None
    block_angle_deg: Number | None = None
    block_angle: Number | None = None
    offset: Number = 0.0


class KnifeEdgeTable(Table):
    type: Literal["knife_edge"]
    point: Text
    angle_deg: Number | None = None
    angle: Number | None = None


class TorqueTable(Table):
    type: Literal["torque"]
    link: Text
    reaction: Text = "ground"
    value: Number


class ForceTable(Table):
    type: Literal["force"]
    point: Text
    value: Pair
    frame: Text = "ground"


class SpringDamperTable(Table):
    type: Literal["spring_damper"]
    between: Annotated[list[Text], Field(min_length=2, max_length=2)]
    k: Number = 0.0
    c: Number = 0.0
    rest: Number = 0.0


class AxisSpringDamperTable(Table):
    type: Literal["axis_spring_damper"]
    point: Text
    origin: Text | None = None
    angle_deg: Number | None = None
    angle: Number | None = None
    k: Number = 0.0
    c: Number = 0.0
    rest: Number = 0.0


class RotationalSpringDamperTable(Table):
    type: Literal["rotational_spring_damper"]
    links: Annotated[list[Text], Field(min_length=2, max_length=2)]
    k: Number = 0.0
    c: Number = 0.0
    rest_deg: Number | None = None
    rest: Number | None = None


class JointDampingTable(Table):
    type: Literal["joint_damping"]
    joint: Text
    c: NotNegative


class CoulombFrictionTable(Table):
    type: Literal["coulomb_friction"]
    joint: Text
    mu: NotNegative
    radius: Positive | None = None
    speed: Positive


class DrivenTable(Table):
    link: Text | None = None
    joint: Text | None = None
    between: Annotated[list[Text], Field(min_length=2, max_length=2)] | None = None
    start_deg: Number | None = None
    start: Number | None = None


class ConstantLaw(DrivenTable):
    law: Literal["constant"]
    speed: Number


class RiseLaw(DrivenTable):
    law: Literal["sine", "cosine", "poly345"]
    travel_deg: Number | None = None
    travel: Number | None = None
    time: Positive


class TableLaw(DrivenTable):
    law: Literal["table"]
    rows: Annotated[list[Pair], Field(min_length=2)]


class StartTable(Table):
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
FORCES = {
    "torque": TorqueTable,
    "force": ForceTable,
    "spring_damper": SpringDamperTable,
    "axis_spring_damper": AxisSpringDamperTable,
    "rotational_spring_damper": RotationalSpringDamperTable,
    "joint_damping": JointDampingTable,
    "coulomb_friction": CoulombFrictionTable,
}
JointTable = Annotated[Annotated[RevoluteTable, Tag("<revolute>")] | Annotated[PrismaticTable, Tag("<prismatic>")], kind_of("type")]
ForceEntry = Annotated[
    Annotated[TorqueTable, Tag("<torque>")]
    | Annotated[ForceTable, Tag("<force>")]
    | Annotated[SpringDamperTable, Tag("<spring_damper>")]
    | Annotated[AxisSpringDamperTable, Tag("<axis_spring_damper>")]
    | Annotated[RotationalSpringDamperTable, Tag("<rotational_spring_damper>")]
    | Annotated[JointDampingTable, Tag("<joint_damping>")]
    | Annotated[CoulombFrictionTable, Tag("<coulomb_friction>")],
    kind_of("type"),
]
ConstraintTable = Annotated[Annotated[KnifeEdgeTable, Tag("<knife_edge>")], kind_of("type")]
DriverTable = Annotated[
    Annotated[ConstantLaw, Tag("<constant>")]
    | Annotated[RiseLaw, Tag("<sine>")]
    | Annotated[RiseLaw, Tag("<cosine>")]
    | Annotated[RiseLaw, Tag("<poly345>")]
    | Annotated[TableLaw, Tag("<table law>")],
    Discriminator(lambda v: {"table": "<table law>"}.get(v.get("law"), f"<{v.get('law')}>") if isinstance(v, dict) else "<>"),
]


class ScenarioTable(Table):
    duration: NotNegative
    forces: list[Text] = []
    override: dict[str, Any] = {}
    driver: DriverTable | None = None
    drivers: Annotated[list[DriverTable], Field(min_length=1)] = []
    start: StartTable | None = None


class AssemblyTable(Table):
    sketch: dict[Text, Pair] = {}
    angles_deg: dict[Text, Number] = {}
    angles: dict[Text, Number] = {}


class ObserveTable(Table):
    points: list[Text] = []
    links: list[Text] = []


class MeasureTable(Table):
    link: Text | None = None
    joint: Text | None = None
    between: Annotated[list[Text], Field(min_length=2, max_length=2)] | None = None
    point: Text | None = None
    angle_deg: Number | None = None
    angle: Number | None = None


class ExpectTable(Table):
    dof: Annotated[int, Field(strict=True, ge=0)] | None = None
    redundant: Annotated[int, Field(strict=True, ge=0)] | None = None
    loops: Annotated[int, Field(strict=True, ge=0)] | None = None


class LinkageTable(Table):
    format: Literal["planar-linkage/1"]
    name: Name
    title: Text = ""
    crank: Text | None = None
    gravity: Pair = [0.0, -9.81]
    expect: ExpectTable = ExpectTable()
    ground: GroundTable = GroundTable()
    links: Annotated[dict[Name, LinkTable], Field(min_length=1)]
    joints: dict[Name, JointTable] = {}
    constraints: dict[Name, ConstraintTable] = {}
    forces: dict[Name, ForceEntry] = {}
    assembly: AssemblyTable = AssemblyTable()
    observe: ObserveTable = ObserveTable()
    measure: MeasureTable | None = None
    scenarios: Annotated[dict[Name, ScenarioTable], Field(min_length=1)]


TEXTS = {
    "extra_forbidden": "unknown key",
    "missing": "required",
    "greater_than": "must be positive",
    "greater_than_equal": "must not be negative",
    "finite_number": "must be a finite number",
    "float_type": "must be a number",
    "int_type": "must be a whole number",
    "string_type": "must be text",
    "list_type": "must be a list",
    "dict_type": "must be a table",
    "model_type": "must be a table",
    "model_attributes_type": "must be a table",
    "string_pattern_mismatch": "names have letters, digits and underscores only",
}


def schema_faults(document: dict[str, Any]) -> list[Fault]:
    """Every fault of keys and values, each with its dotted path."""
    try:
        LinkageTable.model_validate(document)
    except ValidationError as error:
        return [Fault(_path(e["loc"]), _text(dict(e))) for e in error.errors(include_url=False)]
    return []


def _path(loc: tuple[str | int, ...]) -> str:
    path = ""
    for part in loc:
        if isinstance(part, int):
            path += f"[{part}]"
        elif not part.startswith("<") and part != "[key]":
            path += f".{part}" if path else part
    return path


def _text(error: dict[str, Any]) -> str:
    kind, context = error["type"], error.get("ctx", {})
    if error["loc"] == ("format",) and kind == "literal_error":
        return f"unsupported format {error['input']!r}; this version reads {FORMAT!r}"
    if kind == "union_tag_invalid":
        tag, known = context["tag"].strip("<>"), context["expected_tags"].replace("<", "").replace(">", "").replace(" law", "")
        return "must be a table" if tag == "not a table" or not tag else f"type {tag!r} is not one of {known}"
    if kind in ("too_short", "too_long"):
        exact = context.get("min_length") == context.get("max_length") or error["loc"][-1] in ("value", "com", "gravity", "xy")
        count = context.get("min_length", context.get("max_length"))
        return f"must have {'' if exact else 'at least ' if kind == 'too_short' else 'at most '}{count} entries"
    message: str = error["msg"]
    return TEXTS.get(kind, message[0].lower() + message[1:])
