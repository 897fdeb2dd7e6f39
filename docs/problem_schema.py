"""JSON Schemas of a problem file, for editors and for others' tools: 2020-12, and draft-07, which editors of TOML read.

The package ships them: `pytest tests/test_schemas.py --update` writes what follows from `ProblemFile`.
They say what the tables are; that an agent, a graph and gains fit together is decided when the file is read.
"""

from collections.abc import Callable
from typing import Any

from key_meanings import described
from lockstep.model.problem.tables.schema import ProblemFile

DIALECT = "https://json-schema.org/draft/2020-12/schema"
DIALECT_07 = "http://json-schema.org/draft-07/schema#"


def problem_schema() -> dict[str, Any]:
    """Return the schema of a problem file (2020-12), from the tables of `schema`.

    The outputs are a table of formulas in TOML and a list of pairs in a design file; a weight is a number, a list of
    numbers or a matrix.
    """
    schema = ProblemFile.model_json_schema()
    tables = schema["$defs"]
    outputs = tables["AgentTable"]["properties"]["outputs"]
    pairs = {key: outputs.pop(key) for key in ("type", "items")}
    outputs["anyOf"] = [{"type": "object", "additionalProperties": {"type": "string"}}, pairs]
    numbers = {"type": "array", "minItems": 1, "items": {"type": "number"}}
    for weight in tables["WeightsTable"]["properties"].values():
        weight["anyOf"] = [{"type": "number"}, numbers, {"type": "array", "minItems": 1, "items": numbers}]
    for name, table in {"ProblemFile": schema, **tables}.items():
        for key, value in table["properties"].items():
            value["description"] = described(name, key, value.get("description", ""))
    return {"$schema": DIALECT, "title": "Problem file of Lockstep", **_changed(schema, _without_title)}


def draft_07(schema: Any) -> Any:
    """Return a schema in the words of draft-07: `definitions`, and `items` for the places of a tuple."""
    return _changed(schema, _in_draft_07)


def _changed(schema: Any, change: Callable[[dict[str, Any]], dict[str, Any]]) -> Any:
    """Return a schema with each of its tables changed, the inner ones first."""
    if isinstance(schema, list):
        return [_changed(one, change) for one in schema]
    if not isinstance(schema, dict):
        return schema
    return change({key: _changed(value, change) for key, value in schema.items()})


def _in_draft_07(table: dict[str, Any]) -> dict[str, Any]:
    words = {"$defs": "definitions", "prefixItems": "items"}
    found = {words.get(key, key): value for key, value in table.items()}
    if "$schema" in found:
        found["$schema"] = DIALECT_07
    if isinstance(found.get("$ref"), str):
        found["$ref"] = found["$ref"].replace("#/$defs/", "#/definitions/")
    return found


def _without_title(table: dict[str, Any]) -> dict[str, Any]:
    """Leave out the title that Pydantic makes up from the name of a key; a key of that name has a table of its own."""
    return {key: value for key, value in table.items() if key != "title" or not isinstance(value, str)}
