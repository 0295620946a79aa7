"""The JSON schema of scenario files, including short forms, for editors."""

from typing import Any

from pydantic import BaseModel

from sim_vehicle.faults import FAULTS
from sim_vehicle.problems import section_of
from sim_vehicle.scenarios.base import OneOf
from sim_vehicle.scenarios.file import SHORT_FORMS, Home, Shorthand
from sim_vehicle.scenarios.model import Scenario
from sim_vehicle.scenarios.plan import FenceShape, Leg
from sim_vehicle.scenarios.steps import CheckSpec, ScriptStep

Schema = dict[str, Any]
DIALECT = "https://json-schema.org/draft/2020-12/schema"
REPLACEABLE_KEYS = ("sysid", "lat_deg", "lon_deg")  # keys of a vehicle that `home` and `count` can replace


def file_schema() -> Schema:
    """Return the schema of scenario files."""
    schema = Scenario.model_json_schema(ref_template="#/$defs/{model}")
    sections: Schema = schema["$defs"]
    short = Shorthand.model_json_schema()["properties"]
    vehicle = sections["VehicleSpec"]
    vehicle["properties"] |= {name: short[name] for name in SHORT_FORMS}
    vehicle["properties"]["kind"] = vehicle["properties"]["type"]
    vehicle["required"] = [name for name in vehicle.get("required", []) if name not in REPLACEABLE_KEYS]
    for model in (Leg, FenceShape, ScriptStep, CheckSpec):
        sections[model.__name__] = _one_of(model, sections[model.__name__])
    sections["FaultSpec"] = {"anyOf": [{"type": "string", "description": _faults()}, sections["FaultSpec"]]}
    schema["properties"] |= {"home": Home.model_json_schema(), "count": short["count"]}
    schema["required"] = []
    schema["anyOf"] = [{"required": ["count"]}, {"required": ["vehicles"]}]
    return {"$schema": DIALECT, **schema}


def _one_of(model: type[OneOf], found: Schema) -> Schema:
    bare = [name for name in model.choices() if _needs_nothing(model, name)]
    properties = {
        name: value if name in bare else _without_null(value) for name, value in found["properties"].items()
    }
    entry = {**found, "properties": properties, "oneOf": [{"required": [name]} for name in model.choices()]}
    return {"anyOf": [{"enum": bare}, entry]} if bare else entry


def _needs_nothing(model: type[BaseModel], name: str) -> bool:
    section = section_of(model.model_fields[name].annotation)
    return section is not None and not any(field.is_required() for field in section.model_fields.values())


def _without_null(value: Schema) -> Schema:
    types = [entry for entry in value.get("anyOf", []) if entry != {"type": "null"}]
    rest = {key: inner for key, inner in value.items() if key not in ("anyOf", "default")}
    return {**rest, **types[0]} if len(types) == 1 else value


def _faults() -> str:
    return f"NAME:key=value,... with at, for, sysid; names: {', '.join(FAULTS)}"
