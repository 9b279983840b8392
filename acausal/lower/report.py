"""Report of the compiler passes: counts after each, and reasons for the choice of states."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from acausal.analyse.analyse import Structure
from acausal.flatten.reduced import ReducedSystem
from acausal.lower.compiled import CompiledModel


@dataclass(frozen=True)
class StageCounts:
    """One pass: counts after it, and the time it took [s]."""

    name: str
    seconds: float
    counts: Mapping[str, int]


@dataclass(frozen=True)
class BlockCount:
    """Number of blocks of one kind and size, and total number of their `iterated` unknowns.

    Kinds are "explicit", "linear", "monotone", "torn" and "dae".
    """

    kind: str
    size: int
    count: int
    iterated: int


@dataclass(frozen=True)
class StateReason:
    """A state, and why it was chosen."""

    name: str
    why: str


ELIMINATIONS = ("alias", "constant", "expression")
"""Ways to eliminate a variable that equals another one up to sign, a constant, or an expression of other variables."""


@dataclass(frozen=True)
class StructureReport:
    """Counts before and after each pass; made by `structure_report`.

    Attributes
    ----------
    stages
        In the order of the pipeline.
    blocks
        Blocks of the solving order by kind and size, the largest first.
    states
        States in the order of x.
    eliminated
        Number of flat scalars by the way they were eliminated.
    differentiated
        Number of equations by how often they were differentiated.
    """

    model: str
    stages: tuple[StageCounts, ...]
    blocks: tuple[BlockCount, ...]
    states: tuple[StateReason, ...]
    eliminated: Mapping[str, int]
    differentiated: Mapping[int, int]

    @property
    def seconds(self) -> float:
        """Time of the whole compilation."""
        return sum(stage.seconds for stage in self.stages)

    def __str__(self) -> str:
        lines = [f"{self.model}: compiled in {1e3 * self.seconds:.3g} ms"]
        lines += [
            f"  {s.name:8} {1e3 * s.seconds:9.3g} ms   {', '.join(f'{n} {k}' for k, n in s.counts.items())}"
            for s in self.stages
        ]
        lines += [
            f"  {b.count} {b.kind} blocks of {b.size}" + (f", {b.iterated} unknowns iterated" if b.iterated else "")
            for b in self.blocks
        ]
        lines += [f"  {n} variables eliminated as {how}" for how, n in self.eliminated.items() if n]
        lines += [f"  {n} equations differentiated {k} times" for k, n in self.differentiated.items()]
        reasons = Counter(s.why for s in self.states)
        lines += [f"  {n} states: {why}" for why, n in reasons.items()]
        return "\n".join(lines)


def structure_report(compiled: CompiledModel) -> StructureReport:
    """Report of a compiled model, from one pass over its variables; nothing is compiled again."""
    structure = compiled.solution.structure
    reduced, timings = structure.reduced, compiled.timings
    ways = Counter(how for _, how in _eliminations(reduced))
    counts = stage_counts(compiled)
    return StructureReport(
        model=compiled.name,
        stages=tuple(StageCounts(name, timings.get(name, 0.0), n) for name, n in counts.items()),
        blocks=_blocks(compiled),
        states=tuple(StateReason(reduced.name(x), state_reason(structure, x)) for x in compiled.state_variables),
        eliminated={how: ways.get(how, 0) for how in ELIMINATIONS},
        differentiated=_orders(structure),
    )


def stage_counts(compiled: CompiledModel) -> dict[str, dict[str, int]]:
    """Counts after each stage, by the name of the stage."""
    solution = compiled.solution
    structure = solution.structure
    reduced, flat = structure.reduced, structure.reduced.flat
    kinds = [b.kind for b in solution.blocks]
    return {
        "flatten": {
            "components": len(flat.components),
            "equations": len(flat.equations),
            "unknowns": flat.n_scalars - len(flat.inputs),
            "parameters": len(flat.parameter_values),
            "inputs": len(flat.inputs),
        },
        "reduce": {
            "equations": len(reduced.residuals),
            "eliminated": flat.n_scalars - len(set(reduced.scalar) & set(range(flat.n_scalars))),
            "redundant": len(reduced.redundant),
        },
        "analyse": {
            "differentiated": len(structure.integral),
            "stabilised": len(structure.invariants),
            "states": len(structure.states),
            "blocks": len(structure.blocks),
            "in the largest block": max((len(b) for b in structure.blocks), default=0),
        },
        "solve": {
            **{f"{kind} blocks": kinds.count(kind) for kind in dict.fromkeys(kinds)},
            "iterated": len(solution.algebraic),
            "observed": max(len(solution.definitions) + len(solution.algebraic) - len(solution.needed), 0),
        },
        "lower": {
            "operations": int(compiled.rhs.n_instructions()),
            "time events": len(compiled.time_events.relations),
            "quadratures": compiled.quadratures,
        },
    }


def state_reason(structure: Structure, state: int) -> str:
    """Why a state was chosen."""
    reduced = structure.reduced
    rate = reduced.pool.derivative_of.get(state)
    scalars = reduced.aliases.get(state, ())
    preferred = any(reduced.flat.declaration(s).prefer_state for s in scalars)
    is_fixed = any(s in reduced.flat.starts and reduced.flat.starts[s].is_fixed for s in scalars)
    if any(state in reduced.pool.variables_in(node) for _, node in structure.invariants):
        return "no choice is safe everywhere: all variables of a stabilised constraint stay states"
    if not any(rate in c.candidates for c in structure.choices):
        return "its derivative occurs in the equations"
    reasons = ["preferred by its declaration"] * preferred + ["its start is fixed"] * is_fixed
    return "chosen: " + (", ".join(reasons) or "no other choice is as safe")


def _eliminations(reduced: ReducedSystem) -> Iterator[tuple[int, str]]:
    """(Flat scalar, how it was eliminated) of all eliminated scalars."""
    nodes = reduced.pool.nodes
    representative = dict(enumerate(reduced.scalar))
    for scalar, node in enumerate(reduced.image):
        inner = nodes[node][1] if nodes[node][0] == "neg" else node
        if nodes[inner][0] == "var":
            if representative.get(nodes[inner][1]) != scalar:
                yield scalar, "alias"
        else:
            yield scalar, "expression" if reduced.pool.variables_in(node) else "constant"


def _blocks(compiled: CompiledModel) -> tuple[BlockCount, ...]:
    count: Counter[tuple[str, int]] = Counter()
    iterated: Counter[tuple[str, int]] = Counter()
    for block in compiled.solution.blocks:
        key = (block.kind, len(block.unknowns))
        count[key] += 1
        iterated[key] += len(block.iterated)
    ordered = sorted(count, key=lambda key: (-key[1], key[0]))
    return tuple(BlockCount(kind, size, count[kind, size], iterated[kind, size]) for kind, size in ordered)


def _orders(structure: Structure) -> dict[int, int]:
    """How many equations of the reduced system were differentiated k times, for each k > 0."""
    highest: Counter[int] = Counter()
    for e in structure.integral:
        order, here = 0, e
        while here in structure.integral:
            here, order = structure.integral[here], order + 1
        highest[here] = max(highest[here], order)
    return dict(sorted(Counter(highest.values()).items()))
