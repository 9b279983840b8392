"""External functions, computed outside the language and called in its equations.

The language knows their name, the shapes and units of their inputs and outputs, and a factory. The factory is called
when the model is lowered and returns a CasADi Function, so that only the module that defines it needs CasADi.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

from acausal.errors import DeclarationError
from acausal.language.expressions.expression import Operand, Operation, Shape, as_expr, shape_text


class External:
    """A function with several inputs and outputs that are scalars, vectors or matrices.

        distance = External("distance", make, inputs=((3,), (3,)), outputs=((), (3,)), units=("m", "1"))
        length, direction = distance(frame_a.r_0, frame_b.r_0)

    Called with expressions, it returns a tuple of one expression per output, or the expression itself if there is only
    one output.
    A run knows only the values of a function at the points where it evaluates it: a change that comes and goes within a
    step is overlooked, unless `simulate(max_step=...)` is short enough. A kink that is written as `maximum` of two
    outputs is located.
    Two objects are two functions even if they compute the same: create one and reuse it.

    Parameters
    ----------
    name
        Shown in equations and messages.
    factory
        Takes no arguments and returns a `casadi.Function` with these inputs and outputs; called once, so that a file it
        reads is read once. A function of SX is expanded
        into the equations; one made with the option `never_inline` remains one call, in generated C as well.
    inputs, outputs
        Shapes: `()`, `(n,)` or `(m, n)`.
    units
        Units of the outputs, for the check of dimensions; "" adapts.
    jumps
        Whether outputs may jump, like the distance along a ray where the ray leaves a body. Kinks between such outputs,
        `maximum(f(x), g(x))`, are left to error control; all other kinks between outputs are located.

    Raises
    ------
    DeclarationError
        AC161 when the numbers of units and outputs differ, or a shape is invalid.
    """

    def __init__(
        self,
        name: str,
        factory: Callable[[], Any],
        *,
        inputs: Sequence[Shape],
        outputs: Sequence[Shape],
        units: Sequence[str] = (),
        jumps: bool = False,
    ) -> None:
        self.name = name
        self.jumps = jumps
        self.factory = factory
        self.units = tuple(units) or ("",) * len(outputs)
        self.primal: External | None = None  # the function whose partial derivatives this one computes
        self._partials: External | None = None
        if len(self.units) != len(outputs) or not all(map(_is_shape, (*inputs, *outputs))):
            raise DeclarationError(
                "AC161",
                f"the external function {name} is declared with {len(outputs)} outputs, "
                f"{len(self.units)} units and shapes {tuple(inputs)} -> {tuple(outputs)}",
                help="shapes are (), (n,) or (m, n); give one unit for every output, or none at all",
            )
        self.inputs = tuple(map(tuple, inputs))
        self.outputs = tuple(map(tuple, outputs))

    def __repr__(self) -> str:
        return f"External({self.name}: {', '.join(map(shape_text, self.inputs))})"

    def __call__(self, *arguments: Operand) -> Any:
        """The outputs as expressions; AC162 when the arguments do not fit."""
        given = tuple(map(as_expr, arguments))
        if [e.shape for e in given] != list(self.inputs):
            raise DeclarationError(
                "AC162",
                f"{self.name} takes {len(self.inputs)} arguments: {', '.join(map(shape_text, self.inputs))}",
                evidence=[f"given: {', '.join(f'`{e}` ({shape_text(e.shape)})' for e in given) or 'none'}"],
            )
        results = [Operation("call", given, shape, (self, k)) for k, shape in enumerate(self.outputs)]
        return results[0] if len(results) == 1 else tuple(results)

    @property
    def partials(self) -> External:
        """The function whose output is the Jacobian matrix, shape (scalar outputs, scalar inputs), both row-major."""
        if self._partials is None:
            shape = (_scalars(self), self.size)
            name = f"d{self.name}"
            # Derivatives jump where the function has a kink.
            self._partials = External(name, self.factory, inputs=self.inputs, outputs=(shape,), jumps=True)
            self._partials.primal = self
        return self._partials

    @property
    def size(self) -> int:
        """Number of scalars in all inputs."""
        return sum(map(math.prod, self.inputs))

    def entries(self, output: int) -> range:
        """Indices of the scalars of one output among those of all outputs, row-major."""
        first = sum(math.prod(s) for s in self.outputs[:output])
        return range(first, first + math.prod(self.outputs[output]))


class Call(str):
    """Operation of a scalar pool node: one scalar output of an external function.

    A string, like all operations; two are equal if they are the same scalar of the same function.
    """

    external: External
    entry: int

    def __new__(cls, external: External, entry: int) -> Call:
        operation = super().__new__(cls, f"{external.name}[{entry}]" if _scalars(external) > 1 else external.name)
        operation.external = external
        operation.entry = entry
        return operation

    def __reduce__(self) -> tuple[type[Call], tuple[External, int]]:
        return Call, (self.external, self.entry)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Call) and self.external is other.external and self.entry == other.entry

    def __ne__(self, other: object) -> bool:
        return not self == other

    def __hash__(self) -> int:
        return hash((id(self.external), self.entry))


def _is_shape(given: object) -> bool:
    return isinstance(given, tuple | list) and len(given) <= 2 and all(isinstance(n, int) and n > 0 for n in given)


def _scalars(external: External) -> int:
    return sum(map(math.prod, external.outputs))
