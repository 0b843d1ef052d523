"""A pickle's opcodes, read as what they describe. Nothing is called or looked up."""

from __future__ import annotations

import codecs
import pickletools
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, BinaryIO

import numpy as np

from subjects.fits.pickles.calls import CALLABLE, JOBLIB_ARRAY, NAMES
from subjects.fits.pickles.content import EXPORT, Budget, exactly, expected, line
from subjects.mesh import MeshError

_OPCODES = {opcode.code.encode("latin-1"): opcode for opcode in pickletools.opcodes}
_VALUES = frozenset(
    [
        *("INT", "BININT", "BININT1", "BININT2", "LONG", "LONG1", "LONG4", "FLOAT", "BINFLOAT"),
        *("STRING", "BINSTRING", "SHORT_BINSTRING"),
        *("UNICODE", "BINUNICODE", "SHORT_BINUNICODE", "BINUNICODE8"),
        *("BINBYTES", "SHORT_BINBYTES", "BINBYTES8", "BYTEARRAY8"),
    ]
)
_TAKEN = {
    **dict.fromkeys(["EMPTY_TUPLE", "EMPTY_LIST", "EMPTY_DICT", "EMPTY_SET"], 0),
    **{"APPEND": 1, "TUPLE1": 1, "TUPLE2": 2, "SETITEM": 2, "TUPLE3": 3},
}


class Name(str):
    """The dotted name of a class or function. It is never looked up."""

    __slots__ = ()


@dataclass(eq=False, slots=True)
class Call:
    """What a pickle wants made: noted, not made.

    Attributes:
        name: one of `CALLABLE`; "" of what has a persistent id.
        arguments: what it is to be called with; the persistent id.
        state: what it is to be told afterwards.
        items: what is to be put into it afterwards.
        value: the array, once there is one.
    """

    name: str
    arguments: Any
    state: Any = None
    items: list[Any] = field(default_factory=list)
    value: np.ndarray | None = None


def parse(
    file: BinaryIO, budget: Budget, joblib_array: Callable[[BinaryIO, Any], np.ndarray]
) -> tuple[Any, list[Call]]:
    """What the pickle at `file` describes, and what of it has a persistent id.

    The tree is made of lists, tuples, `Call`s, `Name`s and immutable values; it may hold itself.

    Args:
        file: it is left behind the pickle's end.
        budget: gives the opcodes.
        joblib_array: reads an array whose bytes lie amid the opcodes, given the file, which
            it leaves behind them, and the tree that describes the array.
    """
    stack: list[Any] = []
    marks: list[int] = []
    memo: dict[int, Any] = {}
    outside: list[Call] = []

    def taken() -> list[Any]:
        """The items that the opcode takes: so many, or those above the last mark."""
        start = len(stack) - _TAKEN[opcode] if opcode in _TAKEN else marks.pop()
        items = stack[start:]
        del stack[start:]
        return items

    while True:
        opcode, argument = _opcode(file, budget)
        match opcode:
            case "PROTO" | "FRAME":
                pass
            case "STOP":
                return stack.pop(), outside

            case "MARK":
                marks.append(len(stack))
            case "POP":
                stack.pop()
            case "POP_MARK":
                taken()
            case "DUP":
                stack.append(stack[-1])
            case "MEMOIZE":
                memo[len(memo)] = stack[-1]
            case "PUT" | "BINPUT" | "LONG_BINPUT":
                memo[argument] = stack[-1]
            case "GET" | "BINGET" | "LONG_BINGET":
                stack.append(memo[argument])

            case "NONE" | "NEWTRUE" | "NEWFALSE":
                stack.append({"NEWTRUE": True, "NEWFALSE": False}.get(opcode))
            case "EMPTY_TUPLE" | "TUPLE1" | "TUPLE2" | "TUPLE3" | "TUPLE":
                stack.append(tuple(taken()))
            case "EMPTY_LIST" | "LIST":
                stack.append(taken())
            case "EMPTY_DICT" | "DICT":
                stack.append(Call("builtins.dict", (), items=taken()))
            case "EMPTY_SET" | "FROZENSET":
                stack.append(Call("builtins.set", (), items=taken()))

            case "APPEND" | "APPENDS":
                items = taken()
                expected(stack[-1], list).extend(items)
            case "SETITEM" | "SETITEMS" | "ADDITEMS":
                items = taken()
                expected(stack[-1], Call).items.extend(items)

            case "GLOBAL" | "INST" | "STACK_GLOBAL":
                if opcode == "STACK_GLOBAL":
                    name, module = (expected(stack.pop(), str) for _ in range(2))
                    argument = f"{module}.{name}"
                stack.append(_name(argument.replace(" ", ".")))
                if opcode == "INST":
                    stack.append(_call(stack.pop(), tuple(taken())))
            case "REDUCE" | "NEWOBJ":
                arguments = stack.pop()
                stack.append(_call(stack.pop(), arguments))
            case "OBJ":
                name, *arguments = taken()
                stack.append(_call(name, tuple(arguments)))
            case "BUILD":
                state = stack.pop()
                call = expected(stack[-1], Call)
                call.state = state
                if call.name == JOBLIB_ARRAY:
                    call.value = joblib_array(file, state)
            case "PERSID" | "BINPERSID":
                outside.append(Call("", argument or stack.pop()))
                stack.append(outside[-1])

            case _ if opcode in _VALUES:
                stack.append(bytes(argument) if opcode == "BYTEARRAY8" else argument)
            case _:
                raise MeshError(f"uses the opcode {opcode}, which no array needs; {EXPORT}")


def _opcode(file: BinaryIO, budget: Budget) -> tuple[str, Any]:
    """The next opcode's name and argument."""
    budget.step()
    opcode = _OPCODES[exactly(file, 1)]
    if opcode.name == "STRING":  # Python 2's, of bytes that need not be ASCII
        quoted = pickletools.read_stringnl(file, decode=False)
        return "STRING", codecs.escape_decode(quoted)[0].decode("latin-1")
    return opcode.name, opcode.arg and opcode.arg.reader(file)


def _name(name: str) -> Name:
    """`name` as Python 3 and NumPy 1 have it; MeshError where it has no business in a fit."""
    same = name.replace("__builtin__.", "builtins.").replace("numpy._core.", "numpy.core.")
    if same not in NAMES:
        raise MeshError(f"asks for {line(name)}, which is no array or plain container; {EXPORT}")
    return Name(same)


def _call(name: Any, arguments: Any) -> Call:
    if not isinstance(name, Name) or name not in CALLABLE:
        told = line(name) if isinstance(name, str) else f"a {type(name).__name__}"
        raise MeshError(f"calls {told}, which is no function of an array; {EXPORT}")
    return Call(str(name), expected(arguments, tuple))
