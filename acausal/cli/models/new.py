"""`acausal new`: a commented template of a model."""

from __future__ import annotations

import keyword
import re
from pathlib import Path
from typing import Annotated

import typer

from acausal.cli.arguments import options
from acausal.cli.arguments.outputs import check_writable
from acausal.cli.output.report import record, remark
from acausal.errors import UsageError

_SKELETON = '''\
"""A mass on a spring, driven by a force: replace it with your own model.

Run it:       acausal simulate {file} --plot
Look at it:   acausal info {file};  acausal check {file}
Components:   acausal list library;  acausal info translational.Spring
"""

from __future__ import annotations

from typing import ClassVar

from acausal import Component, Equations, Experiment, Panel, Real, connect, fixed, parameter, part, variable
from acausal.library.blocks import Sine
from acausal.library.translational import Damper, Fixed, Force, Mass, Spring


class {name}(Component):
    """What the model shows, in one sentence."""

    # Parameters can be changed without compiling again: --set c=1N/cm
    c: Real = parameter(default=100.0, unit="N/m", min=0.0, doc="Stiffness of the spring")
    f_max: Real = parameter(default=1.0, unit="N", doc="Amplitude of the force")

    # A variable is an unknown: it needs an equation below.
    energy: Real = variable(unit="J", doc="Kinetic and elastic energy")

    # Parts that do not depend on parameters of the model; fixed(...) is a start value, guess(...) an estimate of one.
    wall: Fixed = Fixed()
    mass: Mass = Mass(m=1.0, s=fixed(0.0), v=fixed(0.0))
    damper: Damper = Damper(d=0.5)
    force: Force = Force()
    # Parts that depend on parameters of the model are declared here and created in `build`.
    spring: Spring = part()
    source: Sine = part()

    # Default settings of a run, and its figure.
    experiment: ClassVar[Experiment] = Experiment(stop_time=20.0)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("mass.s",), title="Position"),
        Panel(("energy",), title="Energy"),
    )

    def build(self) -> None:
        self.spring = Spring(c=self.c)
        self.source = Sine(amplitude=self.f_max, f=1.0)

    def equations(self) -> Equations:
        # Connected flanges have the same position, and their forces sum to zero.
        yield connect(self.wall.flange, self.spring.flange_a, self.damper.flange_a)
        yield connect(self.spring.flange_b, self.damper.flange_b, self.mass.flange_a)
        yield connect(self.force.flange, self.mass.flange_b)
        # The output of a block drives an input.
        yield connect(self.source.y, self.force.u)
        # Further equations; their units are checked.
        yield self.energy == 0.5 * self.mass.m * self.mass.v**2 + 0.5 * self.c * self.mass.s**2
'''


def new(
    file: Annotated[Path, typer.Argument(metavar="FILE.py", help="The file to write.", show_default=False)],
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Write a commented model that runs, as a template for your own.

    Example: acausal new my_model.py
    """
    name = "".join(word[:1].upper() + word[1:] for word in re.split(r"[^0-9a-zA-Z]+", file.stem))
    if file.suffix != ".py" or not name.isidentifier() or keyword.iskeyword(name):
        raise UsageError("AC013", f"{file} is no name for a Python file with a class", help="acausal new my_model.py")
    if file.exists():
        raise UsageError("AC080", f"{file} already exists", help="choose another name, or remove it")
    check_writable(file)
    file.write_text(_SKELETON.format(file=file, name=name), encoding="utf-8")
    if as_json:
        record({"model": name, "files": [str(file)]})
    elif not quiet:
        remark(f"wrote {file}; run it: acausal simulate {file} --plot")
