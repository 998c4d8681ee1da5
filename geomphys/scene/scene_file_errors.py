"""One-line error messages for scene files: key, value, what is expected."""

from __future__ import annotations

import reprlib
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic_core import PydanticCustomError

Location = Sequence[int | str]

_SHORT = reprlib.Repr()
_SHORT.maxlevel, _SHORT.maxstring, _SHORT.maxother, _SHORT.maxlist = 3, 80, 80, 8


def fault(text: str) -> PydanticCustomError:
    """Validation error with this text, for the model's validators to raise."""
    return PydanticCustomError("scene", "{text}", {"text": text})


def explain(error: ValidationError, table: dict[str, Any], models: Mapping[str, type[BaseModel]]) -> str:
    """The first validation error of a table, and the number of further ones.

    `models` are the file's models by key, that of the whole file under "".
    """
    faults = error.errors(include_url=False)
    first = faults[0]
    location = [part for part in first["loc"] if not _is_branch(part)]
    kind, value = first["type"], first["input"]
    if kind == "missing" and isinstance(location[-1], int):  # an array that is too short
        location, kind = location[:-1], "too_short"
    if kind == "extra_forbidden":
        text = f"= {shortened(value)}: unknown key{_did_you_mean(location, models)}"
    elif kind == "missing":
        text = "is missing"
    elif kind == "tuple_type" and location[-1] in models:
        text = f"= {shortened(value)}: expected tables [[{'.'.join(str(p) for p in location if isinstance(p, str))}]]"
    elif kind == "scene" and isinstance(value, dict | BaseModel):
        text = str(first["msg"])
    else:
        text = f"= {shortened(value)}: {_expected(kind, first.get('ctx', {}), str(first['msg']))}"
    key = _key_path(location, table)
    others = len({f["loc"][:2] for f in faults}) - 1
    return one_line(f"{key} {text}" if key else text) + (f" (and {others} more)" if others else "")


def shortened(value: object) -> str:
    """A value for an error message: one line, at most 80 characters."""
    if isinstance(value, tuple):
        value = list(value)
    text = one_line(_SHORT.repr(value))
    return text if len(text) <= 80 else text[:77] + "..."


def one_line(text: str) -> str:
    """Text without line breaks and control characters."""
    return "".join(c if c.isprintable() else " " for c in text)


def _expected(kind: str, context: Mapping[str, Any], otherwise: str) -> str:
    """The message of pydantic in terms of a scene file."""
    messages = {
        "float_type": "expected a number",
        "finite_number": "expected a finite number",
        "string_type": "expected text in quotes",
        "bool_type": "expected true or false",
        "tuple_type": "expected an array [...]",
        "dict_type": "expected a table {...}",
        "model_type": "expected a table {...}",
        "model_attributes_type": "expected a table {...}",
    }
    if kind in messages:
        return messages[kind]
    if kind == "greater_than_equal":
        return f"expected at least {context['ge']:g}"
    if kind == "less_than_equal":
        return f"expected at most {context['le']:g}"
    if kind == "literal_error":
        return f"expected {context['expected']}"
    if kind == "too_short":
        return (
            f"expected at least {context['min_length']} values" if "min_length" in context else "expected more values"
        )
    if kind == "too_long":
        return f"expected at most {context['max_length']} values"
    return otherwise[:1].lower() + otherwise[1:]


def _is_branch(part: object) -> bool:
    """Whether a part of a location is no key of the file: a branch of a union, or pydantic's ``[key]``."""
    return isinstance(part, str) and (part in ("Coupling", "[key]") or part.startswith("literal["))


def _key_path(location: Location, table: dict[str, Any]) -> str:
    """`object[0] ('table').box[2]`: position in the file, with the names of named tables."""
    text = ""
    node: Any = table
    for part in location:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            text += f".{part}" if text else part
        try:
            node = node[part]
        except (KeyError, IndexError, TypeError):
            node = None
        if isinstance(part, int) and isinstance(node, dict) and isinstance(node.get("name"), str):
            text += f" ({shortened(node['name'])})"
    return text


def _did_you_mean(location: Location, models: Mapping[str, type[BaseModel]]) -> str:
    holders = [part for part in location[:-1] if isinstance(part, str)]
    model = models.get(holders[-1] if holders else "")
    if model is None:
        return ""
    keys = [field.alias or name for name, field in model.model_fields.items()]
    close = get_close_matches(str(location[-1]), keys, n=1)
    return f", did you mean {close[0]!r}?" if close else f", expected one of {', '.join(keys)}"
