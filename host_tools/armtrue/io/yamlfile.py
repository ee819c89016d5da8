"""YAML files, read key by key: errors and unknown keys are reported with their place in the file."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import yaml

from armtrue.errors import InputError, did_you_mean, shorten
from armtrue.io.files import read_text

LARGEST_YAML_BYTES = 4 * 1024 * 1024

_MOST_NODES = 1_000_000
_REQUIRED: Any = object()


class _Loader(yaml.SafeLoader):
    """YAML's safe types as version 1.2 has them: `1e-3` is a number; `no`, `1:30` and `2020-07-14` are text."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        mapping: dict[Any, Any] = {}
        for key_node, value_node in node.value:
            if not isinstance(key_node, yaml.ScalarNode):
                raise _refused("a key that is not text", key_node)
            key = self.construct_scalar(key_node)
            if key in mapping:
                raise _refused(f"the key '{key}' a second time", key_node)
            mapping[key] = self.construct_object(value_node, deep=deep)  # type: ignore[no-untyped-call]
        return mapping

    def construct_scalar(self, node: Any) -> Any:
        value = super().construct_scalar(node)
        try:
            # "\ud83d\ude00" is one character as JSON writes it; half of such a pair is none.
            return (
                value.encode("utf-16", "surrogatepass").decode("utf-16") if isinstance(value, str) else value
            )
        except UnicodeDecodeError:
            raise _refused("half of a pair of surrogates", node) from None


def _refused(found: str, node: yaml.Node) -> yaml.constructor.ConstructorError:
    return yaml.constructor.ConstructorError(None, None, found, node.start_mark)


def _construct_float(loader: _Loader, node: yaml.ScalarNode) -> float:
    return float(node.value.replace(".inf", "inf").replace(".nan", "nan").replace(".NaN", "nan"))


def _construct_int(loader: _Loader, node: yaml.ScalarNode) -> int:
    if len(node.value) > 30:
        raise _refused("an integer beyond 30 digits", node)
    return int(node.value)


_FLOAT = r"[-+]?(?:[0-9]+\.[0-9]*|\.[0-9]+|[0-9]+)(?:[eE][-+]?[0-9]+)?|[-+]?\.inf|\.nan|\.NaN"
# Replaced, not extended: SafeLoader's resolvers beyond version 1.2 are removed.
_Loader.yaml_implicit_resolvers = {}
for _tag, _pattern, _first in (
    ("int", r"[-+]?[0-9]+", "-+0123456789"),
    ("float", _FLOAT, "-+0123456789."),
    ("bool", "true|false", "tf"),
    ("null", "~|null|", ["~", "n", ""]),
):
    _Loader.add_implicit_resolver(  # type: ignore[no-untyped-call]
        f"tag:yaml.org,2002:{_tag}", re.compile(f"^(?:{_pattern})$"), list(_first)
    )
_Loader.add_constructor("tag:yaml.org,2002:float", _construct_float)
_Loader.add_constructor("tag:yaml.org,2002:int", _construct_int)


def _refuse_bombs(top: yaml.Node) -> None:
    """Refuse a document whose aliases expand to more entries than a person could write."""
    sizes: dict[int, int] = {}

    def size(node: yaml.Node) -> int:
        known = sizes.get(id(node))
        if known is not None:
            return known
        sizes[id(node)] = _MOST_NODES + 1  # counts if the node contains itself, which has no end
        total = 1
        if isinstance(node, yaml.SequenceNode):
            total += sum(map(size, node.value))
        elif isinstance(node, yaml.MappingNode):
            total += sum(size(key) + size(value) for key, value in node.value)
        sizes[id(node)] = total
        return total

    if size(top) > _MOST_NODES:
        raise _refused(f"aliases that write out to more than {_MOST_NODES} entries", top)


def load_yaml(path: Path) -> Section:
    """Return the mapping at the top of the YAML file `path`.

    Errors: InputError naming file and line when it is missing, not YAML, repeats a key or is not a mapping.
    """
    text = read_text(path, largest_bytes=LARGEST_YAML_BYTES)
    try:
        loader = _Loader(text)
        try:
            node = loader.get_single_node()
            if node is not None:
                _refuse_bombs(node)
            value = None if node is None else loader.construct_document(node)  # type: ignore[no-untyped-call]
        finally:
            loader.dispose()  # type: ignore[no-untyped-call]
    except yaml.MarkedYAMLError as error:
        # The parser begins some of its sentences with "found".
        problem = (error.problem or "no YAML").removeprefix("found ")
        line = f" line {error.problem_mark.line + 1}" if error.problem_mark else ""
        raise InputError(f"{path}{line}: found {problem}, expected YAML") from None
    except yaml.YAMLError as error:
        raise InputError(f"{path}: found no YAML ({' '.join(str(error).split())})") from None
    except RecursionError:
        raise InputError(
            f"{path}: found brackets nested too deep, expected YAML a person could write"
        ) from None
    except ValueError as error:
        raise InputError(f"{path}: found a value that YAML does not allow ({error})") from None
    return Section(value, str(path))


