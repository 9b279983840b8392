"""acausal: equation-based modelling on CasADi.

    Component --flatten--> FlatSystem --analyse--> Structure --lower--> CompiledModel --simulate--> Result

Components declare variables and state equations; every arrow is a function that can be called alone.
Importing this package loads neither CasADi nor matplotlib: the functions that need them load them.
"""

from __future__ import annotations

import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

from acausal.errors import AcausalError as AcausalError
from acausal.language.component import Component as Component
from acausal.language.component import Connector as Connector
from acausal.language.component import Equations as Equations
from acausal.language.component import Record as Record
from acausal.language.connections.connect import connect as connect
from acausal.language.connections.freeing import free as free
from acausal.language.connections.overconstrained import branch as branch
from acausal.language.connections.overconstrained import is_root as is_root
from acausal.language.connections.overconstrained import potential_root as potential_root
from acausal.language.connections.overconstrained import root as root
from acausal.language.connections.overconstrained import rooted as rooted
from acausal.language.declarations.declare import Real as Real
from acausal.language.declarations.declare import boolean as boolean
from acausal.language.declarations.declare import boolean_input as boolean_input
from acausal.language.declarations.declare import boolean_output as boolean_output
from acausal.language.declarations.declare import discrete as discrete
from acausal.language.declarations.declare import fixed as fixed
from acausal.language.declarations.declare import flow as flow
from acausal.language.declarations.declare import guess as guess
from acausal.language.declarations.declare import integer as integer
from acausal.language.declarations.declare import parameter as parameter
from acausal.language.declarations.declare import part as part
from acausal.language.declarations.declare import signal_input as signal_input
from acausal.language.declarations.declare import signal_output as signal_output
from acausal.language.declarations.declare import structural as structural
from acausal.language.declarations.declare import variable as variable
from acausal.language.declarations.experiment import Experiment as Experiment
from acausal.language.declarations.parts import outer as outer
from acausal.language.events import assert_ as assert_
from acausal.language.events import reset as reset
from acausal.language.events import terminate as terminate
from acausal.language.events import when as when
from acausal.language.expressions.arrays import concatenate as concatenate
from acausal.language.expressions.arrays import fill as fill
from acausal.language.expressions.conditions import after_reset as after_reset
from acausal.language.expressions.conditions import change as change
from acausal.language.expressions.conditions import edge as edge
from acausal.language.expressions.conditions import equals as equals
from acausal.language.expressions.conditions import infinitesimal as infinitesimal
from acausal.language.expressions.conditions import initial as initial
from acausal.language.expressions.conditions import no_event as no_event
from acausal.language.expressions.conditions import pre as pre
from acausal.language.expressions.conditions import sample as sample
from acausal.language.expressions.conditions import smooth as smooth
from acausal.language.expressions.conditions import terminal as terminal
from acausal.language.expressions.delay import delay as delay
from acausal.language.expressions.expression import Expr as Expr
from acausal.language.expressions.expression import as_expr as as_expr
from acausal.language.expressions.external import External as External
from acausal.language.expressions.functions import acos as acos
from acausal.language.expressions.functions import asin as asin
from acausal.language.expressions.functions import atan as atan
from acausal.language.expressions.functions import atan2 as atan2
from acausal.language.expressions.functions import ceil as ceil
from acausal.language.expressions.functions import clamp as clamp
from acausal.language.expressions.functions import cos as cos
from acausal.language.expressions.functions import cosh as cosh
from acausal.language.expressions.functions import cross as cross
from acausal.language.expressions.functions import der as der
from acausal.language.expressions.functions import dot as dot
from acausal.language.expressions.functions import exp as exp
from acausal.language.expressions.functions import fabs as fabs
from acausal.language.expressions.functions import floor as floor
from acausal.language.expressions.functions import homotopy as homotopy
from acausal.language.expressions.functions import identity as identity
from acausal.language.expressions.functions import log as log
from acausal.language.expressions.functions import maximum as maximum
from acausal.language.expressions.functions import minimum as minimum
from acausal.language.expressions.functions import norm as norm
from acausal.language.expressions.functions import quantity as quantity
from acausal.language.expressions.functions import sign as sign
from acausal.language.expressions.functions import sin as sin
from acausal.language.expressions.functions import sinh as sinh
from acausal.language.expressions.functions import skew as skew
from acausal.language.expressions.functions import sqrt as sqrt
from acausal.language.expressions.functions import tan as tan
from acausal.language.expressions.functions import tanh as tanh
from acausal.language.expressions.functions import time as time
from acausal.language.expressions.functions import unitless as unitless
from acausal.language.expressions.functions import where as where
from acausal.language.expressions.functions import zeros as zeros
from acausal.language.expressions.lookup import lookup as lookup
from acausal.panel import Panel as Panel
from acausal.providers import provide, provided

