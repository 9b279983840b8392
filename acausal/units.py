"""Unit strings: parsing, comparison, conversion and printing.

`parse` reads Modelica's spelling (`N.m/rad`, `kg/(m.s2)`, `s-1`) and the usual Python one (`N*m`, `m^2`, `m**2`).
SI units with their prefixes and common engineering units are defined here, so that a model needs no unit package; any
other name is looked up in pint, which is loaded only then.

A dimension is a tuple of the seven exponents of (m, kg, s, A, K, mol, cd). Angles, turns and ratios are dimensionless,
as in the SI brochure (9th edition, table 4), so that N.m and N.m/rad, or 1/s and rad/s, agree. Nevertheless values are
not converted between Hz and rad/s, because numbers of cycles and of radians differ by 2 pi (`ambiguous`).
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from fractions import Fraction
from functools import cache, lru_cache
from typing import TypeAlias

from acausal.errors import UnitError, nearest

Dimension: TypeAlias = tuple[Fraction | int, ...]
"""Exponents of m, kg, s, A, K, mol, cd."""
Scale: TypeAlias = Fraction | float
"""Rational if possible: 9 mm is 0.009, not 0.009000000000000001."""

DIMENSIONLESS: Dimension = (0, 0, 0, 0, 0, 0, 0)
LENGTH: Dimension = (1, 0, 0, 0, 0, 0, 0)
MASS: Dimension = (0, 1, 0, 0, 0, 0, 0)
TIME: Dimension = (0, 0, 1, 0, 0, 0, 0)
CURRENT: Dimension = (0, 0, 0, 1, 0, 0, 0)
TEMPERATURE: Dimension = (0, 0, 0, 0, 1, 0, 0)
AMOUNT: Dimension = (0, 0, 0, 0, 0, 1, 0)
LUMINOUS_INTENSITY: Dimension = (0, 0, 0, 0, 0, 0, 1)

_PREFIXES = {
    **{"Q": 30, "R": 27, "Y": 24, "Z": 21, "E": 18, "P": 15, "T": 12, "G": 9, "M": 6, "k": 3, "h": 2, "da": 1},
    **{"d": -1, "c": -2, "m": -3, "u": -6, "\u00b5": -6, "\u03bc": -6, "n": -9, "p": -12, "f": -15, "a": -18},
    **{"z": -21, "y": -24, "r": -27, "q": -30},
}

# g, not kg, carries the prefixes; kg is k + g.
_SI: dict[str, tuple[Dimension, Fraction]] = {
    "m": (LENGTH, Fraction(1)),
    "g": (MASS, Fraction(1, 1000)),
    "s": (TIME, Fraction(1)),
    "A": (CURRENT, Fraction(1)),
    "K": (TEMPERATURE, Fraction(1)),
    "mol": (AMOUNT, Fraction(1)),
    "cd": (LUMINOUS_INTENSITY, Fraction(1)),
    "rad": (DIMENSIONLESS, Fraction(1)),
    "sr": (DIMENSIONLESS, Fraction(1)),
}

_WITH_PREFIX: dict[str, tuple[Scale, str]] = {
    "Hz": (1, "1/s"),
    "N": (1, "kg.m/s2"),
    "Pa": (1, "N/m2"),
    "J": (1, "N.m"),
    "W": (1, "J/s"),
    "C": (1, "A.s"),
    "V": (1, "W/A"),
    "F": (1, "C/V"),
    "Ohm": (1, "V/A"),
    "ohm": (1, "V/A"),
    "\u03a9": (1, "V/A"),
    "\u2126": (1, "V/A"),
    "S": (1, "A/V"),
    "Wb": (1, "V.s"),
    "T": (1, "Wb/m2"),
    "H": (1, "Wb/A"),
    "lm": (1, "cd.sr"),
    "lx": (1, "lm/m2"),
    "Bq": (1, "1/s"),
    "Gy": (1, "J/kg"),
    "Sv": (1, "J/kg"),
    "kat": (1, "mol/s"),
    "l": (Fraction(1, 1000), "m3"),
    "L": (Fraction(1, 1000), "m3"),
    "t": (1000, "kg"),
    "bar": (100000, "Pa"),
    "eV": (Fraction("1.602176634e-19"), "J"),
    "cal": (Fraction("4.184"), "J"),
    "VA": (1, "W"),
    "var": (1, "W"),
    "Wh": (3600, "J"),
}

_WITHOUT_PREFIX: dict[str, tuple[Scale, str]] = {
    "min": (60, "s"),
    "h": (3600, "s"),
    "d": (86400, "s"),
    "deg": (math.pi / 180.0, "rad"),
    "\u00b0": (math.pi / 180.0, "rad"),
    "rev": (2.0 * math.pi, "rad"),
    "cycle": (2.0 * math.pi, "rad"),
    "rpm": (2.0 * math.pi / 60.0, "rad/s"),
    "%": (Fraction(1, 100), "1"),
    "ppm": (Fraction(1, 1000000), "1"),
    "in": (Fraction("0.0254"), "m"),
    "inch": (Fraction("0.0254"), "m"),
    "ft": (Fraction("0.3048"), "m"),
    "mi": (Fraction("1609.344"), "m"),
    "lb": (Fraction("0.45359237"), "kg"),
    "kgf": (Fraction("9.80665"), "N"),
    "lbf": (Fraction("0.45359237") * Fraction("9.80665"), "N"),
    "psi": (1, "lbf/in2"),
    "atm": (101325, "Pa"),
    "hp": (550, "lbf.ft/s"),
    "ha": (10000, "m2"),
}

# name: (K per degree, K at zero degrees)
_WITH_OFFSET: dict[str, tuple[Fraction, Fraction]] = {
    "degC": (Fraction(1), Fraction("273.15")),
    "\u00b0C": (Fraction(1), Fraction("273.15")),
    "degF": (Fraction(5, 9), Fraction("459.67") * Fraction(5, 9)),
    "\u00b0F": (Fraction(5, 9), Fraction("459.67") * Fraction(5, 9)),
}

# Names that `format_dimension` prefers; N.m also stands for J, because torques are more common here.
_FRIENDLY = "N N.m W Pa Pa.s N/m C V Ohm F S Wb H T J/(kg.K) W/K W/(m.K)"

# Examples for error messages, the most common first.
_EXAMPLES = (
    "mm um in g t ms min h deg rev rpm Hz kN MPa bar kW N/mm N/mm2 kJ degC mm/s mm/min mm2 l mA mV kohm uF mH % g/mm3"
)

_SPELLING = "write units as in Modelica: N.m, kg/(m.s2), m/s2, 1/s, mm, kN, deg, degC"
_ANGLES = re.compile(r"\b(deg|degree|degrees|rev|cycle|turn)\b")
_ANGULAR = re.compile(
    r"[munkM\u00b5\u03bc]?rad|radians?|deg|degrees?|\u00b0|revs?|revolutions?|cycles?|turns?|rpm|grad|gon|arcmin|arcsec"
)
_SUPERSCRIPTS = str.maketrans(
    "\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079\u207b\u00b7\u22c5\u2212", "0123456789-..-"
)
_NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?inf(?![a-zA-Z]))\s*(.*)", re.DOTALL)
_MAX_LENGTH = 200
_MAX_EXPONENT = 99


@dataclass(frozen=True)
class Unit:
    """A unit as written, its dimension, and its conversion to the coherent SI unit of that dimension."""

    text: str  # the unit as the user wrote it
    dimension: Dimension  # exponents of (m, kg, s, A, K, mol, cd)
    # Value in SI = factor * value + offset; the offset is nonzero only for a temperature scale by itself.
    factor: float
    offset: float = 0.0
    exact: Fraction | None = None  # the factor as a rational number, or None if it contains pi or a root


# Cached: called for every operation of every equation, nearly always with the same few dimensions.
@lru_cache(maxsize=10_000)
def multiply(a: Dimension, b: Dimension) -> Dimension:
    """Dimension of a product."""
    return tuple(_whole(p + q) for p, q in zip(a, b, strict=True))


@lru_cache(maxsize=10_000)
def divide(a: Dimension, b: Dimension) -> Dimension:
    """Dimension of a quotient."""
    return tuple(_whole(p - q) for p, q in zip(a, b, strict=True))


@lru_cache(maxsize=10_000)
def power(a: Dimension, exponent: Fraction | int) -> Dimension:
    """Dimension of a power; roots give fractions."""
    return tuple(_whole(p * exponent) for p in a)


def _whole(exponent: Fraction | int) -> Fraction | int:
    # Adding integers is ten times faster than adding fractions, and nearly all exponents are integers.
    return exponent.numerator if exponent.denominator == 1 else exponent


@cache
def parse(unit: str) -> Unit:
    """Read a unit string; the empty string and "1" are dimensionless.

    A product after a division (`J/kg.K`) is refused: Modelica forbids it, and by the rules of Python it would mean
    (J/kg).K, whereas most people mean J/(kg.K).

    Raises UnitError: AC150 when a name is unknown (the nearest known ones are listed) or the string cannot be read.
    """
    text = unit.strip().translate(_SUPERSCRIPTS)
    if len(text) > _MAX_LENGTH:
        raise UnitError("AC150", f"a unit of {len(text)} characters cannot be read", help=_SPELLING)
    if text in _WITH_OFFSET:
        degree, offset = _WITH_OFFSET[text]
        return Unit(unit, TEMPERATURE, float(degree), float(offset), degree)
    if not text:
        return Unit(unit, DIMENSIONLESS, 1.0, 0.0, Fraction(1))
    if not _is_own(text) and re.fullmatch(r"[^\W\d]+", text):
        return _from_pint(text, unit)
    dimension, scale = _Reader(text).read()
    return Unit(unit, dimension, float(scale), 0.0, scale if isinstance(scale, Fraction) else None)


def declared(unit: str) -> Unit:
    """The unit of a declaration, which must be a coherent SI unit.

    Raises UnitError: AC150 as `parse`, with advice that a declaration accepts, AC153 for a unit that has a factor or an
    offset.
    """
    try:
        parsed = parse(unit)
    except UnitError as error:
        if error.help and error.help.endswith(_SPELLING):
            close = [n for n in _candidates(unit.strip()) if ("." in n or _is_own(n)) and is_coherent(n)]
            did_you_mean = f"did you mean {' or '.join(close)}? " if close else ""
            error.help = did_you_mean + "declare in SI, as in Modelica: N.m, kg/(m.s2), m/s2, 1/s, rad, K"
        raise
    if math.isclose(parsed.factor, 1.0, rel_tol=1e-12) and not parsed.offset:
        return parsed
    angular = _ANGLES.sub("rad", unit.replace("rpm", "rad/s"))
    coherent = angular if angular != unit and is_coherent(angular) else format_dimension(parsed.dimension)
    zero = f"0 {unit} = {parsed.offset:g} {coherent}, " if parsed.offset else ""
    raise UnitError(
        "AC153",
        f"declared unit '{unit}' is not of SI ({zero}1 {unit} = {parsed.factor + parsed.offset:g} {coherent})",
        help=f'declare unit="{coherent}"; values given on the command line are converted: --set NAME=3{unit}',
    )


def is_coherent(unit: Unit | str) -> bool:
    """Whether the unit is the coherent SI unit of its dimension, so that values in it need no conversion."""
    unit = parse(unit) if isinstance(unit, str) else unit
    return unit.factor == 1.0 and unit.offset == 0.0


def convert(text: str, unit: str) -> float:
    """The number in `text`, expressed in `unit`: `convert("16mm", "m")` is 0.016.

    A number without a unit is taken to be in `unit`, which is normally a coherent SI unit, as in declarations.

    Raises UnitError: AC150 for an unknown unit, AC151 when the dimensions differ, AC152 when there is no number to
    read.
    """
    match = _NUMBER.fullmatch(text)
    if match is None:
        raise UnitError("AC152", f'"{text}" is not a number with an optional unit', help=_accepted(unit))
    digits, suffix = match.group(1), match.group(2).strip()
    if re.match(r",\d", suffix):
        raise UnitError("AC152", f'"{text}" has a decimal comma', help=f"write {digits}.{suffix[1:]}")
    value = float(digits)
    result = value if not suffix or suffix == unit.strip() else _converted(digits, suffix, unit)
    if math.isinf(result) and "inf" not in digits:
        raise UnitError("AC152", f'"{text}" is beyond the range of numbers (1.8e308)', help=_accepted(unit))
    return result


def ambiguous(given: str, wanted: str) -> str | None:
    """Why a value in one unit is not converted to the other although the dimensions agree; None if it is.

    The reason is that one counts cycles and the other measures an angle: 60 rpm are 1 Hz to an engineer, but 6.28 1/s
    in the SI. A rate in 1/min may be either, and so may a quantity in 1/s, such as the rotational speed of a drill.
    """
    (given_cycles, given_angle), (wanted_cycles, wanted_angle) = _rotation(given), _rotation(wanted)
    if (given_cycles and wanted_angle and not wanted_cycles) or (given_angle and wanted_cycles and not given_cycles):
        return "Hz counts cycles, and one cycle is 2 pi rad: 1 Hz = 1 rev/s = 60 rpm = 6.2832 rad/s"
    rate = parse("1/s").dimension
    if given_angle == wanted_angle or parse(given).dimension != rate or parse(wanted).dimension != rate:
        return None
    if parse(given).factor == 1.0 == parse(wanted).factor:  # rad/s and 1/s are the same in the SI and in equations
        return None
    return f"{_quoted(wanted if given_angle else given)} may count turns or radians, which differ by 2 pi"


def is_angular(unit: str) -> bool:
    """Whether a unit contains an angle by one of its names: deg, rad/s, rpm, N.m/rad."""
    return _rotation(unit)[1]


def _rotation(unit: str) -> tuple[bool, bool]:
    """Whether the names in a unit count cycles, and whether one of them is an angle."""
    names = re.findall(r"[^\W\d_]+|\u00b0(?!C|F)", unit)
    counts = any(name.endswith(("Hz", "hertz")) for name in names)
    return counts, any(_ANGULAR.fullmatch(name) for name in names)


def _converted(digits: str, suffix: str, unit: str) -> float:
    source, target = parse(suffix), parse(unit)
    if source.dimension != target.dimension:
        raise UnitError(
            "AC151",
            f'"{digits} {suffix}" does not fit a quantity in {_quoted(unit)}',
            evidence=[
                f"{_quoted(name)} has the dimension {shown}"
                for name, shown in ((n, format_dimension(parse(n).dimension)) for n in (suffix, unit))
                if shown != name.strip()
            ],
            help=_accepted(unit),
        )
    reason = ambiguous(suffix, unit)
    if reason is not None:
        raise UnitError(
            "AC151",
            f'"{digits} {suffix}" does not fit a quantity in {_quoted(unit)}',
            evidence=[reason],
            help="give it in rad/s, rev/s, rpm or deg/s" if "Hz" in suffix or "rad" in unit else f"give it in {unit}",
        )
    return _in(digits, source, target)


def _in(digits: str, source: Unit, target: Unit) -> float:
    value = float(digits)
    is_moderate = 1e-150 < abs(value) < 1e150 and len(digits) < 100
    if is_moderate and source.exact and target.exact and not source.offset and not target.offset:
        return float(Fraction(digits) * source.exact / target.exact)
    return (source.factor * value + source.offset - target.offset) / target.factor


def in_si(value: float, unit: str) -> float:
    """`value` in `unit`, converted to the coherent SI unit: 16 of "mm" is 0.016, 20 of "degC" is 293.15.

    Raises UnitError: AC150 for an unknown unit.
    """
    source = parse(unit)
    return _in(repr(float(value)), source, Unit("", source.dimension, 1.0, 0.0, Fraction(1)))


def format_dimension(dimension: Dimension) -> str:
    """A dimension in SI units: "N", "m/s2", "1"; in base units such as "kg.m2/s" if there is no common name."""
    name = _friendly_names().get(dimension)
    if name is not None:
        return name
    above = [_factor(b, e) for b, e in zip(_PRINT_ORDER, _in_print_order(dimension), strict=True) if e > 0]
    below = [_factor(b, -e) for b, e in zip(_PRINT_ORDER, _in_print_order(dimension), strict=True) if e < 0]
    if not below:
        return ".".join(above) or "1"
    denominator = below[0] if len(below) == 1 else f"({'.'.join(below)})"
    return f"{'.'.join(above) or '1'}/{denominator}"


_PRINT_ORDER = ("kg", "m", "s", "A", "K", "mol", "cd")


def _in_print_order(dimension: Dimension) -> Dimension:
    return (dimension[1], dimension[0], *dimension[2:])


def _factor(base: str, exponent: Fraction | int) -> str:
    if exponent == 1:
        return base
    return f"{base}{exponent}" if exponent.denominator == 1 else f"{base}^({exponent})"


@lru_cache(maxsize=1)
def _friendly_names() -> dict[Dimension, str]:
    return {parse(name).dimension: name for name in _FRIENDLY.split()}


class _Reader:
    """Recursive descent parser of one unit string.

    expression = factor { ("." | "*" | blank | "/") factor };  factor = ("(" expression ")" | number | name) [exponent]
    """

    def __init__(self, text: str) -> None:
        self.text = text
        self.rest = text

    def read(self) -> tuple[Dimension, Scale]:
        dimension, scale = self.expression()
        if self.rest:
            raise self.unreadable(f'"{self.rest}" is not expected here')
        return dimension, scale

    def expression(self) -> tuple[Dimension, Scale]:
        dimension, scale = self.factor()
        divided = False
        while self.rest and not self.rest.startswith(")"):
            if self.take(r"\s*/\s*"):
                divided = True
                other, by = self.factor()
                dimension, scale = divide(dimension, other), self.bounded(scale / by)
                continue
            if not self.take(r"\s*[.*]\s*|\s+"):
                raise self.unreadable(f'"{self.rest}" is not expected here')
            if divided:
                raise self.unreadable(
                    "a product after a division is ambiguous", "put the denominator into brackets: J/(kg.K)"
                )
            other, by = self.factor()
            dimension, scale = multiply(dimension, other), self.bounded(scale * by)
        return dimension, scale

    def factor(self) -> tuple[Dimension, Scale]:
        dimension: Dimension = DIMENSIONLESS
        scale: Scale
        if self.take(r"\(\s*"):
            dimension, scale = self.expression()
            if not self.take(r"\s*\)"):
                raise self.unreadable("a bracket is not closed")
        elif number := self.take(r"[0-9]+(\.[0-9]+)?([eE][+-]?[0-9]+)?"):
            self.bounded(float(number))  # before making a Fraction, because 1e999999999 would fill the memory
            scale = Fraction(number)
        elif name := self.take(r"\u00b0[CF]?|%|[^\W\d]+"):
            dimension, scale = _symbol(name, self.text)
        else:
            raise self.unreadable("a unit name is missing")
        exponent = self.exponent()
        return (dimension, scale) if exponent is None else (power(dimension, exponent), self.raised(scale, exponent))

    def exponent(self) -> Fraction | int | None:
        digits = (
            self.take(r"(\*\*|\^)\s*\(\s*[+-]?[0-9]{1,9}(\.[0-9]{1,9})?(\s*/\s*[0-9]{1,9})?\s*\)")
            or self.take(r"(\*\*|\^)\s*[+-]?[0-9]{1,9}(\.[0-9]{1,9})?")
            or self.take(r"[+-]?[0-9]{1,9}")
        )
        if digits is None:
            return None
        numerator, _, denominator = re.sub(r"[*^()\s]", "", digits).partition("/")
        divisor = int(denominator or 1)
        if divisor == 0 or abs(value := Fraction(numerator) / divisor) > _MAX_EXPONENT:
            raise self.unreadable(f"the exponent {digits} is not usable")
        return _whole(value)

    def raised(self, scale: Scale, exponent: Fraction | int) -> Scale:
        if abs(exponent * math.log10(scale)) > 300:
            raise self.out_of_range()
        if scale == 1:
            return scale  # Fraction(1) ** Fraction(1, 2) would be a float
        result = scale**exponent
        return result if isinstance(result, (Fraction, float)) else float(result)

    def bounded(self, scale: Scale) -> Scale:
        if not 1e-300 < scale < 1e300:
            raise self.out_of_range()
        return scale

    def out_of_range(self) -> UnitError:
        return self.unreadable("its factor is beyond the range of numbers")

    def take(self, pattern: str) -> str | None:
        match = re.match(pattern, self.rest)
        if match is None:
            return None
        self.rest = self.rest[match.end() :]
        return match.group()

    def unreadable(self, why: str, help: str = _SPELLING) -> UnitError:
        return UnitError("AC150", f'the unit "{self.text}" cannot be read: {why}', help=help)


def _is_own(name: str) -> bool:
    return _lookup(name) is not None or name in _WITH_OFFSET


def _symbol(name: str, text: str) -> tuple[Dimension, Scale]:
    """Dimension and factor of one name in the unit `text`; a temperature scale counts as a difference there."""
    defined = _lookup(name)
    if defined is not None:
        return defined
    if name in _WITH_OFFSET:
        return TEMPERATURE, _WITH_OFFSET[name][0]
    unit = _from_pint(name, text)
    return unit.dimension, unit.factor


@cache
def _lookup(name: str) -> tuple[Dimension, Scale] | None:
    """Dimension and factor of a name in the tables above; whole names precede prefix + name (min, cd, Pa)."""
    if name in _SI:
        return _SI[name]
    definition = _WITH_PREFIX.get(name) or _WITHOUT_PREFIX.get(name)
    if definition is not None:
        scale, of = definition
        dimension, base = _Reader(of).read()
        return dimension, scale * base
    for prefix, exponent in _PREFIXES.items():
        stem = name.removeprefix(prefix)
        if stem != name and (stem in _SI or stem in _WITH_PREFIX):
            of_stem = _lookup(stem)
            if of_stem is not None:
                return of_stem[0], Fraction(10) ** exponent * of_stem[1]
    return None


@cache
def _from_pint(name: str, text: str) -> Unit:
    """A name of pint's registry, loaded on the first call (about 0.3 s)."""
    import pint

    registry = pint.application_registry
    readings = registry.parse_unit_name(name)
    # pint reads Ns as "newtons" and Nm as the yarn count, but N.s and N.m are meant.
    plural_symbol = any(suffix and _is_own(name.removesuffix(suffix)) for _, _, suffix in readings)
    if not readings or plural_symbol or name == "Nm":
        raise _unknown(name, text)
    try:
        zero = registry.Quantity(0.0, name).to_base_units()
        one = registry.Quantity(1.0, name).to_base_units()
        two = registry.Quantity(2.0, name).to_base_units()
    except (pint.PintError, ValueError, OverflowError) as reason:
        raise _unknown(name, text) from reason
    order = ("[length]", "[mass]", "[time]", "[current]", "[temperature]", "[substance]", "[luminosity]")
    exponents = dict(one.dimensionality)
    offset = float(zero.magnitude)
    factor = float(one.magnitude) - offset
    linear = math.isclose(float(two.magnitude) - offset, 2.0 * factor, rel_tol=1e-9)
    if not set(exponents) <= set(order) or not (math.isfinite(factor) and factor > 0.0 and linear):
        raise _unknown(name, text)
    dimension = tuple(_whole(Fraction(exponents.get(d, 0)).limit_denominator(100)) for d in order)
    return Unit(text, dimension, factor, offset)


