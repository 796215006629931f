"""Fours: vectors of four numbers, on which the processor computes with one instruction (SIMD).

The operators and functions below act on each number of a four of floats, integers or truth values;
the other operand may be a four or one number. Each of the four results is rounded like that of a
single operation, so they do not depend on the processor: one without such instructions computes the
four one after the other. Outside of compiled kernels a four is a NumPy array (4,), and the
functions are those of this file.

Integers serve as addresses, for which the processor needs them one by one: compiled, a four of them
is no vector.

The arrays that are read or written are one-dimensional; `float64` or `uint32` as stated. No index
is checked.
"""

import operator
from collections.abc import Callable, Sequence

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.cpu import CPUContext
from numba.core.datamodel import DataModelManager
from numba.core.imputils import lower_builtin
from numba.core.typing.templates import ConcreteTemplate, Signature, infer_global, signature
from numba.extending import models, register_model

SIZE = 4


def four(number: float) -> np.ndarray:
    """Return a four of floats, all equal to a number."""
    return np.full(SIZE, float(number))


def four_from(first: float) -> np.ndarray:
    """Return first, first + 1, first + 2, first + 3."""
    return first + np.arange(float(SIZE))


def four_entries(array: np.ndarray, first: int, end: int, beyond: int) -> np.ndarray:
    """Return the entries of a uint32 array from an index on, as integers; from the index `end` on,
    `beyond`.

    All four are read, so the array must have them.
    """
    return np.where(first + np.arange(SIZE) < end, array[first : first + SIZE], beyond).astype(
        np.int64
    )