class Section:
    """One mapping of a file. Each reader reads a key, checks it and marks it as known; `finish` refuses the others.

    `where` is the key path of the mapping, counted from 1 within lists. All readers raise InputError.
    """

    def __init__(self, value: Any, file: str, where: str = "") -> None:
        self.file = file
        self.where = where
        if not isinstance(value, dict):
            found = "nothing" if value is None else shorten(value)
            place = f"{file}: {where}" if where else file
            raise InputError(f"{place}: found {found}, expected keys with values")
        self._mapping: dict[str, Any] = value
        self._known: set[str] = set()
        self._sections: dict[str, Section] = {}

    def place(self, key: str = "") -> str:
        """Return `file: key path` for a message."""
        path = ".".join(part for part in (self.where, key) if part)
        return f"{self.file}: {path}" if path else self.file

    def fail(self, key: str, expected: str) -> InputError:
        """Return the error for `key`, quoting its value."""
        if key not in self._mapping:
            hint = did_you_mean(key, set(self._mapping) - self._known).replace("did you mean", "there is")
            return InputError(f"{self.place(key)}: found nothing, expected {expected}{hint.replace('?', '')}")
        return InputError(f"{self.place(key)}: found {shorten(self._mapping[key])}, expected {expected}")

    def has(self, key: str) -> bool:
        """True if `key` has a value other than null; marks `key` as known."""
        return self.raw(key) is not None

    def __iter__(self) -> Iterator[str]:
        """The keys, in file order."""
        return iter(self._mapping)

    def raw(self, key: str, default: Any = None) -> Any:
        """The unchecked value of `key`, `default` where it is absent; marks `key` as known."""
        self._known.add(key)
        value = self._mapping.get(key)
        return default if value is None else value

    def number(
        self,
        key: str,
        default: Any = _REQUIRED,
        *,
        minimum: float = -math.inf,
        above: float = -math.inf,
        expected: str = "a number",
    ) -> float:
        """A finite number, at least `minimum` and greater than `above`; with the default None also null."""
        value = self.raw(key, default)
        if value is None:
            return default  # type: ignore[no-any-return]
        if not _is_number(value) or not minimum <= value or not above < value:
            raise self.fail(key, expected)
        return float(value)

    def text(self, key: str, default: str | None = None, expected: str = "text") -> str:
        """Text that is not empty; a number is taken as its text, as names like `7` need no quotes."""
        value = self.raw(key, default)
        if isinstance(value, int | float) and not isinstance(value, bool):
            return str(value)
        if not isinstance(value, str) or not value:
            raise self.fail(key, expected)
        return value

    def flag(self, key: str, default: bool) -> bool:
        """`true` or `false`."""
        value = self.raw(key, default)
        if not isinstance(value, bool):
            raise self.fail(key, "true or false")
        return value

    def choice(self, key: str, options: Sequence[str], default: str | None = None) -> str:
        """One of `options`."""
        value = self.raw(key, default)
        if value not in options:
            hint = did_you_mean(value, options) if isinstance(value, str) else ""
            raise self.fail(key, " or ".join(options) + hint)
        return str(value)

    def numbers(
        self, key: str, count: int | None, expected: str, default: list[float] | None = None
    ) -> list[float]:
        """A list of finite numbers, `count` of them where it is given."""
        value = self.raw(key, default)
        if not isinstance(value, list) or count not in (None, len(value)) or not all(map(_is_number, value)):
            raise self.fail(key, expected)
        return [float(entry) for entry in value]

    def texts(self, key: str, expected: str) -> list[str]:
        """A list of texts, none empty."""
        value = self.entries(key, expected)
        if not all(isinstance(entry, str) and entry for entry in value):
            raise self.fail(key, expected)
        return list(value)

    def joint(self, key: str, joint_count: int) -> int:
        """A joint number, 1 to `joint_count`."""
        value = self.raw(key)
        if type(value) is not int or not 1 <= value <= joint_count:
            raise self.fail(key, f"a joint number from 1 to {joint_count}")
        return value

    def joints(self, key: str, joint_count: int, count: int | None = None) -> list[int]:
        """A list of different joint numbers, 1 to `joint_count`."""
        how_many = "" if count is None else f"{count} "
        expected = f"a list of {how_many}different joint numbers from 1 to {joint_count}"
        value = self.entries(key, expected)
        are_joints = all(type(k) is int and 1 <= k <= joint_count for k in value)
        if not value or count not in (None, len(value)) or not are_joints or len(set(value)) != len(value):
            raise self.fail(key, expected)
        return list(value)

    def section(self, key: str) -> Section:
        """The mapping under `key`."""
        if not self.has(key):
            raise self.fail(key, "keys with values")
        return self._below(key, self.raw(key))

    def optional(self, key: str) -> Section:
        """The mapping under `key`, an empty one where it is absent."""
        return self.section(key) if self.has(key) else Section({}, self.file)

    def entries(self, key: str, expected: str) -> list[Any]:
        """The list under `key`, its entries unchecked."""
        value = self.raw(key)
        if not isinstance(value, list):
            raise self.fail(key, expected)
        return value

    def sections(self, key: str, expected: str) -> list[Section]:
        """The list of mappings under `key`."""
        entries = self.entries(key, expected)
        return [self._below(f"{key}[{number}]", entry) for number, entry in enumerate(entries, start=1)]

    def _below(self, key: str, value: Any) -> Section:
        if key not in self._sections:
            where = f"{self.where}.{key}" if self.where else key
            self._sections[key] = Section(value, self.file, where)
        return self._sections[key]

    def finish(self) -> None:
        """Refuse keys that were not read, here and in the sections below that were."""
        for key in self._mapping:
            if key not in self._known:
                hint = did_you_mean(key, self._known) or f" (known here: {', '.join(sorted(self._known))})"
                raise InputError(f"{self.place(key)}: found a key that does not belong here{hint}")
        for section in self._sections.values():
            section.finish()


def _is_number(value: Any) -> bool:
    try:
        return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    except OverflowError:  # an integer beyond what a double holds
        return False
