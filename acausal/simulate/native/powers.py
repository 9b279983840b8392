"""Powers and extrema in generated functions: a power law and its slope take one call of `pow`, extrema take none.

The slope of x**a is a x**(a - 1), and CasADi writes both as calls of `pow`. In the Newton steps for a power law, as
of a cutting force, they are half of the time. The second power follows from the first one by a division, as long
as the exponents differ by one, which is a matter of the parameters and is tested when the code runs.

`fmax` and `fmin` of the C library are calls, too: compilers write them in line only if nothing can be nan.
"""

from __future__ import annotations

import re

_POWER = re.compile(r"  (a\d+)=pow\((a\d+),(a\d+)\);")
_ASSIGNED = re.compile(r"  (a\d+)=")

_HELPER = """/* x**y, from `known` = x**other if the exponents differ by one; not near the limits of numbers. */
static casadi_real power_of(casadi_real x, casadi_real y, casadi_real other, casadi_real known) {
  if (fabs(known) > 1e-280 && fabs(known) < 1e280) {
    if (y == other - 1) return known / x;
    if (y == other + 1) return known * x;
  }
  return pow(x, y);
}

"""
# As in the C library, the result is the other number if one of them is nan.
_EXTREMA = (("fmax(x, y)", "x >= y || y != y ? x : y"), ("fmin(x, y)", "x <= y || y != y ? x : y"))
# Long functions are cut into pieces, which stand before them.
_FIRST = re.compile(r"(?m)^(?=(?:/\* \w+:.*\*/\n)?static (?:int|__attribute__\(\(noinline\)\) void) casadi_f\d+)")


def with_own_functions(source: str) -> str:
    """Write the functions out that the code calls: extrema, and powers that `with_shared_powers` has changed."""
    for call, own in _EXTREMA:
        source = source.replace(f"  return {call};", f"  return {own};")
    return _FIRST.sub(lambda _: _HELPER, source, count=1) if "=power_of(" in source else source


def with_shared_powers(body: str) -> str:
    """Let the powers of a number in the body of a function use the power before of that number."""
    lines = body.split("\n")
    pairs = _pairs(lines)
    if not pairs:
        return body
    numbers = [name for line in lines for name in _ASSIGNED.findall(line)]
    unused = 1 + max(int(name[1:]) for name in numbers)
    kept = {k: f"a{unused + i}" for i, k in enumerate(sorted(set(pairs.values())))}
    written: list[str] = []
    for k, line in enumerate(lines):
        power = _POWER.fullmatch(line)
        if power is None or not (k in kept or k in pairs):
            written.append(line)
            continue
        target, base, exponent = power.groups()
        value = f"pow({base},{exponent})"
        if k in pairs:
            before = _POWER.fullmatch(lines[pairs[k]])
            assert before is not None, "only powers are paired"
            value = f"power_of({base},{exponent},{before[3]},{kept[pairs[k]]})"
        written += [f"  {kept[k]}={value};", f"  {target}={kept[k]};"] if k in kept else [f"  {target}={value};"]
    return "\n".join((f"  casadi_real {', '.join(kept.values())};", *written))


def _pairs(lines: list[str]) -> dict[int, int]:
    """For a line with a power, the last line before with a power of the same number whose exponent is still known."""
    changes: dict[str, int] = {}  # the line that assigned each variable last
    last: dict[tuple[str, int], int] = {}
    pairs: dict[int, int] = {}
    for k, line in enumerate(lines):
        power = _POWER.fullmatch(line)
        if power is not None:
            _, base, exponent = power.groups()
            number = base, changes.get(base, -1)
            before = last.get(number)
            if before is not None:
                other = _POWER.fullmatch(lines[before])
                assert other is not None, "only powers are remembered"
                if other[3] != exponent and changes.get(other[3], -1) < before:
                    pairs[k] = before
            last[number] = k
        assigned = _ASSIGNED.match(line)
        if assigned is not None:
            changes[assigned[1]] = k
    return pairs
