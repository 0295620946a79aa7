"""Problems of input in plain words: the errors of pydantic, and the nearest known name."""

import difflib
import inspect
import typing
from collections.abc import Iterable, Sequence
from typing import Any

from pydantic import BaseModel

MIN_SIMILARITY = 0.6  # lowest similarity of a suggested name
SECTION_TYPES = ("model_type", "model_attributes_type", "dict_type")
# pydantic's error types in plain words.
EXPECTED = {
    **dict.fromkeys(SECTION_TYPES, "must be a section with keys"),
    **dict.fromkeys(
        ("list_type", "tuple_type"), "must be a list: `[first, second]`, or a line `- entry` for each entry"
    ),
    **dict.fromkeys(("float_type", "float_parsing"), "must be a number"),
    **dict.fromkeys(("int_type", "int_parsing", "int_from_float"), "must be a whole number"),
    "finite_number": "must be a finite number",
    "bool_type": "must be true or false",
    "bool_parsing": "must be true or false",
    "string_type": "must be text",
    "string_pattern_mismatch": "must have a visible character",
    "literal_error": "must be {expected}",
    "greater_than_equal": "must be at least {ge:g}",
    "greater_than": "must be more than {gt:g}",
    "less_than_equal": "must be at most {le:g}",
    "less_than": "must be less than {lt:g}",
    "too_short": "must have at least {min_length} entries",
    "too_long": "must have at most {max_length} entries",
}


def nearest(word: object, known: Iterable[str], similarity: float = MIN_SIMILARITY) -> str | None:
    """Return the known name most similar to a word, without regard to upper and lower case, or None."""
    names = {name.casefold(): name for name in known}
    near = difflib.get_close_matches(str(word).casefold(), names, n=1, cutoff=similarity)
    return names[near[0]] if near else None


def remedy(word: object, known: Iterable[str], plural: str) -> str:
    """Return a question for the nearest known name, else a text with all names, which `plural` describes."""
    names = list(dict.fromkeys(known))
    near = nearest(word, names)
    return f"did you mean `{near}`?" if near else f"the {plural} are {', '.join(names)}"


def describe(detail: Any, loc: Sequence[str | int], model: type[BaseModel]) -> str:
    """Return one entry of `ValidationError.errors()` of a model in plain words; `loc`: path in the model."""
    if detail["type"] == "extra_forbidden":
        section = _section_at(model, loc[:-1])
        return f"unknown key; {remedy(loc[-1], section.model_fields if section else (), 'keys')}"
    if detail["type"] == "missing":
        return "is missing; add this key"
    if detail["type"] == "value_error":
        return str(detail["msg"].removeprefix("Value error, "))
    found = detail["input"]
    written = "nothing" if found is None or found == {} else repr(found)
    wanted = EXPECTED.get(detail["type"])
    if wanted is None:
        return f"{detail['msg'][0].lower()}{detail['msg'][1:]}, found {written:.60}"
    section = _section_at(model, loc) if detail["type"] in SECTION_TYPES else None
    if section is not None and not section.model_fields:
        return f"takes no value, found {written:.60}"
    keys = f" ({', '.join(section.model_fields)})" if section is not None else ""
    return f"{wanted.format(**detail.get('ctx', {}))}{keys}, found {written:.60}"


def _section_at(model: Any, loc: Sequence[str | int]) -> type[BaseModel] | None:
    annotation: Any = model
    for part in loc:
        section = section_of(annotation)
        if isinstance(part, str) and section is not None:
            field = section.model_fields.get(part)
            annotation = field.annotation if field is not None else None
    return section_of(annotation)


def section_of(annotation: Any) -> type[BaseModel] | None:
    """Return the model in an annotation, such as `Annotated[list[Model], ...] | None`, or None."""
    if inspect.isclass(annotation) and issubclass(annotation, BaseModel):
        return annotation
    for inner in typing.get_args(annotation):
        if (found := section_of(inner)) is not None:
            return found
    return None
