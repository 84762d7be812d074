"""Make JSON Schemas (draft 2020-12) of linkage files, of suite files, and of the output of each command with --json.

Schemas follow from the classes that check files and from the return types of commands. Keys are described by the "Attributes:" of
docstrings, and columns by `tables.toml`.
"""

import inspect
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from enum import StrEnum
from pathlib import Path
from pkgutil import resolve_name
from types import NoneType, UnionType
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints, is_typeddict

import numpy as np
from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema

from gauss_bench.api.options import VERBS
from gauss_bench.api.telling import HIDDEN, UNLESS_EMPTY, Answer, Result
from gauss_bench.linkage.schema import LinkageTable
from gauss_bench.runs.offers import ChoiceError
from gauss_bench.suites.schema import Suite
from gauss_bench.tables import Table

Schema = dict[str, Any]
DRAFT = {"$schema": "https://json-schema.org/draft/2020-12/schema"}
FILES: dict[str, type[BaseModel]] = {"linkage": LinkageTable, "suite": Suite}
PRINTED = tuple(name for name, verb in VERBS.items() if verb.get("json", True))
NUMBER = {"type": ["number", "null"]}  # JSON has no number that is not finite: null stands for it
SIMPLE: dict[Any, Schema] = {
    str: {"type": "string"},
    Path: {"type": "string"},
    bool: {"type": "boolean"},
    int: {"type": "integer"},
    float: NUMBER,
    NoneType: {"type": "null"},
    Any: {},
}
COLUMNS = {"text": {"type": ["string", "null"]}, "number": NUMBER, "flag": {"type": ["boolean", "null"]}}  # a missing value is null


def list_formats() -> dict[str, str]:
    """Return name of a schema -> words on the file or the output that the schema describes."""
    files = {name: f"a {name} file, which is TOML" for name in FILES}
    return files | {name: f"what `gauss-bench {name} --json` prints" for name in PRINTED}


def find_schema(name: str) -> Schema:
    """Return the schema of a file format (`name` is a key of FILES), or of the output of the command `name` with --json.

    Raises:
        ChoiceError: there is no schema with this name.
    """
    if name in FILES:
        return describe_file(FILES[name], f"A {name} file of gauss-bench")
    if name not in PRINTED:
        raise ChoiceError(f"--schema: no schema {name!r}; there are {', '.join(list_formats())}")
    answer = get_type_hints(resolve_name(VERBS[name]["call"]), include_extras=True)["return"]
    writer = Writer()
    printed = join_schemas([writer.describe(x) for x in find_data(answer) if x is not NoneType])  # None prints nothing
    return DRAFT | {"title": f"What gauss-bench {name} --json prints"} | printed | {"$defs": writer.named}


def find_data(answer: Any) -> Iterator[Any]:
    """Yield the types of data that a command's function may return; `answer` is its return type, as `Answer[...]` or a union."""
    if get_origin(answer) in (Union, UnionType):
        for option in get_args(answer):
            yield from find_data(option)
    else:
        yield get_args(answer)[0] if get_origin(answer) is Answer else answer


class FileSchema(GenerateJsonSchema):
    """Pydantic's generator of schemas, without titles of keys, which would only repeat their names."""

    def field_title_should_be_set(self, schema: Any) -> bool:
        """Return False: no key gets a title."""
        return False


def describe_file(kind: type[BaseModel], title: str) -> Schema:
    """Return the schema of a file that the class `kind` checks."""
    schema = kind.model_json_schema(schema_generator=FileSchema)
    # kind.__mro__[1], the direct base of `kind`, is the common base of the classes of all tables in the file
    classes = {x.__name__: x for x in list_subclasses(kind.__mro__[1])}
    schemas = {kind.__name__: schema} | schema["$defs"]  # name of a class -> schema; "$defs" has the nested tables
    for name, table in schemas.items():
        table.pop("title", None)
        meanings = list_meanings(classes[name])
        for field, info in classes[name].model_fields.items():
            if field in meanings:
                table["properties"][info.alias or field]["description"] = meanings[field]
        if "description" in table:
            table["description"] = first_sentence(classes[name])
    return DRAFT | {"title": title} | schema


def list_subclasses(kind: type[BaseModel]) -> Iterator[type[BaseModel]]:
    """Yield all classes that derive from a class, directly or through others."""
    for x in kind.__subclasses__():
        yield x
        yield from list_subclasses(x)


