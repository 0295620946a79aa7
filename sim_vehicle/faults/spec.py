"""Fault specifications: kind, vehicles and times, from the command line, a scenario file or code."""

from dataclasses import dataclass
from typing import Annotated, Any, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from sim_vehicle.faults import FAULTS
from sim_vehicle.faults.base import Fault
from sim_vehicle.problems import nearest

SystemId = Annotated[int, Field(ge=1, le=255)]
COMMON_KEYS = {  # keys that every fault accepts
    "at": "start [s]",
    "for": "duration [s]",
    "sysid": "system ids: 3, or 1+4, or 2-6; all by default",
}
MIN_SIMILARITY = 0.7  # lowest similarity of a suggestion; a lower limit would suggest `at` for `rate`
COMMON_RANGES = {"at": "seconds >= 0", "for": "seconds > 0", "sysid": "system ids from 1 to 255"}
# Longer suffixes come first, because `_bytes_s` also ends in `_s`.
UNITS = {"_bytes_s": "B/s", "_bit_s": "bit/s", "_ppm": "ppm", "_bytes": "B", "_s": "s", "_m": "m", "_v": "V"}


class FaultError(ValueError):
    """An invalid fault; the text has the fault, the value found, and the allowed values."""


class FaultSpec(BaseModel):
    """One fault of a scenario.

    params: parameters of the fault.
    vehicles: system ids; None for all vehicles.
    at_s: start [s] after the start of the simulation, or after the injection.
    for_s: duration [s]; None for a fault without an end.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    fault: str
    params: dict[str, Any] = {}
    vehicles: Annotated[list[SystemId], Field(min_length=1)] | None = None
    at_s: Annotated[float, Field(ge=0)] = 0.0
    for_s: Annotated[float, Field(gt=0)] | None = None

    @model_validator(mode="after")
    def _check_fault(self) -> Self:
        self.parameters()
        return self

    def parameters(self) -> Fault:
        """Return the fault with its checked parameters, including defaults."""
        _check_name(self.fault)
        try:
            return FAULTS[self.fault].model_validate(self.params)
        except ValidationError as error:
            raise FaultError(_first_finding(self.fault, error)) from error

    def __str__(self) -> str:
        """Return the text that `parse_fault` reads."""
        pairs = {key: _value_text(value) for key, value in self.params.items()}
        if self.at_s:
            pairs["at"] = f"{self.at_s:g}"
        if self.for_s is not None:
            pairs["for"] = f"{self.for_s:g}"
        if self.vehicles is not None:
            pairs["sysid"] = "+".join(map(str, self.vehicles))
        listed = ",".join(f"{key}={value}" for key, value in pairs.items())
        return f"{self.fault}:{listed}" if listed else self.fault


def parse_fault(text: str) -> FaultSpec:
    """Return the fault of the text `NAME[:key=value,...]`; raise FaultError if the text is invalid."""
    name, _, rest = text.strip().partition(":")
    _check_name(name)
    given: dict[str, str] = {}
    for pair in filter(None, (part.strip() for part in rest.split(","))):
        key, equals, value = (part.strip() for part in pair.partition("="))
        if not equals or not value:
            raise FaultError(
                f"fault {name}: {pair!r}: expected key=value; allowed: {_allowed(name)} [fault-syntax]"
            )
        if key in given:
            raise FaultError(f"fault {name}: {key} is given twice; keep one [fault-syntax]")
        given[key] = value
    common = {key: given.pop(key, None) for key in COMMON_KEYS}
    try:
        return FaultSpec.model_validate(
            {
                "fault": name,
                "params": given,
                "vehicles": None if common["sysid"] is None else _sysids(name, common["sysid"]),
                "at_s": common["at"] or 0.0,
                "for_s": common["for"],
            }
        )
    except ValidationError as error:
        raise FaultError(_first_finding(name, error)) from error


@dataclass(frozen=True, slots=True)
class ParameterHelp:
    """One parameter of a fault; `unit` is empty for a value without a unit."""

    name: str
    unit: str
    default: str
    allowed: str
    description: str


def help_text() -> str:
    """Return the text of `--fault help`."""
    lines = ["--fault NAME[:key=value,...], once for each fault; keys of every fault:"]
    lines += [f"    {key:<14} {meaning}" for key, meaning in COMMON_KEYS.items()]
    for fault in FAULTS.values():
        lines.append(f"{fault.name}: {fault.summary}")
        for p in parameter_help(fault):
            unit = f" [{p.unit}]" if p.unit else ""
            lines.append(f"    {p.name:<14} {p.description}{unit}; {p.allowed}, default {p.default}")
    return "\n".join(lines)


def _check_name(name: str) -> None:
    if name not in FAULTS:
        raise FaultError(
            f"fault {name or repr(name)}: unknown fault{_suggestion(name, list(FAULTS))}; "
            f"known: {', '.join(sorted(FAULTS))} [fault-name]"
        )


def _suggestion(word: str, words: list[str]) -> str:
    close = nearest(word, words, MIN_SIMILARITY)
    return f" (did you mean {close}?)" if close else ""


def _first_finding(name: str, error: ValidationError) -> str:
    """Return the text of an unknown key, or else of the first finding."""
    findings = error.errors(include_url=False)
    finding = next((f for f in findings if f["type"] == "extra_forbidden"), findings[0])
    text = finding["msg"].removeprefix("Value error, ")
    if text.startswith("fault "):
        return text
    if not finding["loc"]:
        return f"fault {name}: {text} [fault-value]"
    names = {"at_s": "at", "for_s": "for", "vehicles": "sysid"}
    key = names.get(str(finding["loc"][0]), str(finding["loc"][0]))
    if finding["type"] == "extra_forbidden":
        near = _suggestion(key, [*FAULTS[name].model_fields, *COMMON_KEYS])
        return f"fault {name}: unknown key {key!r}{near}; allowed: {_allowed(name)} [fault-key]"
    expected = COMMON_RANGES.get(key) or next(
        (p.allowed for p in parameter_help(FAULTS[name]) if p.name == key), ""
    )
    value = _value_text(finding["input"])
    return f"fault {name}: {key}={value}: expected {expected}; allowed: {_allowed(name)} [fault-value]"


def _allowed(name: str) -> str:
    params = [f"{p.name} ({p.allowed}, default {p.default})" for p in parameter_help(FAULTS[name])]
    return ", ".join([*params, *COMMON_KEYS])


def _sysids(name: str, text: str) -> list[int]:
    sysids: list[int] = []
    for part in text.split("+"):
        first, dash, last = part.partition("-")
        try:
            low, high = int(first), int(last if dash else first)
        except ValueError as error:
            raise FaultError(
                f"fault {name}: sysid={text}: expected {COMMON_KEYS['sysid']} [fault-value]"
            ) from error
        if not 1 <= low <= high <= 255:
            raise FaultError(
                f"fault {name}: sysid={text}: expected system ids from 1 to 255, low to high [fault-value]"
            )
        sysids += range(low, high + 1)
    return sysids


def parameter_help(fault: type[Fault]) -> list[ParameterHelp]:
    """Return the help of a fault's parameters."""
    return [
        ParameterHelp(
            name=name,
            unit=next((unit for suffix, unit in UNITS.items() if name.endswith(suffix)), ""),
            default="none" if schema["default"] is None else _value_text(schema["default"]),
            allowed=_allowed_values(schema.get("anyOf", [schema])[0]),
            description=schema["description"],
        )
        for name, schema in fault.model_json_schema()["properties"].items()
    ]


def _allowed_values(schema: dict[str, Any]) -> str:
    if "enum" in schema:
        return "|".join(schema["enum"])
    signs = {"minimum": ">=", "exclusiveMinimum": ">", "maximum": "<=", "exclusiveMaximum": "<"}
    bounds = {sign: schema[name] for name, sign in signs.items() if name in schema}
    if ">=" in bounds and "<=" in bounds:
        return f"{bounds['>=']:g} to {bounds['<=']:g}"
    return " and ".join(f"{sign} {bound:g}" for sign, bound in bounds.items()) or "a number"


def _value_text(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
