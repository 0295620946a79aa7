"""Fault specifications: kind, vehicles and times, from the command line, a scenario file or code."""

import difflib
from dataclasses import dataclass
from enum import Enum
from typing import Annotated, Any, Literal, Self, Union, get_args, get_origin

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic.fields import FieldInfo

from sim_vehicle.faults import FAULTS
from sim_vehicle.faults.base import FaultParams

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

    def parameters(self) -> FaultParams:
        """Return the checked parameters, including defaults."""
        return _parameters(self.fault, self.params)

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
        return FaultSpec(
            fault=name,
            params=given,
            vehicles=None if common["sysid"] is None else _sysids(name, common["sysid"]),
            at_s=_seconds(name, "at", common["at"] or "0"),
            for_s=None if common["for"] is None else _seconds(name, "for", common["for"]),
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
        for p in parameter_help(fault.params):
            unit = f" [{p.unit}]" if p.unit else ""
            lines.append(f"    {p.name:<14} {p.description}{unit}; {p.allowed}, default {p.default}")
    return "\n".join(lines)


def _parameters(name: str, params: dict[str, Any]) -> FaultParams:
    _check_name(name)
    model = FAULTS[name].params
    unknown = [key for key in params if key not in model.model_fields]
    if unknown:
        near = _suggestion(unknown[0], [*model.model_fields, *COMMON_KEYS])
        raise FaultError(
            f"fault {name}: unknown key {unknown[0]!r}{near}; allowed: {_allowed(name)} [fault-key]"
        )
    try:
        return model.model_validate(params)
    except ValidationError as error:
        raise FaultError(_first_finding(name, error)) from error


def _check_name(name: str) -> None:
    if name not in FAULTS:
        raise FaultError(
            f"fault {name or repr(name)}: unknown fault{_suggestion(name, list(FAULTS))}; "
            f"known: {', '.join(sorted(FAULTS))} [fault-name]"
        )


def _suggestion(word: str, words: list[str]) -> str:
    close = difflib.get_close_matches(word, words, n=1, cutoff=MIN_SIMILARITY)
    return f" (did you mean {close[0]}?)" if close else ""


def _first_finding(name: str, error: ValidationError) -> str:
    finding = error.errors(include_url=False)[0]
    text = finding["msg"].removeprefix("Value error, ")
    if text.startswith("fault "):
        return text
    if not finding["loc"]:
        return f"fault {name}: {text} [fault-value]"
    names = {"at_s": "at", "for_s": "for", "vehicles": "sysid"}
    key = names.get(str(finding["loc"][0]), str(finding["loc"][0]))
    expected = COMMON_RANGES.get(key) or next(
        (p.allowed for p in parameter_help(FAULTS[name].params) if p.name == key), ""
    )
    value = _value_text(finding["input"])
    return f"fault {name}: {key}={value}: expected {expected}; allowed: {_allowed(name)} [fault-value]"


def _allowed(name: str) -> str:
    params = [f"{p.name} ({p.allowed}, default {p.default})" for p in parameter_help(FAULTS[name].params)]
    return ", ".join([*params, *COMMON_KEYS])


def _seconds(name: str, key: str, text: str) -> float:
    try:
        return float(text)
    except ValueError as error:
        raise FaultError(
            f"fault {name}: {key}={text}: expected a time in seconds, for example {key}=30 [fault-value]"
        ) from error


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


def parameter_help(model: type[FaultParams]) -> list[ParameterHelp]:
    """Return the help of a fault's parameters."""
    return [
        ParameterHelp(
            name=name,
            unit=next((unit for suffix, unit in UNITS.items() if name.endswith(suffix)), ""),
            default="none" if field.default is None else _value_text(field.default),
            allowed=_allowed_values(field),
            description=field.description or "",
        )
        for name, field in model.model_fields.items()
    ]


def _allowed_values(field: FieldInfo) -> str:
    kind: Any = field.annotation
    metadata = list(field.metadata)
    if get_origin(kind) is Union or type(kind).__name__ == "UnionType":
        kind = next(part for part in get_args(kind) if part is not type(None))
    if get_origin(kind) is Annotated:
        kind, *inner = get_args(kind)
        metadata += [m for part in inner for m in getattr(part, "metadata", ())]
    if get_origin(kind) is Literal:
        return "|".join(get_args(kind))
    if isinstance(kind, type) and issubclass(kind, Enum):
        return "|".join(str(member.value) for member in kind)
    bounds = {
        sign: getattr(m, name)
        for m in metadata
        for name, sign in (("ge", ">="), ("gt", ">"), ("le", "<="), ("lt", "<"))
        if hasattr(m, name)
    }
    if ">=" in bounds and "<=" in bounds:
        return f"{bounds['>=']:g} to {bounds['<=']:g}"
    return " and ".join(f"{sign} {bound:g}" for sign, bound in bounds.items()) or "a number"


def _value_text(value: object) -> str:
    if isinstance(value, Enum):
        return str(value.value)
    return f"{value:g}" if isinstance(value, float) else str(value)