if TYPE_CHECKING:
    from acausal.animate.animate import animate as animate
    from acausal.diagram.diagram import diagram as diagram
    from acausal.explore.explore import explore as explore
    from acausal.export.casadi.casadi_file import load_casadi as load_casadi
    from acausal.export.linearize import linearize as linearize
    from acausal.export.operating_point import operating_point as operating_point
    from acausal.export.sensitivity.sensitivities import sensitivities as sensitivities
    from acausal.export.step.step import step_function as step_function
    from acausal.flatten.flatten import flatten as flatten
    from acausal.lower.compile import compile as compile
    from acausal.result.result import Result as Result
    from acausal.result.result import load as load
    from acausal.result.series import TimeSeries as TimeSeries
    from acausal.simulate.run import simulate as simulate
    from acausal.study.bench.bench import bench as bench
    from acausal.study.fit.dataset import Dataset as Dataset
    from acausal.study.fit.fit import fit as fit
    from acausal.study.reduction.reduction import reduce as reduce
    from acausal.study.stability.stability import stability as stability
    from acausal.study.sweep.family import Sweep as Sweep
    from acausal.study.sweep.family import load_sweep as load_sweep
    from acausal.study.sweep.sweep import sweep as sweep
    from acausal.study.sweep.vary import Range as Range

_LAZY = {
    "animate": "acausal.animate.animate",
    "diagram": "acausal.diagram.diagram",
    "explore": "acausal.explore.explore",
    "flatten": "acausal.flatten.flatten",
    "compile": "acausal.lower.compile",
    "simulate": "acausal.simulate.run",
    "TimeSeries": "acausal.result.series",
    "Result": "acausal.result.result",
    "load": "acausal.result.result",
    "Dataset": "acausal.study.fit.dataset",
    "fit": "acausal.study.fit.fit",
    "linearize": "acausal.export.linearize",
    "operating_point": "acausal.export.operating_point",
    "sensitivities": "acausal.export.sensitivity.sensitivities",
    "load_casadi": "acausal.export.casadi.casadi_file",
    "step_function": "acausal.export.step.step",
    "bench": "acausal.study.bench.bench",
    "reduce": "acausal.study.reduction.reduction",
    "stability": "acausal.study.stability.stability",
    "sweep": "acausal.study.sweep.sweep",
    "Sweep": "acausal.study.sweep.family",
    "load_sweep": "acausal.study.sweep.family",
    "Range": "acausal.study.sweep.vary",
}


# Functions that implement methods of models, compiled models and results, besides the names above.
_METHODS = {
    "plot": "acausal.plot.plot",
    "component_html": "acausal.notebook.notebook",
    "compiled_html": "acausal.notebook.notebook",
    "result_html": "acausal.notebook.notebook",
    "casadi_model": "acausal.export.casadi.functions",
    "sources": "acausal.export.casadi.c_source",
    "save_casadi": "acausal.export.casadi.casadi_file",
    "simulated_to_accuracy": "acausal.study.bench.accurate",
    "bench_chart": "acausal.study.bench.chart",
    "draw_optimum": "acausal.optimal_control.optimum.drawing",
    "fit_picture": "acausal.study.fit.picture",
    "stability_picture": "acausal.study.stability.picture",
    "sweep_picture": "acausal.study.sweep.picture",
    "sweep_dataset": "acausal.study.sweep.tables",
    "sweep_frame": "acausal.study.sweep.tables",
    "write_sweep": "acausal.study.sweep.tables",
    "elsewhere": "acausal.cli.arguments.catalogue",
    "missing_library": "acausal.cli.arguments.catalogue",
}
provide({**_LAZY, **_METHODS})


def __getattr__(name: str) -> Any:
    if name in _LAZY:
        return provided(name)
    raise AttributeError(f"module 'acausal' has no attribute {name!r}")


class _Package(ModuleType):
    """`flatten` and `simulate` each name a function and its subpackage; as attributes they are the functions.

    Without this class the import system would replace the function when it first imports the subpackage, because it
    sets every subpackage as an attribute of its parent.
    """

    def __setattr__(self, name: str, value: Any) -> None:
        if not (name in _LAZY and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
