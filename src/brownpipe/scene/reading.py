"""Values of files, options and arguments, checked by pydantic: every refusal is one line.

It names the file, its line, the key, the allowed values and the value found.
"""

import difflib
import re
from collections.abc import Callable, Mapping
from typing import Annotated, Any, NoReturn, Self

import numpy as np
from pydantic import AfterValidator, BaseModel, BeforeValidator, Field, TypeAdapter, ValidationError, model_validator
from pydantic_core import PydanticCustomError

from brownpipe.errors import RequestError
from brownpipe.scene.yaml_file import Document

LONGEST_SHOWN = 80  # characters of a value in a message
MOST_DISKS = 10_000_000
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")
SYNONYMS = {"runs": "seeds", "n": "particles", "kt": "temperature", "dt": "time_step"}
WORDS = {  # of pydantic, and the same in messages here
    "Input should be": "must be",
    "Input is not a valid path for <class 'pathlib.Path'>": "must be the path of a file",
    "a valid number": "a number",
    "a valid integer": "an integer",
    "a valid boolean": "true or false",
    "a valid string": "a text",
    "a valid tuple": "a list",
}
TINY = 1e-99  # a bound below it is there for the range of floating-point numbers alone
BOUNDS = {"gt": ">", "ge": ">=", "lt": "<", "le": "<="}

NO_MINUS_ZERO = AfterValidator(lambda value: value + 0.0)
Number = Annotated[float, Field(strict=True, allow_inf_nan=False), NO_MINUS_ZERO]
Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0)]
NotNegative = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0), NO_MINUS_ZERO]
Pair = tuple[Number, Number]
AtLeastOne = Annotated[int, Field(strict=True, ge=1)]
Count = Annotated[int, Field(strict=True, ge=0, le=MOST_DISKS)]
Name = Annotated[str, Field(pattern=f"^{NAME.pattern}$")]


class Record(BaseModel):
    """The keys of a mapping. A key whose value is null is taken as not given."""

    model_config = {"frozen": True, "extra": "forbid"}

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, value: object) -> object:
        if isinstance(value, cls):
            return value
        keys = tuple(cls.model_fields)
        if not isinstance(value, Mapping):
            found = "a text" if isinstance(value, str) else shown(value)  # of a wrong file, maybe a secret
            refuse(f"must be a mapping with the keys {', '.join(keys)}, not {found}")
        for key in value:
            if key not in keys:
                hint = "a number has a decimal point; " if str(key).isdigit() else did_you_mean(str(key), keys)
                refuse(f"unknown key; {hint}allowed: {', '.join(keys)}", key)
        return {key: part for key, part in value.items() if part is not None}

    def replace(self, **keys: object) -> Self:
        """Return a record with other values of some keys. Raises RequestError for what a file may not have either."""
        return validated(type(self), {key: getattr(self, key) for key in self.model_fields_set} | plain(keys))

    def _resolve(self, **values: object) -> None:
        """Give fields the values that follow from others, and attributes that are no keys; none counts as given."""
        self.__dict__.update(values)


def key(meaning: str, default: Any = ..., **more: Any) -> Any:
    """Return the field of a record: what it means, and its default unless it must be given."""
    return Field(default, description=meaning, **more)


def converted(convert: Callable[[Any], Any], schema: Any) -> BeforeValidator:
    """Read what a function makes of a value; `schema` is the type of what may be given."""
    return BeforeValidator(convert, json_schema_input_type=schema)


def alone(name: str, schema: Any) -> BeforeValidator:
    """Let the value of one key stand for a mapping with this key alone; `schema` is the type of both."""
    return converted(lambda value: value if isinstance(value, Mapping | Record) else {name: value}, schema)


def distinct(kind: Any, least: int = 0) -> Any:
    """Return the type of a list of values that differ, at least so many."""
    return Annotated[tuple[kind, ...], Field(min_length=least), AfterValidator(_refuse_equal)]


