"""Prints every public name of octobrick, one a line, with the parameters that a caller may name.

    .venv/bin/python script/lib/public_names.py > tests/house/public_names.txt

A name is public when its component's ``__init__.py`` lists it in ``__all__``; of a class that is
listed, its public members; of a module that is listed, the names of its own ``__all__``, or without
one all that are defined there and do not begin with ``_``.
"""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Iterator
from types import GenericAlias, ModuleType
from typing import Any

COMPONENTS = ("codec", "store", "renderer", "measure", "server")


def names_of_module(module: ModuleType, path: str) -> Iterator[str]:
    """The public names of a module; those of modules and classes inside it come with them."""
    names = getattr(module, "__all__", None)
    if names is None:
        names = [name for name, value in vars(module).items() if _is_defined_in(module, value)]
        names = [name for name in names if not name.startswith("_")]
    for name in sorted(names):
        yield from names_of_value(getattr(module, name), f"{path}.{name}")


def names_of_value(value: Any, path: str) -> Iterator[str]:
    """A public value: itself, and what is public inside it."""
    if inspect.ismodule(value):
        yield from names_of_module(value, path)
    elif inspect.isclass(value):
        yield f"{path}{parameters_of(value)}"
        for name, member in sorted(_members(value)):
            yield f"{path}.{name}{parameters_of(member)}"
    else:
        yield f"{path}{parameters_of(value)}"


def parameters_of(value: Any) -> str:
    """``(array, *, peak=)`` for what can be called: names, and ``=`` where one may be left out.

    Errors are made here and caught by others, protocols and aliases are never made: no parameters.
    """
    if isinstance(value, staticmethod | classmethod):
        value = value.__wrapped__
    if isinstance(value, GenericAlias) or getattr(value, "_is_protocol", False):
        return ""
    if not callable(value):
        return ""
    if inspect.isclass(value) and issubclass(value, BaseException):
        return ""
    try:
        parameters = list(inspect.signature(value).parameters.values())
    except ValueError:  # a builtin that does not tell
        return ""
    words = []
    starred = False
    for parameter in parameters:
        if parameter.kind is parameter.KEYWORD_ONLY and not starred:
            words.append("*")
        starred |= parameter.kind in (parameter.KEYWORD_ONLY, parameter.VAR_POSITIONAL)
        if parameter.name not in ("self", "cls") and not parameter.name.startswith("_"):
            words.append(_word(parameter))
    return f"({', '.join(words)})"


def _word(parameter: inspect.Parameter) -> str:
    stars = "*" if parameter.kind is parameter.VAR_POSITIONAL else ""
    stars = "**" if parameter.kind is parameter.VAR_KEYWORD else stars
    default = "" if parameter.default is parameter.empty else "="
    return f"{stars}{parameter.name}{default}"


def _members(cls: type) -> Iterator[tuple[str, Any]]:
    """Public attributes of octobrick's own classes, but not those that the parameters show."""
    seen = {word.rstrip("=") for word in parameters_of(cls).strip("()").split(", ")}
    for base in cls.__mro__:
        if base.__module__.startswith("octobrick."):
            fields = dict.fromkeys(inspect.get_annotations(base))
            for name, member in (fields | vars(base)).items():
                if not name.startswith("_") and name not in seen and not _is_data(member):
                    seen.add(name)
                    yield name, member


def _is_data(member: Any) -> bool:
    """Whether a member is a plain value or the slot of one: its class decides, not its name."""
    return inspect.ismemberdescriptor(member) or isinstance(member, str | int | float | dict)


def _is_defined_in(module: ModuleType, value: Any) -> bool:
    return getattr(value, "__module__", None) == module.__name__


def main() -> None:
    """Print them all, component by component."""
    for component in COMPONENTS:
        path = f"octobrick.{component}"
        for line in names_of_module(importlib.import_module(path), path):
            print(line)


if __name__ == "__main__":
    main()
