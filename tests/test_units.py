"""Units: definitions of the SI brochure, error messages, and algebraic laws."""

from __future__ import annotations

import math
import subprocess
import sys
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from acausal.errors import UnitError
from acausal.units import (
    DIMENSIONLESS,
    LENGTH,
    MASS,
    TIME,
    convert,
    divide,
    format_dimension,
    is_coherent,
    multiply,
    parse,
    power,
)
from tests.expected import fails_with

NAMES = ["m", "kg", "s", "A", "K", "mol", "cd", "N", "Pa", "V", "mm", "kN", "rad", "rpm", "uF", "in", "bar", "deg"]


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        # SI brochure, 9th edition: table 4 (derived units), table 7 (prefixes), table 8 (accepted units).
        ("1 N/mm2", "Pa", 1e6),
        ("1 rpm", "rad/s", 2 * math.pi / 60),
        ("1 rev/min", "rad/s", 2 * math.pi / 60),
        ("0 degC", "K", 273.15),
        ("16mm", "m", 0.016),
        ("9 mm", "m", 0.009),
        ("-5 kN", "N", -5000.0),
        ("+.5e1 MPa", "N/m2", 5e6),
        ("118deg", "rad", math.radians(118)),
        ("1 bar", "Pa", 1e5),
        ("1.5 h", "s", 5400.0),
        ("2 kWh", "J", 7.2e6),
        ("1 l", "m3", 1e-3),
        ("1 mol/l", "mol/m3", 1e3),
        ("3 %", "1", 0.03),
        ("4.7 kohm", "Ohm", 4700.0),
        ("10 uF", "F", 1e-5),
        ("1 t", "kg", 1e3),
        ("2 daN", "N", 20.0),
        ("1e-3", "m", 1e-3),
        ("inf", "m", math.inf),
        ("3 min", "s", 180.0),
        ("5 mm/min", "m/s", 0.005 / 60),
        ("1 \u00b5m", "m", 1e-6),
        ("1 N\u00b7m", "N.m", 1.0),
        ("7 m s\u207b\u00b2", "m/s2", 7.0),
        ("1 kJ/(kg.degC)", "J/(kg.K)", 1e3),
        # NIST SP 811, appendix B: inch, pound, pound-force per square inch, degree Fahrenheit.
        ("1 in", "m", 0.0254),
        ("1 psi", "Pa", 6894.757293168),
        ("32 degF", "K", 273.15),
        # Names of pint only: SI brochure, 8th edition, table 8.
        ("1 knot", "m/s", 1852 / 3600),
        ("1 inches", "m", 0.0254),
        ("2 newton", "N", 2.0),
    ],
)
def test_conversion(text: str, unit: str, value: float) -> None:
    assert convert(text, unit) == pytest.approx(value, rel=1e-12)


def test_decimal_prefixes_do_not_round() -> None:
    # 9 * 0.001 is 0.009000000000000001 in floating point; users compare these numbers with what they typed.
    for n in range(1, 2000):
        assert convert(f"{n} mm", "m") == float(f"{n}e-3")


@pytest.mark.parametrize(
    "spelling", ["kg/(m.s2)", "kg/m/s2", "kg.m-1.s-2", "kg*m^-1*s**-2", "kg m-1 s-2", "N/m^2", "Pa"]
)
def test_spellings_of_one_unit(spelling: str) -> None:
    assert parse(spelling).dimension == (-1, 1, -2, 0, 0, 0, 0)
    assert is_coherent(spelling)


@pytest.mark.parametrize("text", ["", "1", "rad", "sr", "m/m", "N/N"])
def test_coherent_dimensionless(text: str) -> None:
    assert parse(text).dimension == DIMENSIONLESS
    assert is_coherent(text)


@pytest.mark.parametrize("text", ["%", "deg", "rev", "cycle", "g", "mm", "degC", "rpm", "bar"])
def test_not_coherent(text: str) -> None:
    assert not is_coherent(text)