def _refuse_equal(values: tuple[Any, ...]) -> tuple[Any, ...]:
    if any(value in values[:k] for k, value in enumerate(values)):
        refuse("must be values that differ")
    return values


def refuse(problem: str, *path: str | int) -> NoReturn:
    """Refuse, within a validator, the value at a path of keys and indices below that which is validated."""
    raise PydanticCustomError("refused", "{problem}", {"problem": problem, "path": path})


def validated(kind: Any, value: object, file: str = "", key: str = "", context: dict | None = None) -> Any:
    """Return a value as `kind`, a type that pydantic knows. Raises RequestError, naming the file and the key.

    The line is named, too, if the value is a `Document`.
    """
    try:
        return TypeAdapter(kind).validate_python(value, context=context)
    except ValidationError as error:
        path, problem = _place_and_problem(error)
    line = value.line_of(path) if isinstance(value, Document) else None
    file += f" with {', '.join(value.replaced)} replaced" if isinstance(value, Document) and value.replaced else ""
    place = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in (key, *path) if part != "")
    parts = (file, line and f"line {line}", place.removeprefix("."), problem)
    raise RequestError(": ".join(part for part in parts if part)) from None


def _place_and_problem(error: ValidationError) -> tuple[list[str | int], str]:
    """Return the path of the first refused value, and what is wrong with it."""
    first = error.errors(include_url=False)[0]
    context = first.get("ctx", {})
    path = [part for part in (*first["loc"], *context.get("path", ())) if not str(part).startswith("{")]  # a tag
    kind, problem, value = first["type"], first["msg"], first["input"]
    if kind == "refused":
        return path, problem
    if kind == "missing" and isinstance(path[-1], str):
        return path, "missing; must be given"
    if kind == "missing" or (kind == "too_long" and context["max_length"] == 2):
        return path[:-1] if kind == "missing" else path, f"must be a list of two, not {shown(value)}"
    if kind == "union_tag_invalid":
        options = re.findall("{([^}]+)}", context["expected_tags"])
        word = context["tag"].strip("{}")
        return [*path, "name"], f"must be {' or '.join(options)}, not {word}; {did_you_mean(word, options)}".strip("; ")
    if "{word}" in first["loc"]:
        problem = f"must be a number or {context['expected']}"
    if kind == "string_pattern_mismatch":
        problem = "must be a name: letters, digits, '.', '_', '-', the first a letter or digit, at most 64"
    for name in BOUNDS.keys() & context.keys():
        far_below = value <= 0 < context[name] < TINY
        problem = "must be > 0" if far_below else f"must be {BOUNDS[name]} {context[name]:.10g}"
    for theirs, ours in WORDS.items():
        problem = problem.replace(theirs, ours)
    hint = did_you_mean(str(value), re.findall("'([^']+)'", context["expected"])) if kind == "literal_error" else ""
    if kind in ("float_type", "int_type") and isinstance(value, str):
        hint = "without quotes, unit or comma"
    return path, f"{problem}, not {shown(value)}{'; ' if hint else ''}{hint.strip()}"


def plain(value: Any) -> Any:
    """Return a value as a YAML file would give it: lists and mappings of Python's numbers instead of NumPy's."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    return [plain(item) for item in value] if isinstance(value, list | tuple | range | set | frozenset) else value


def did_you_mean(word: str, options: list[str] | tuple[str, ...]) -> str:
    """Return a question about the most similar option, "" if none is similar."""
    near = [SYNONYMS.get(word.lower(), ""), *difflib.get_close_matches(word[:LONGEST_SHOWN].lower(), options, n=1)]
    return next((f"did you mean {name}? " for name in near if name in options), "")


def shown(value: object) -> str:
    """Return the value as in YAML, on one line and shortened."""
    if isinstance(value, Mapping):
        return "a mapping"
    if isinstance(value, list | tuple) and len(value) > 4:
        return f"a list of {len(value)}"
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    text = repr(list(value) if isinstance(value, tuple) else value)
    return text if len(text) <= LONGEST_SHOWN else text[: LONGEST_SHOWN - 3] + "..."
