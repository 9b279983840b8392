"""`acausal equations`: the equations of a model after a stage of the compiler."""

from __future__ import annotations

from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Any

import typer

from acausal.cli.arguments import options
from acausal.cli.arguments.reference import find_model
from acausal.cli.arguments.settings import prepare
from acausal.cli.models.names import flat_names
from acausal.cli.output.report import place, record, say
from acausal.errors import counted

if TYPE_CHECKING:
    from acausal.analyse.analyse import Structure
    from acausal.analyse.blocks.solve import Solution
    from acausal.flatten.flat import FlatAssignment, FlatEquation, FlatSystem, FlatWhen
    from acausal.flatten.pool import Pool
    from acausal.flatten.reduced import ReducedSystem
    from acausal.structure import Choice

_COLUMN = 64


class Stage(StrEnum):
    """The stages that can be shown."""

    flat = "flat"
    reduced = "reduced"
    blt = "blt"


def equations(
    model: options.Model,
    stage: Annotated[
        Stage, typer.Option("--stage", help="flat: all equations; reduced: without aliases; blt: in block order.")
    ] = (Stage.flat),
    settings: options.Set = None,
    as_json: options.Json = False,
    quiet: options.Quiet = False,  # only the equations are printed anyway
) -> None:
    """Print the equations of a model after a compiler stage.

    Example: acausal equations Pendulum --stage blt
    """
    from acausal.analyse.aliases import reduce
    from acausal.errors import StructureError
    from acausal.flatten.flatten import flatten
    from acausal.lower.compile import solved

    prepared = prepare(find_model(model), settings or ())
    flat = flatten(prepared.model, prepared.parameters)
    if stage is Stage.flat:
        sections = flat_sections(flat)
    else:
        hidden: dict[int, int] = {}
        try:
            solution = solved(flat, hidden=hidden)
        except StructureError:
            if stage is Stage.reduced and not as_json:  # a refused model is diagnosed from the remaining equations
                _print(reduced_sections(reduce(flat)))
            raise
        structure = solution.structure
        if stage is Stage.reduced:
            sections = (
                reduced_sections(structure.reduced) | hidden_sections(flat, hidden) | structure_sections(structure)
            )
        else:
            sections = block_sections(solution)
    if as_json:
        record({"model": flat.name, "stage": stage.value, **sections})
    else:
        _print(sections)


Sections = dict[str, list[dict[str, Any]]]


def flat_sections(flat: FlatSystem) -> Sections:
    """Every equation with its component and position in the source."""
    names = flat_names(flat)

    def shown(listed: tuple[FlatEquation, ...]) -> list[dict[str, Any]]:
        return [_entry(_equality(flat.pool, e.left, e.right, names), e) for e in listed]

    sections = {"equations": shown(flat.equations)}
    if flat.assignments:
        sections["discrete equations"] = [_entry(flat.text(a), a) for a in flat.assignments]
    if flat.whens:
        sections["events"] = [_entry(str(w.source), w) for w in flat.whens]
    if flat.initial_equations:
        sections["initial equations"] = shown(flat.initial_equations)
    return sections


def _entry(text: str, equation: FlatEquation | FlatAssignment | FlatWhen | None) -> dict[str, Any]:
    if equation is None:
        return {"text": text}
    where = place(equation.origin.span()) if equation.origin is not None else ""
    return {"text": text, "component": equation.component, "place": where}


def _equality(pool: Pool, left: int, right: int, names: Any) -> str:
    from acausal.flatten.text import to_text

    return f"{to_text(pool, left, names)} == {to_text(pool, right, names)}"


def _residual(pool: Pool, node: int, names: Any) -> str:
    """A residual as an equation: the operands of its last difference become the two sides."""
    op, *rest = pool.nodes[node]
    if op == "sub":
        return _equality(pool, rest[0], rest[1], names)
    return _equality(pool, node, pool.zero, names)


def reduced_sections(reduced: ReducedSystem) -> Sections:
    """Remaining equations, aliases by representative, eliminated constants, and equations that follow from others."""
    flat, pool, names = reduced.flat, reduced.pool, reduced.leaf_name
    remaining = [
        _entry(_residual(pool, r, names), flat.equations[k])
        for r, k in zip(reduced.residuals, reduced.equation, strict=True)
    ]
    aliases = []
    for variable, scalars in reduced.aliases.items():
        own = reduced.name(variable)
        others = [
            ("-" if pool.nodes[reduced.image[s]][0] == "neg" else "") + flat.scalar_name(s)
            for s in scalars
            if flat.scalar_name(s) != own
        ]
        if others:
            aliases.append({"text": f"{own} = {', '.join(others)}"})
    known = []
    for scalar, node in enumerate(reduced.image):
        inner = pool.nodes[node][1] if pool.nodes[node][0] == "neg" else node
        if pool.nodes[inner][0] != "var":
            known.append({"text": f"{flat.scalar_name(scalar)} = {reduced.text(node, 200)}"})
    redundant = [
        _entry(flat.text(flat.equations[k]), flat.equations[k]) for k in reduced.redundant if k < len(flat.equations)
    ]
    sections = {
        "remaining equations": remaining,
        "aliases": aliases,
        "known expressions": known,
        "redundant": redundant,
    }
    return {title: entries for title, entries in sections.items() if entries}


