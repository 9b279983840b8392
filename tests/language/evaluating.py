"""Values of language expressions, by way of the pool and numpy: for tests without a compiler or a solver."""

from __future__ import annotations

from collections.abc import Mapping

from acausal import Expr
from acausal.flatten.pool import Pool
from acausal.flatten.scalars.scalarise import scalars
from acausal.language.expressions.expression import Symbol, symbols_in
from acausal.numeric.evaluate import values


def value(e: Expr, given: Mapping[str, float]) -> float:
    """Value of a scalar expression; `given` holds its symbols by name, and `time`."""
    pool = Pool()
    number = {s.name: pool.new_variables(1) for s in symbols_in(e)}

    def resolve(symbol: Symbol) -> tuple[int, ...]:
        return (pool.var(number[symbol.name]),)

    node = scalars(pool, e, resolve, {})[0]
    by_number = {k: given[name] for name, k in number.items()}
    found = values(pool, [node], {"var": by_number.__getitem__, "time": lambda _: given.get("time", 0.0)})
    return float(found[node])