@pytest.mark.parametrize(
    ("unit", "name"),
    [
        ("N", "N"),
        ("N.m", "N.m"),
        ("N.m/rad", "N.m"),
        ("J", "N.m"),
        ("W", "W"),
        ("N/m2", "Pa"),
        ("V", "V"),
        ("V/A", "Ohm"),
        ("m/s", "m/s"),
        ("m/s2", "m/s2"),
        ("rad", "1"),
        ("rad/s", "1/s"),
        ("N/m", "N/m"),
        ("kg.m2", "kg.m2"),
        ("kg.m2/s", "kg.m2/s"),
        ("W/(m2.K)", "kg/(s3.K)"),
        ("m^(1/2)", "m^(1/2)"),
    ],
)
def test_format_dimension(unit: str, name: str) -> None:
    assert format_dimension(parse(unit).dimension) == name
    assert parse(name).dimension == parse(unit).dimension


@pytest.mark.parametrize(
    ("unit", "fact", "hint"),
    [
        ("foo", 'unknown unit "foo"', "write units as in Modelica"),
        ("kg.foo", 'unknown unit "foo" in "kg.foo"', "write units as in Modelica"),
        ("Nm", 'unknown unit "Nm"', "did you mean N.m"),
        ("Ns", 'unknown unit "Ns"', "did you mean N.s"),
        ("mpa", 'unknown unit "mpa"', "did you mean MPa"),
        ("J/kg.K", "a product after a division is ambiguous", "J/(kg.K)"),
        ("m/", "a unit name is missing", "N.m"),
        ("(m", "a bracket is not closed", "N.m"),
        ("m)", '")" is not expected here', "N.m"),
        ("m^(1/0)", "the exponent", "N.m"),
        ("km99.km99", "beyond the range", "N.m"),
        ("(km50.km40)9", "beyond the range", "N.m"),
        ("1e999999999.m", "beyond the range", "N.m"),
        ("dB", 'unknown unit "dB"', "N.m"),  # logarithmic, no factor
        ("m" * 300, "300 characters", "N.m"),
    ],
)
def test_unreadable_unit(unit: str, fact: str, hint: str) -> None:
    with fails_with(UnitError, "AC150", fact) as caught:
        parse(unit)
    assert hint in str(caught.value.help)


def test_wrong_dimension() -> None:
    with fails_with(UnitError, "AC151") as caught:
        convert("16 kg", "m")
    assert caught.value.fact == '"16 kg" does not fit a quantity in "m"'
    assert caught.value.evidence == ()  # the units are their own dimensions
    assert caught.value.help == "give a number in m, or one with a unit of the same dimension, such as mm, um, in"
    with pytest.raises(UnitError) as caught:
        convert("16 kN", "m")
    assert caught.value.evidence == ('"kN" has the dimension N',)


@pytest.mark.parametrize(
    "text", ["", "mm", "abc", "1,5 mm", "--3", "nan", "1e999", "1e308 km", "1e999999999 m", "1 2 3,"]
)
def test_unreadable_number(text: str) -> None:
    with pytest.raises(UnitError) as caught:
        convert(text, "m")
    assert caught.value.code in ("AC152", "AC150")


factors = st.lists(st.tuples(st.sampled_from(NAMES), st.integers(-3, 3)), min_size=1, max_size=4)


@given(factors, factors)
def test_a_product_has_the_product_of_the_factors(left: list[tuple[str, int]], right: list[tuple[str, int]]) -> None:
    a, b = (".".join(f"{name}{exponent}" for name, exponent in side) for side in (left, right))
    product, quotient = parse(f"{a}.{b}"), parse(f"({a})/({b})")
    assert product.dimension == multiply(parse(a).dimension, parse(b).dimension)
    assert quotient.dimension == divide(parse(a).dimension, parse(b).dimension)
    assert product.factor == pytest.approx(parse(a).factor * parse(b).factor, rel=1e-12)
    assert quotient.factor == pytest.approx(parse(a).factor / parse(b).factor, rel=1e-12)