class Writer:
    """Writes schemas of types; a class with a fixed set of keys becomes a definition of its own.

    Attributes:
        named: name of a class -> schema of the class.
        classes: name of a class -> the class.
    """

    def __init__(self) -> None:
        self.named: dict[str, Schema] = {}
        self.classes: dict[str, type] = {}

    def describe(self, kind: Any) -> Schema:
        """Return the schema of a type.

        Raises:
            TypeError: values of this type cannot be written as JSON.
        """
        origin, arguments = get_origin(kind), get_args(kind)
        if origin is Annotated:
            return describe_rows(*arguments)
        if kind in SIMPLE:
            return dict(SIMPLE[kind])
        if origin in (Union, UnionType):
            return join_schemas([self.describe(x) for x in arguments])
        if origin is np.ndarray:
            return {"type": "array", "items": NUMBER}
        if origin is dict or origin is Mapping:
            # the arguments are the types of keys and of values
            names = {} if arguments[0] is str else {"propertyNames": self.describe(arguments[0])}
            return {"type": "object", "additionalProperties": self.describe(arguments[1])} | names
        if origin in (list, tuple):
            return {"type": "array", "items": join_schemas([self.describe(x) for x in arguments if x is not ...])}
        if inspect.isclass(kind) and issubclass(kind, StrEnum):
            return {"enum": [str(x) for x in kind]}
        if is_typeddict(kind) or is_dataclass(kind):
            return self.refer(kind)
        raise TypeError(f"no schema of {kind!r}")

    def refer(self, kind: Any) -> Schema:
        """Return a reference to the definition of a class with a fixed set of keys; add the definition to `named`."""
        name = kind.__name__
        if self.classes.setdefault(name, kind) is not kind:
            raise TypeError(f"two classes are called {name}")
        if name not in self.named:
            self.named[name] = {}  # a class may refer to itself
            self.named[name] = self.describe_keys(kind)
        return {"$ref": f"#/$defs/{name}"}

    def describe_keys(self, kind: Any) -> Schema:
        """Return the schema of a dataclass or of a dictionary with a fixed set of keys."""
        types = get_type_hints(kind)
        if is_typeddict(kind):
            shown, required = list(kind.__annotations__), list(kind.__required_keys__)
        else:
            shown = [x.name for x in fields(kind) if x.metadata != HIDDEN]
            required = [x.name for x in fields(kind) if x.name in shown and x.metadata != UNLESS_EMPTY]
        meanings = list_meanings(kind)
        # kind.computed: names of properties that are printed like fields
        for name in kind.computed if issubclass(kind, Result) else ():
            types[name] = get_type_hints(getattr(kind, name).fget)["return"]
            meanings[name] = first_sentence(getattr(kind, name))
            shown, required = [*shown, name], [*required, name]
        keys = {name: self.describe(types[name]) | {"description": meanings[name]} for name in shown}
        return object_schema(first_sentence(kind), keys, sorted(required, key=shown.index))


def object_schema(meaning: str, keys: Mapping[str, Schema], required: Iterable[str] = ()) -> Schema:
    """Return the schema of an object that may have no other keys than `keys`; `meaning` describes the object."""
    allowed = {"properties": dict(keys), "required": list(required), "additionalProperties": False}
    return {"type": "object", "description": meaning} | allowed


def describe_rows(kind: Any, columns: Table | Mapping[str, Table]) -> Schema:
    """Return the schema of one row, a list of rows, or a dictionary from a table's name to its rows; every column may be absent.

    Args:
        kind: type of the data: list or list[...] means several rows, and any other type a single row.
        columns: the table that describes the columns; or name of a table -> table, if the data is a dictionary of tables.
    """
    if not isinstance(columns, Table):
        return object_schema("rows by table", {name: describe_rows(list, table) for name, table in columns.items()})
    units = {c.name: f"; unit: {c.unit}" if c.unit else "" for c in columns.columns}
    keys = {c.name: COLUMNS[c.kind] | {"description": c.meaning + units[c.name]} for c in columns.columns}
    row = object_schema(columns.meaning, keys)
    several = {"type": "array", "description": f"rows, each {columns.meaning}", "items": row}
    return several if list in (kind, get_origin(kind)) else row


def join_schemas(options: list[Schema]) -> Schema:
    """Return the schema of a value that fits any of these schemas; plain types become one list of types."""
    if len(options) == 1:
        return options[0]
    if not all(x.keys() == {"type"} for x in options):
        return {"anyOf": options}
    types: dict[str, None] = {}  # each type once, in order
    for option in options:
        names = option["type"]
        types |= dict.fromkeys(names if isinstance(names, list) else [names])
    return {"type": list(types)}


def list_meanings(kind: type) -> dict[str, str]:
    """Return name of a field -> its meaning, read under "Attributes:" in the docstrings of a class and its bases.

    An entry of the docstring may explain several fields, as in "a, b: first and second number; c: third number".
    """
    meanings: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        known = "|".join(map(re.escape, inspect.get_annotations(base)))
        listed = inspect.cleandoc(base.__doc__ or "").partition("Attributes:\n")[2].partition("\n\n")[0]
        for entry in filter(None, re.split(r"^    (?=\S)", listed, flags=re.MULTILINE)):
            heads = rf"(?:^|; )((?:{known})(?:, (?:{known}))*): "  # "a, b: " at the beginning or after a semicolon
            _, *parts = re.split(heads, " ".join(entry.split()))  # head, meaning, head, meaning, ...
            for head, meaning in zip(parts[::2], parts[1::2], strict=True):
                meanings |= dict.fromkeys(head.split(", "), meaning.rstrip("."))
    return meanings


def first_sentence(kind: object) -> str:
    """Return the first line of the docstring of a class or property, without the full stop."""
    return (inspect.getdoc(kind) or "").partition("\n")[0].rstrip(".")