def _candidates(name: str) -> list[str]:
    """Known names that resemble an unknown one, the most likely first."""
    names = [*_SI, *_WITH_PREFIX, *_WITHOUT_PREFIX, *_WITH_OFFSET]
    products = [f"{name[:i]}.{name[i:]}" for i in range(1, len(name)) if _is_own(name[:i]) and _is_own(name[i:])]
    prefixed = [p + n for p in _PREFIXES for n in (*_SI, *_WITH_PREFIX)]
    same_letters = [n for n in (*names, *prefixed) if n.lower() == name.lower()]
    return list(dict.fromkeys([*products, *same_letters, *nearest(name, names)]))[:4]


def _unknown(name: str, text: str) -> UnitError:
    candidates = _candidates(name)
    where = "" if name == text.strip() else f' in "{text.strip()}"'
    did_you_mean = f"did you mean {' or '.join(candidates)}? " if candidates else ""
    return UnitError("AC150", f'unknown unit "{name}"{where}', help=did_you_mean + _SPELLING)


def _quoted(unit: str) -> str:
    return f'"{unit.strip() or "1"}"'


def _accepted(unit: str) -> str:
    """Advice on what `convert` accepts for a quantity in `unit`, with units of the same dimension as examples."""
    dimension = parse(unit).dimension
    fitting = [name for name in _EXAMPLES.split() if parse(name).dimension == dimension and name != unit.strip()]
    unit_text = unit.strip() or "1"
    if not fitting:
        return f"give a number in {unit_text}, or one with a unit of the same dimension"
    return f"give a number in {unit_text}, or one with a unit of the same dimension, such as {', '.join(fitting[:5])}"