def four_columns(
    array: np.ndarray, index: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return (array[index], array[index + 1], array[index + 2], array[index + 3]) of a float64
    array.
    """
    return array[index], array[index + 1], array[index + 2], array[index + 3]


def copy_four(target: np.ndarray, at: int, source: np.ndarray, first: int) -> None:
    """Copy four entries of a uint32 array, from `first` on, to another, from `at` on."""
    target[at : at + SIZE] = source[first : first + SIZE]


def replace_in_four(array: np.ndarray, first: int, old: int, new: int) -> None:
    """Replace a value by another one in four entries of a uint32 array, from `first` on."""
    entries = array[first : first + SIZE]
    entries[entries == old] = new


def where(condition: np.ndarray, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return the numbers of `one` where a condition holds, elsewhere those of `other`; both are
    fours of floats.
    """
    return np.where(condition, one, other)


def any_of(condition: np.ndarray) -> bool:
    """Whether a condition holds for any of the four."""
    return bool(condition.any())


def all_bits(integers: np.ndarray) -> int:
    """Return the bits that are set in any of four integers."""
    return int(np.bitwise_or.reduce(integers))


def least_of_four(values: np.ndarray) -> float:
    """Return the least of four floats."""
    return float(values.min())


# -- compiled --------------------------------------------------------------------------------------

LONG, WORD, DOUBLE = ir.IntType(64), ir.IntType(32), ir.DoubleType()


class Four(types.Type):
    """The Numba type of a four of `number`, in LLVM of type `four`."""

    def __init__(self, number: types.Type, four: ir.Type) -> None:
        self.number, self.four = number, four
        super().__init__(f"Four.{number}")


FLOATS = Four(types.float64, ir.VectorType(DOUBLE, SIZE))
TRUTHS = Four(types.boolean, ir.VectorType(ir.IntType(1), SIZE))
INTEGERS = Four(types.int64, ir.ArrayType(LONG, SIZE))
NUMBERS, WORDS = types.Array(types.float64, 1, "C"), types.Array(types.uint32, 1, "C")


@register_model(Four)
class _FourModel(models.PrimitiveModel):
    def __init__(self, manager: DataModelManager, kind: Four) -> None:
        super().__init__(manager, kind, kind.four)


def _instructions(function: Callable, *signatures: Signature) -> Callable:
    """Let Numba compile calls of a function with these signatures to what `code(builder,
    *arguments)` builds.

    Of an array, `code` gets the address of its first element.
    """

    def register(code: Callable) -> Callable:
        def compiled(
            context: CPUContext,
            builder: ir.IRBuilder,
            called: Signature,
            arguments: Sequence[ir.Value],
        ) -> ir.Value:
            values = [
                context.make_array(kind)(context, builder, value).data
                if isinstance(kind, types.Array)
                else value
                for kind, value in zip(called.args, arguments, strict=True)
            ]
            made = code(builder, *values)
            if isinstance(called.return_type, types.BaseTuple):
                return context.make_tuple(builder, called.return_type, made)
            return context.get_dummy_value() if made is None else made

        infer_global(function)(
            type(function.__name__, (ConcreteTemplate,), {"cases": list(signatures)})
        )
        for overload in signatures:
            lower_builtin(function, *overload.args)(compiled)
        return code

    return register


def _operation(function: Callable, kind: Four, result: Four, instruction: Callable) -> None:
    """Let Numba compile a function of two fours, or of a four and a number, to one instruction; of
    integers to four.
    """

    def code(builder: ir.IRBuilder, *operands: ir.Value) -> ir.Value:
        if kind is INTEGERS:
            lanes = zip(*(_each(builder, value) for value in operands), strict=True)
            return _integers(builder, [instruction(builder, *pair) for pair in lanes])
        fours = [
            value if isinstance(value.type, ir.VectorType) else _spread(builder, value)
            for value in operands
        ]
        return instruction(builder, *fours)

    _instructions(function, *_pairs(kind, result))(code)


def _pairs(kind: Four, result: Four) -> list[Signature]:
    """Return the signatures of an operation on two fours, or a four and a number."""
    return [
        signature(result, *pair)
        for pair in ((kind, kind), (kind, kind.number), (kind.number, kind))
    ]


def _each(builder: ir.IRBuilder, value: ir.Value) -> list[ir.Value]:
    """Return the integers of a four, or a number four times."""
    if isinstance(value.type, ir.ArrayType):
        return [builder.extract_value(value, lane) for lane in range(SIZE)]
    return [value] * SIZE


def _integers(builder: ir.IRBuilder, each: Sequence[ir.Value]) -> ir.Value:
    """Return four integers as one value."""
    made = ir.Constant(INTEGERS.four, ir.Undefined)
    for lane, integer in enumerate(each):
        made = builder.insert_value(made, integer, lane)
    return made


def _as_vector(builder: ir.IRBuilder, integers: ir.Value) -> ir.Value:
    """Return the integers of a four, or a number four times, as a vector."""
    vector = ir.Constant(ir.VectorType(LONG, SIZE), ir.Undefined)
    for lane, integer in enumerate(_each(builder, integers)):
        vector = builder.insert_element(vector, integer, WORD(lane))
    return vector


def _spread(builder: ir.IRBuilder, number: ir.Value) -> ir.Value:
    """Return a vector of equal numbers."""
    none = ir.Constant(ir.VectorType(number.type, SIZE), ir.Undefined)
    return _shuffled(builder, builder.insert_element(none, number, WORD(0)), none, [0] * SIZE)


def _shuffled(builder: ir.IRBuilder, one: ir.Value, other: ir.Value, lanes: list[int]) -> ir.Value:
    """Return the vector of these elements of two vectors: 0 to 3 of the first, 4 to 7 of the
    second.
    """
    return builder.shuffle_vector(one, other, ir.Constant(ir.VectorType(WORD, SIZE), lanes))


def _vector_at(builder: ir.IRBuilder, start: ir.Value, index: ir.Value) -> ir.Value:
    """Return the address of an array's element as that of a vector."""
    vector = ir.VectorType(start.type.pointee, SIZE)
    return builder.bitcast(builder.gep(start, [index]), vector.as_pointer())


def _smaller(builder: ir.IRBuilder, one: ir.Value, other: ir.Value) -> ir.Value:
    return builder.select(builder.fcmp_ordered("<", one, other), one, other)


def _larger(builder: ir.IRBuilder, one: ir.Value, other: ir.Value) -> ir.Value:
    return builder.select(builder.fcmp_ordered(">", one, other), one, other)


_operation(operator.add, FLOATS, FLOATS, ir.IRBuilder.fadd)
_operation(operator.sub, FLOATS, FLOATS, ir.IRBuilder.fsub)
_operation(operator.mul, FLOATS, FLOATS, ir.IRBuilder.fmul)
_operation(operator.truediv, FLOATS, FLOATS, ir.IRBuilder.fdiv)
_operation(np.maximum, FLOATS, FLOATS, _larger)
_operation(
    operator.lt, FLOATS, TRUTHS, lambda builder, one, other: builder.fcmp_ordered("<", one, other)
)
_operation(
    operator.le, FLOATS, TRUTHS, lambda builder, one, other: builder.fcmp_ordered("<=", one, other)
)
_operation(
    operator.gt, FLOATS, TRUTHS, lambda builder, one, other: builder.fcmp_ordered(">", one, other)
)
_operation(operator.and_, TRUTHS, TRUTHS, ir.IRBuilder.and_)
_operation(operator.mul, INTEGERS, INTEGERS, ir.IRBuilder.mul)
_operation(operator.add, INTEGERS, INTEGERS, ir.IRBuilder.add)
_operation(operator.and_, INTEGERS, INTEGERS, ir.IRBuilder.and_)
_operation(operator.rshift, INTEGERS, INTEGERS, ir.IRBuilder.lshr)


@_instructions(operator.ne, *_pairs(INTEGERS, TRUTHS))
def _differ(builder: ir.IRBuilder, one: ir.Value, other: ir.Value) -> ir.Value:
    return builder.icmp_signed("!=", _as_vector(builder, one), _as_vector(builder, other))


@_instructions(np.sqrt, signature(FLOATS, FLOATS))
def _sqrt(builder: ir.IRBuilder, values: ir.Value) -> ir.Value:
    kind = ir.FunctionType(values.type, [values.type])
    return builder.call(
        cgutils.get_or_insert_function(builder.module, kind, f"llvm.sqrt.v{SIZE}f64"), [values]
    )


_instructions(four, signature(FLOATS, types.float64))(_spread)
_instructions(where, signature(FLOATS, TRUTHS, FLOATS, FLOATS))(ir.IRBuilder.select)


@_instructions(four_from, signature(FLOATS, types.float64))
def _four_from(builder: ir.IRBuilder, first: ir.Value) -> ir.Value:
    return builder.fadd(
        _spread(builder, first), ir.Constant(FLOATS.four, [float(lane) for lane in range(SIZE)])
    )


@_instructions(four_entries, signature(INTEGERS, WORDS, types.int64, types.int64, types.int64))
def _four_entries(
    builder: ir.IRBuilder, array: ir.Value, first: ir.Value, end: ir.Value, beyond: ir.Value
) -> ir.Value:
    """Load the four one by one ("unordered" for LLVM): what `copy_four` has just written is then
    available at once.

    A load of all four would wait until several overlapping stores are in the cache, after all
    earlier instructions.
    """
    each = []
    for lane in range(SIZE):
        index = builder.add(first, LONG(lane))
        entry = builder.zext(
            builder.load_atomic(builder.gep(array, [index]), "unordered", align=4), LONG
        )
        each.append(builder.select(builder.icmp_signed("<", index, end), entry, beyond))
    return _integers(builder, each)


@_instructions(four_columns, signature(types.UniTuple(FLOATS, SIZE), NUMBERS, INTEGERS))
def _four_columns(builder: ir.IRBuilder, array: ir.Value, index: ir.Value) -> list[ir.Value]:
    """Load four rows, and transpose them."""
    a, b, c, d = (
        builder.load(_vector_at(builder, array, at), align=8) for at in _each(builder, index)
    )
    even_ab, odd_ab = (_shuffled(builder, a, b, lanes) for lanes in ([0, 4, 2, 6], [1, 5, 3, 7]))
    even_cd, odd_cd = (_shuffled(builder, c, d, lanes) for lanes in ([0, 4, 2, 6], [1, 5, 3, 7]))
    return [
        _shuffled(builder, ab, cd, lanes)
        for lanes in ([0, 1, 4, 5], [2, 3, 6, 7])
        for ab, cd in ((even_ab, even_cd), (odd_ab, odd_cd))
    ]


@_instructions(copy_four, signature(types.void, WORDS, types.int64, WORDS, types.int64))
def _copy_four(
    builder: ir.IRBuilder, target: ir.Value, at: ir.Value, source: ir.Value, first: ir.Value
) -> None:
    values = builder.load(_vector_at(builder, source, first), align=4)
    builder.store(values, _vector_at(builder, target, at), align=4)


@_instructions(
    replace_in_four, signature(types.void, WORDS, types.int64, types.uint32, types.uint32)
)
def _replace_in_four(
    builder: ir.IRBuilder, array: ir.Value, first: ir.Value, old: ir.Value, new: ir.Value
) -> None:
    address = _vector_at(builder, array, first)
    values = builder.load(address, align=4)
    is_old = builder.icmp_unsigned("==", values, _spread(builder, old))
    builder.store(builder.select(is_old, _spread(builder, new), values), address, align=4)


@_instructions(any_of, signature(types.boolean, TRUTHS))
def _any_of(builder: ir.IRBuilder, condition: ir.Value) -> ir.Value:
    bits = ir.IntType(SIZE)
    return builder.icmp_unsigned("!=", builder.bitcast(condition, bits), bits(0))


@_instructions(all_bits, signature(types.int64, INTEGERS))
def _all_bits(builder: ir.IRBuilder, integers: ir.Value) -> ir.Value:
    a, b, c, d = _each(builder, integers)
    return builder.or_(builder.or_(a, b), builder.or_(c, d))


@_instructions(least_of_four, signature(types.float64, FLOATS))
def _least(builder: ir.IRBuilder, values: ir.Value) -> ir.Value:
    for lanes in ([2, 3, 0, 1], [1, 0, 3, 2]):
        values = _smaller(builder, _shuffled(builder, values, values, lanes), values)
    return builder.extract_element(values, WORD(0))
