"""The data that a worker may answer with: None, truth values, numbers, texts, lists, dictionaries by text, number arrays.

On its way an answer is JSON, in which an array is its kind and its shape; the bytes of the arrays follow, in their order. A worker
may have run code of others, so that reading an answer makes data or fails, and never runs anything: nothing is unpickled, and what
is made is no larger than what came.
"""

import json
import math
import struct
from typing import Any

import numpy as np

LENGTH = struct.Struct("<Q")  # of the JSON
LONGEST = 1 << 26  # bytes of JSON: what is read of it may be some 20 times as large
ARRAY, MOST = "array of numbers", 3  # dimensions
KINDS = {"f": np.dtype("<f8"), "i": np.dtype("<i8"), "b": np.dtype("|b1")}


class NoAnswer(ValueError):
    """Bytes that are no answer, or an object that cannot be one."""


def pack_answer(item: object) -> bytes:
    """The bytes of an answer.

    Raises:
        NoAnswer: it holds something that is neither text, number, array nor made of them.
    """
    parts: list[bytes] = []

    def described(x: object) -> object:
        if isinstance(x, np.generic):
            return x.item()
        if isinstance(x, np.ndarray) and x.dtype.kind in KINDS:
            parts.append(np.ascontiguousarray(x, dtype=KINDS[x.dtype.kind]).tobytes())
            return {ARRAY: [x.dtype.kind, x.shape]}
        raise NoAnswer(f"a worker cannot answer with {type(x).__name__}")

    text = json.dumps(item, default=described).encode()
    return b"".join((LENGTH.pack(len(text)), text, *parts))


def unpack_answer(content: bytes) -> Any:
    """The answer that the bytes hold.

    Raises:
        NoAnswer: they hold none.
    """
    if len(content) < LENGTH.size:
        raise NoAnswer("it is too short")
    (length,) = LENGTH.unpack_from(content)
    text, left = content[LENGTH.size : LENGTH.size + length], memoryview(content)[LENGTH.size + length :]
    if length > LONGEST or len(text) < length:
        raise NoAnswer(f"it says that it holds {length} bytes of text")

    def restore(table: dict[str, Any]) -> Any:
        nonlocal left
        if table.keys() != {ARRAY}:
            return table
        dtype, shape = _form(table[ARRAY])
        size = math.prod(shape) * dtype.itemsize
        if size > len(left):
            raise NoAnswer("it holds less than its arrays need")
        array = np.frombuffer(left[:size], dtype).reshape(shape).copy()
        left = left[size:]
        return array

    try:
        return json.loads(text.decode(), object_hook=restore)
    except (ValueError, RecursionError) as error:
        raise NoAnswer(str(error)) from error


def _form(told: object) -> tuple[np.dtype[Any], list[int]]:
    """Type and shape of an array as told."""
    match told:
        case [str(kind), [*shape]] if kind in KINDS and len(shape) <= MOST:
            lengths = [k for k in shape if type(k) is int and 0 <= k <= LONGEST]
            if lengths == shape:
                return KINDS[kind], lengths
    raise NoAnswer("an array of no form")
