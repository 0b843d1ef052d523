"""The value of a pickle, made of what its program describes."""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import Any, BinaryIO

import numpy as np

from subjects.fits.pickles import program, tensors
from subjects.fits.pickles.calls import FUNCTIONS, TORCH_BYTES
from subjects.fits.pickles.content import EXPORT, Budget, exactly, expected, line
from subjects.fits.pickles.program import Call, Name
from subjects.mesh import MeshError

DEEPEST = 64
"""Levels that containers may nest; also what ends one that holds itself."""

ITEM_BYTES = 256
"""What an item of a container counts for in memory."""


class Reader:
    """Reads the pickles of one file, within bounds that they share.

    Args:
        budget: the bounds.
        embedded: reads the torch file that a pickle holds as bytes, at a depth.
    """

    def __init__(self, budget: Budget, embedded: Callable[[BinaryIO, Reader, int], Any]) -> None:
        self.budget = budget
        self._embedded = embedded

    def pickle(self, file: BinaryIO, depth: int = 0) -> Any:
        """The value of the pickle that starts where `file` is; it is left behind its end."""
        tree, outside = self.parse(file)
        if outside:
            key = outside[0].arguments
            told = f" '{line(key)}'" if isinstance(key, str) else ""
            raise MeshError(f"asks for an object outside itself (persistent id{told}); {EXPORT}")
        return self.value(tree, depth)

    def parse(self, file: BinaryIO) -> tuple[Any, list[Call]]:
        """As `program.parse`."""
        return program.parse(file, self.budget, self._joblib_array)

    def value(self, tree: Any, depth: int = 0) -> Any:
        """The plain value that a tree of `parse` describes, `depth` levels within another."""
        if depth > DEEPEST:
            raise MeshError(f"nests over {DEEPEST} levels deep or holds itself; export it flat")
        if isinstance(tree, list | tuple):
            self.budget.spend(ITEM_BYTES * (1 + len(tree)))
            return type(tree)([self.value(item, depth + 1) for item in tree])
        if not isinstance(tree, Call):
            return str(tree) if isinstance(tree, Name) else tree
        if tree.value is not None:
            return tree.value
        value = self._called(tree, depth + 1)
        if isinstance(value, np.ndarray):
            value = tree.value = self.own(value)
        else:
            is_text = isinstance(value, bytes | str)
            self.budget.spend(len(value) if is_text else getattr(value, "nbytes", 0))
        return value

    def own(self, view: np.ndarray) -> np.ndarray:
        """A copy that may be written to, in native byte order."""
        self.budget.spend(view.nbytes)
        return view.astype(view.dtype.newbyteorder("="), order="C")

    def _called(self, call: Call, depth: int) -> Any:
        arguments = self.value(call.arguments, depth)
        if call.name == TORCH_BYTES:
            (data,) = arguments
            return self._embedded(io.BytesIO(expected(data, bytes)), self, depth)
        told = {"state": call.state} if call.state is not None else {}
        told |= {"items": call.items} if call.items else {}
        told = {name: self.value(tree, depth) for name, tree in told.items()}
        return FUNCTIONS[call.name](*arguments, **told)

    def _joblib_array(self, file: BinaryIO, state: Any) -> np.ndarray:
        """An array whose bytes joblib has put into the midst of the pickle, where `file` is."""
        wrapper = self.value(state)
        code, shape = wrapper["dtype"], wrapper["shape"]
        if tensors.is_object(code):
            return self.pickle(file)
        if wrapper.get("numpy_array_alignment_bytes") is not None:
            exactly(file, exactly(file, 1)[0])
        data = exactly(file, tensors.byte_count(code, shape))
        return self.own(tensors.array(data, code, shape, wrapper["order"]))
