"""Pass a NamedTuple of arrays to a kernel as one pointer.

Numba passes a NamedTuple field by field, and an array as seven words: a workspace of twenty arrays was some 180
arguments of every kernel, and packing and unpacking them took most of the compile time. A NamedTuple declared with
`by_reference` is passed as the address of a struct instead; a nested one is part of the same struct. Without Numba's
compiler (NUMBA_DISABLE_JIT) kernels get the NamedTuple itself.

An entry point first makes a `local_copy`. As all kernels are inlined into it, the compiler can then keep the fields in
registers; otherwise it would have to reload an array's address after every store.
"""

import hashlib
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import numba
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.imputils import impl_ret_borrowed
from numba.core.typing.templates import AttributeTemplate
from numba.extending import (
    NativeValue,
    infer_getattr,
    intrinsic,
    lower_getattr_generic,
    models,
    register_model,
    typeof_impl,
    unbox,
)

Record = TypeVar("Record", bound=NamedTuple)


class Reference(types.Type):
    """The Numba type of a reference to a record: the record's name, and (name, type) of each field."""

    def __init__(self, record: str, fields: tuple[tuple[str, types.Type], ...]) -> None:
        self.record, self.fields = record, fields
        text = ", ".join(f"{name}: {kind}" for name, kind in fields)
        # Numba makes the name part of every function's name, and hashes and compares types by it thousands of times:
        # it is short, and different for different fields.
        super().__init__(f"{record}.{hashlib.sha256(text.encode()).hexdigest()[:16]}")


def by_reference(record: type[Record]) -> type[Record]:
    """Declare that kernels take a NamedTuple by reference.

    The type of every field is taken from its value, whatever the annotation says. A field may be None; where it is
    passed on as an argument, Numba prunes branches on `is None` at compile time.
    """

    @typeof_impl.register(record)
    def reference_to(value: NamedTuple, _: object) -> Reference:
        return Reference(record.__name__, tuple((name, numba.typeof(getattr(value, name))) for name in record._fields))

    return record


def local_copy(record: Record) -> Record:
    """Return a copy of a record, not of its arrays, in the memory of the calling kernel."""
    return record


def _struct(manager: Any, reference: Reference) -> ir.LiteralStructType:
    """Return the LLVM struct type of a record."""
    layouts = [
        _struct(manager, kind) if isinstance(kind, Reference) else manager.lookup(kind).get_value_type()
        for _, kind in reference.fields
    ]
    return ir.LiteralStructType(layouts)


@register_model(Reference)
class _ReferenceModel(models.PrimitiveModel):
    def __init__(self, manager: Any, reference: Reference) -> None:
        super().__init__(manager, reference, _struct(manager, reference).as_pointer())


@infer_getattr
class _Fields(AttributeTemplate):
    key = Reference

    def generic_resolve(self, reference: Reference, name: str) -> types.Type | None:  # type: ignore[override]
        return dict(reference.fields).get(name)


@lower_getattr_generic(Reference)
def _read_field(context: Any, builder: ir.IRBuilder, reference: Reference, pointer: ir.Value, name: str) -> ir.Value:
    number = [field for field, _ in reference.fields].index(name)
    kind = reference.fields[number][1]
    address = cgutils.gep_inbounds(builder, pointer, 0, number)
    if isinstance(kind, Reference):
        return address
    return impl_ret_borrowed(context, builder, kind, builder.load(address))


@unbox(Reference)
def _from_python(reference: Reference, value: ir.Value, c: Any) -> NativeValue:
    """Fill a struct from the NamedTuple that Python passes."""
    pointer = cgutils.alloca_once(c.builder, c.context.get_value_type(reference).pointee)
    failed, taken = cgutils.alloca_once_value(c.builder, cgutils.false_bit), list[tuple[types.Type, ir.Value]]()
    _fill(c, reference, value, pointer, failed, taken)

    def release() -> None:
        for kind, native in taken:
            c.context.nrt.decref(c.builder, kind, native)

    return NativeValue(pointer, is_error=c.builder.load(failed), cleanup=release if c.context.enable_nrt else None)


def _fill(c: Any, reference: Reference, value: ir.Value, pointer: ir.Value, failed: ir.Value, taken: list) -> None:
    """Store the fields in the struct, and append (type, value) of each to `taken`, to be released after the call."""
    for number, (_, kind) in enumerate(reference.fields):
        item, address = c.pyapi.tuple_getitem(value, number), cgutils.gep_inbounds(c.builder, pointer, 0, number)
        if isinstance(kind, Reference):
            _fill(c, kind, item, address, failed, taken)
        else:
            native = c.unbox(kind, item)
            taken.append((kind, native.value))
            c.builder.store(native.value, address)
            c.builder.store(c.builder.or_(c.builder.load(failed), native.is_error), failed)


if not numba.config.DISABLE_JIT:  # type: ignore[attr-defined]  # Numba sets it from the environment

    @intrinsic
    def local_copy(typing: Any, record: Reference) -> tuple[Any, Callable]:
        """Compile to a copy in the memory of the entry point's call."""

        def code(context: Any, builder: ir.IRBuilder, signature: Any, arguments: list[ir.Value]) -> ir.Value:
            (pointer,) = arguments
            copy = cgutils.alloca_once(builder, pointer.type.pointee)
            builder.store(builder.load(pointer), copy)
            return copy

        return record(record), code