def hidden_sections(flat: FlatSystem, hidden: dict[int, int]) -> Sections:
    """Constraints that equations imply together, each with the equation that it replaces."""
    names = flat_names(flat)
    found = [_entry(_residual(flat.pool, node, names), flat.equations[k]) for k, node in hidden.items()]
    for entry, k in zip(found, hidden, strict=True):
        entry["why"] = f"in place of {flat.text(flat.equations[k])}"
    return {"constraints that equations hide": found} if found else {}


def structure_sections(structure: Structure) -> Sections:
    """Differentiated equations, and states with the reasons for their choice."""
    from acausal.lower.report import state_reason

    reduced = structure.reduced
    names = reduced.leaf_name
    flat = reduced.flat
    differentiated = [
        _entry(_residual(reduced.pool, structure.residuals[new], names), flat.equations[structure.flat_equation(new)])
        for new in structure.integral
    ]
    states = [{"text": reduced.name(x), "why": state_reason(structure, x)} for x in structure.states]
    choices = [{"text": _choice(reduced, c), "why": counted(len(c.equations), "constraint")} for c in structure.choices]
    kept = [
        _entry(_residual(reduced.pool, node, names), flat.equations[structure.flat_equation(e)])
        for e, node in structure.invariants
    ]
    sections = {
        "differentiated equations": differentiated,
        "states": states,
        "choices of states": choices,
        "constraints kept by stabilisation": kept,
    }
    return {title: entries for title, entries in sections.items() if entries}


def _choice(reduced: ReducedSystem, choice: Choice) -> str:
    """The decision about the derivatives in some constraints."""
    parts = []
    integral = reduced.pool.integral_of
    if choice.dummies:
        given = tuple(integral[v] for v in choice.dummies)
        parts.append(f"{_listed(reduced, given)} from the constraint" + ("s" if len(given) > 1 else ""))
    kept = tuple(integral[v] for v in choice.candidates if v not in choice.dummies)
    if kept:
        parts.append(f"{_listed(reduced, kept)} integrated")
    if choice.floating:
        parts.append(f"{counted(len(choice.floating), 'constraint')} without a choice that is valid everywhere")
    return "; ".join(parts)


def _listed(reduced: ReducedSystem, variables: tuple[int, ...], limit: int = 12) -> str:
    shown = [reduced.name(v) for v in variables[:limit]]
    return ", ".join(shown) + (f" and {len(variables) - limit} more" if len(variables) > limit else "")


def block_sections(solution: Solution) -> Sections:
    """Blocks in the order in which they are solved."""
    structure = solution.structure
    reduced = structure.reduced
    names = reduced.leaf_name
    node_of = dict(solution.definitions)
    order = {v: k for k, (v, _) in enumerate(solution.definitions)}
    residuals = iter(solution.residuals)
    found: list[dict[str, Any]] = []
    for number, report in enumerate(solution.blocks, 1):
        size = len(report.unknowns)
        head = f"block {number}: {report.kind}" + (f", {size} unknowns" if size > 1 else "")
        lines = [
            f"{reduced.name(v)} = {reduced.text(node_of[v], 400)}"
            for v in sorted((u for u in report.unknowns if u in node_of), key=order.__getitem__)
        ]
        if report.iterated:
            lines.append(f"iterate {_listed(reduced, report.iterated)} until")
            lines += [f"    {_residual(reduced.pool, next(residuals), names)}" for _ in report.iterated]
        observed = all(v not in solution.needed for v in report.unknowns)
        found.append({"text": head, "lines": lines, "observed": observed})
    return {"states": [{"text": reduced.name(x)} for x in structure.states], "blocks": found}


def _print(sections: Sections) -> None:
    for title, entries in sections.items():
        say(f"{title} ({len(entries)})")
        width = min(max((len(e["text"]) for e in entries), default=0), _COLUMN)
        for e in entries:
            origin = "  ".join(x for x in (e.get("component", ""), e.get("place", ""), e.get("why", "")) if x)
            mark = "   (observed)" if e.get("observed") else ""
            say(f"  {e['text'].ljust(width)}   # {origin}" if origin else f"  {e['text']}{mark}")
            for line in e.get("lines", ()):
                say(f"      {line}")
        say()