@given(factors, st.integers(-5, 5))
def test_a_power_has_the_power_of_the_factor(names: list[tuple[str, int]], n: int) -> None:
    text = ".".join(f"{name}{exponent}" for name, exponent in names)
    assert parse(f"({text}){n}").dimension == power(parse(text).dimension, n)
    assert parse(f"({text})^({n})").factor == pytest.approx(parse(text).factor ** n, rel=1e-10)


@given(factors, st.integers(1, 7))
def test_a_root_undoes_a_power(names: list[tuple[str, int]], n: int) -> None:
    dimension = parse(".".join(f"{name}{exponent}" for name, exponent in names)).dimension
    assert power(power(dimension, n), Fraction(1, n)) == dimension


@given(st.tuples(*[st.fractions(-4, 4, max_denominator=6)] * 7))
def test_a_printed_dimension_reads_back(dimension: tuple[Fraction, ...]) -> None:
    assert parse(format_dimension(dimension)).dimension == dimension


@given(st.floats(allow_nan=False, allow_infinity=False), st.sampled_from(NAMES))
def test_a_number_in_the_declared_unit_is_unchanged(value: float, unit: str) -> None:
    assert convert(repr(value), unit) == value
    assert convert(f"{value!r} {unit}", unit) == value


@given(st.text(alphabet="mkgsNPaKrd.*/^()- 0123456789\u00b0%e", max_size=25))
def test_any_text_is_a_unit_or_a_unit_error(text: str) -> None:
    try:
        unit = parse(text)
    except UnitError:
        return
    assert len(unit.dimension) == 7
    assert math.isfinite(unit.factor)
    assert unit.factor > 0.0


def test_dimension_constants() -> None:
    assert parse("kg.m/s2").dimension == divide(multiply(MASS, LENGTH), power(TIME, 2))


def test_the_own_table_needs_no_unit_package() -> None:
    """pint costs 0.3 s and 60 MB: it is loaded only for a name that is missing from our tables."""
    program = (
        "import sys; from acausal.units import parse; parse('kN.mm/rad'); parse('degC'); parse('rpm');"
        "print([m for m in ('pint', 'casadi', 'scipy', 'matplotlib', 'numpy') if m in sys.modules]); parse('furlong');"
        "print('pint' in sys.modules)"
    )
    output = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout
    assert output.split("\n")[:2] == ["[]", "True"]


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        *[("60 rpm", "Hz"), ("1 rad/s", "Hz"), ("360 deg/s", "Hz"), ("1 Hz", "rad/s"), ("2 kHz", "rad/s")],
        *[("1 N.m.s/rad", "N.m/Hz"), ("3000 1/min", "rad/s"), ("3000 1/h", "rad/s")],
        # A drill's speed n [1/s] counts turns: 560 rpm are 9.33 of them, and 58.6 rad/s.
        *[("560 rpm", "1/s"), ("1 rev/s", "1/s"), ("360 deg/s", "1/s"), ("1 1/s", "rpm")],
    ],
)
def test_cycles_are_not_taken_for_radians(text: str, unit: str) -> None:
    """60 rpm are one cycle a second, 1 Hz; the dimensions of the SI would make 6.28 Hz of them."""
    with pytest.raises(UnitError, match=r"AC151.*does not fit"):
        convert(text, unit)


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        *[("60 rpm", "rad/s", 2 * math.pi), ("1 rev/s", "rad/s", 2 * math.pi), ("3 1/s", "rad/s", 3.0)],
        *[("60 1/min", "Hz", 1.0), ("3 1/s", "Hz", 3.0), ("2 kHz", "1/s", 2000.0), ("1 V/Hz", "V.s", 1.0)],
        *[("1 N.m/rad", "N.m", 1.0), ("560 1/min", "1/s", 560 / 60), ("1 rad/s", "1/s", 1.0)],
    ],
)
def test_what_is_neither_is_taken_as_the_si_has_it(text: str, unit: str, value: float) -> None:
    assert convert(text, unit) == pytest.approx(value, rel=1e-12)


def test_a_decimal_comma_is_named() -> None:
    with pytest.raises(UnitError, match="decimal comma") as caught:
        convert("1,5 kg", "kg")
    assert caught.value.help == "write 1.5 kg"
