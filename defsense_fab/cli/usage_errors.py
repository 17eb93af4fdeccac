"""Errors in the words of a command line: what is wrong, and where to look."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from types import NoneType
from typing import Any, Literal, get_args, get_origin

from cyclopts import Argument, CycloptsError
from cyclopts.exceptions import (
    CoercionError,
    MissingArgumentError,
    RepeatArgumentError,
    UnknownCommandError,
    UnknownOptionError,
    UnusedCliTokensError,
    ValidationError,
)

from ..core.errors import DeviceError

#: Types of values in words.
_TYPES = {int: "a whole number", float: "a number", bool: "yes or no"}


def usage_error(error: CycloptsError, words: Sequence[str]) -> DeviceError:
    """Return an error of cyclopts as one of this program.

    Args:
        error: The error.
        words: The command line.

    Returns:
        An error with the code `unknown-command`, `unknown-option`, `argument-missing`,
        `argument-invalid`, `argument-repeated`, `argument-unexpected`, or `usage` for others.
    """
    command = " ".join(("defsense", *(error.command_chain or ())))
    if isinstance(error, UnknownCommandError):
        word = (error.unused_tokens or ("",))[0]
        kind = "option" if word.startswith("-") else "command"
        return _unknown(kind, word, error.app or (), command)
    if isinstance(error, UnknownOptionError):
        word = error.token.keyword or error.token.value
        names = [name for a in error.argument_collection if a.parse for name in a.names]
        return _unknown("option", word, names, command)
    if isinstance(error, MissingArgumentError) and error.argument:
        return _missing(error, error.argument, words, command)
    if isinstance(error, UnusedCliTokensError):
        unused = " ".join(error.unused_tokens or ())
        return _error(f"unexpected argument {unused!r}", "argument-unexpected", command)
    if isinstance(error, RepeatArgumentError):
        name = error.token.keyword or error.token.value
        return _error("is given more than once", "argument-repeated", command, name)
    if isinstance(error, CoercionError):
        return _invalid(error, command)
    if isinstance(error, ValidationError) and error.argument:
        where = _name(error.argument)
        return _error(error.exception_message, "argument-invalid", command, where)
    return _error(" ".join(str(error).split()), "usage", command)


def wrong_count(name: str, expected: int, count: int, command: str) -> DeviceError:
    """Return the error for a list with too few or too many items.

    Args:
        name: The option.
        expected: Number of items that it needs.
        count: Number of items that it has.
        command: The command, such as `defsense build`.
    """
    problem = f"needs {expected} values, got {count}"
    return _error(problem, "argument-invalid", command, name)


def _error(problem: str, code: str, command: str, where: str = "", hint: str = "") -> DeviceError:
    end = "" if not hint or hint.endswith("?") else "."
    action = f"{hint}{end} See {command} --help".lstrip()
    return DeviceError(problem.rstrip("."), code=code, where=where, action=action)


def _unknown(kind: str, word: str, names: Iterable[str], command: str) -> DeviceError:
    word = word.partition("=")[0]
    similar = get_close_matches(word, list(names), n=1)
    hint = f"Did you mean {similar[0]}?" if similar else ""
    return _error(f"unknown {kind} {word}", f"unknown-{kind}", command, hint=hint)


def _missing(
    error: MissingArgumentError, argument: Argument, words: Sequence[str], command: str
) -> DeviceError:
    name = error.keyword or _name(argument)
    is_given = name.startswith("-") and any(w.partition("=")[0] in argument.names for w in words)
    if not is_given:
        return _error(f"{name} is missing", "argument-missing", command)
    count, _ = argument.token_count()
    if count > 1:
        problem = f"needs {count} values, got {len(error.tokens_so_far)}"
    else:
        problem = "needs a value"
    return _error(problem, "argument-missing", command, name)


def _invalid(error: CoercionError, command: str) -> DeviceError:
    token, argument = error.token, error.argument
    where = token.keyword if token and token.keyword else _name(argument) if argument else ""
    if error.msg is not None or token is None:
        problem = " ".join(str(error.msg or error).split())
        return _error(problem, "argument-invalid", command, where)
    choices, kind = _choices_and_type(error.target_type)
    hint = ""
    if choices:
        problem = f"{token.value!r} is not valid"
        similar = get_close_matches(token.value, choices, n=1)
        hint = f"Did you mean {similar[0]}?" if similar else f"Use one of: {', '.join(choices)}"
    else:
        words = _allowed_texts(argument.hint) if argument else []
        problem = f"{token.value!r} is not {' or '.join([kind, *words])}"
    return _error(problem, "argument-invalid", command, where, hint)


def _allowed_texts(hint: Any) -> list[str]:
    """Return the texts that a type allows in addition to numbers, such as `auto`."""
    if get_origin(hint) is Literal:
        return [str(choice) for choice in get_args(hint)]
    return [choice for part in get_args(hint) for choice in _allowed_texts(part)]


def _choices_and_type(hint: Any) -> tuple[list[str], str]:
    """Return the texts that a type allows, and the type in words."""
    if get_origin(hint) is Literal:
        return [str(choice) for choice in get_args(hint)], ""
    parts = [part for part in get_args(hint) if part is not NoneType]
    if parts and hint not in _TYPES:
        return _choices_and_type(parts[0])
    return [], _TYPES.get(hint, "a valid value")


def _name(argument: Argument) -> str:
    """Return the name of an argument as the help shows it."""
    name = argument.name
    return name if name.startswith("-") else name.upper()
