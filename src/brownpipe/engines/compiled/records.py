"""Pass a NamedTuple of arrays to a kernel as one pointer.

Numba passes a NamedTuple field by field, and an array as seven words: a workspace of twenty arrays
was some 180 arguments of every kernel, and packing and unpacking them took most of the compile
time. A NamedTuple declared with `by_reference` is passed as the address of a struct instead; a
nested one is part of the same struct. Without Numba's compiler (NUMBA_DISABLE_JIT) kernels get the
NamedTuple itself.

An entry point first makes a `local_copy`. As all kernels are inlined into it, the compiler can then
keep the fields in registers; otherwise it would have to reload an array's address after every
store.
"""

import hashlib
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.cpu import CPUContext
from numba.core.datamodel import DataModelManager
from numba.core.imputils import impl_ret_borrowed
from numba.core.typing import Context
from numba.core.typing.templates import AttributeTemplate, Signature
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

if TYPE_CHECKING:
    from numba.core.pythonapi import _UnboxContext as UnboxContext

Record = TypeVar("Record", bound=NamedTuple)


class Reference(types.Type):
    """The Numba type of a reference to a record: its struct, that of a NamedTuple, and the type of
    each field.
    """

    def __init__(self, record: type[NamedTuple], kinds: Sequence[types.Type]) -> None:
        self.fields = dict(zip(record._fields, kinds, strict=True))
        structs = [kind.struct if isinstance(kind, Reference) else kind for kind in kinds]
        self.struct: types.NamedTuple = types.NamedTuple(structs, record)
        # Numba makes the name part of every function's name, and hashes and compares types by it
        # thousands of times: it is short, and different for different fields.
        digest = hashlib.sha256(str(self.struct).encode()).hexdigest()
        super().__init__(f"{record.__name__}.{digest[:16]}")


def by_reference(record: type[Record]) -> type[Record]:
    """Declare that kernels take a NamedTuple by reference.

    The type of every field is taken from its value, whatever the annotation says. A field may be
    None; where it is passed on as an argument, Numba prunes branches on `is None` at compile time.
    """

    @typeof_impl.register(record)
    def reference_to(value: NamedTuple, _: object) -> Reference:
        return Reference(record, [numba.typeof(field) for field in value])

    return record


def local_copy(record: Record) -> Record:
    """Return a copy of a record, not of its arrays, in the memory of the calling kernel."""
    return record


@register_model(Reference)
class _ReferenceModel(models.PrimitiveModel):
    def __init__(self, manager: DataModelManager, reference: Reference) -> None:
        super().__init__(
            manager, reference, manager.lookup(reference.struct).get_value_type().as_pointer()
        )


@infer_getattr
class _Fields(AttributeTemplate):
    key = Reference

    def generic_resolve(self, reference: Reference, name: str) -> types.Type | None:  # type: ignore[override]
        return reference.fields.get(name)


@lower_getattr_generic(Reference)
def _read_field(
    context: CPUContext, builder: ir.IRBuilder, reference: Reference, pointer: ir.Value, name: str
) -> ir.Value:
    kind = reference.fields[name]
    address = cgutils.gep_inbounds(builder, pointer, 0, [*reference.fields].index(name))
    if isinstance(kind, Reference):
        return address
    return impl_ret_borrowed(context, builder, kind, builder.load(address))


@unbox(Reference)
def _from_python(reference: Reference, value: ir.Value, c: "UnboxContext") -> NativeValue:
    """Store the NamedTuple that Python passes in a struct."""
    struct = c.unbox(reference.struct, value)
    pointer = cgutils.alloca_once_value(c.builder, struct.value)

    def release() -> None:
        c.context.nrt.decref(c.builder, reference.struct, struct.value)

    return NativeValue(
        pointer, is_error=struct.is_error, cleanup=release if c.context.enable_nrt else None
    )


if not numba.config.DISABLE_JIT:  # type: ignore[attr-defined]  # Numba sets it from the environment

    @intrinsic
    def local_copy(typing: Context, record: Reference) -> tuple[Signature, Callable]:
        """Compile to a copy in the memory of the entry point's call."""

        def code(
            context: CPUContext,
            builder: ir.IRBuilder,
            signature: Signature,
            arguments: list[ir.Value],
        ) -> ir.Value:
            (pointer,) = arguments
            copy = cgutils.alloca_once(builder, pointer.type.pointee)
            builder.store(builder.load(pointer), copy)
            return copy

        return record(record), code


@by_reference
class SampleArrays(NamedTuple):
    """Samples of M disks at T times, as kernels write them."""

    position: np.ndarray  # (T, M, 2) float64
    velocity: np.ndarray  # (T, M, 2) float64
    image: np.ndarray  # (T, M, 2) int32
