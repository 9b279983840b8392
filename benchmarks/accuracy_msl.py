"""The examples of the Modelica Standard Library whose converged results are known, for accuracy.py.

The models are those of tests/accuracy/, the answers the last rows of `converged.csv` in the folder given by
ACAUSAL_REFERENCE. Errors are relative to the range of each signal in the run, as in the README of the data.
"""

from __future__ import annotations

import csv
import importlib
import json
import math
import os
from pathlib import Path
from typing import Any

import numpy as np
from tests.accuracy.published import our_name

from acausal.models.ivp.answers import Problem

FOLDER = Path(os.environ.get("ACAUSAL_REFERENCE", "")) / "msl"
# Assumed agreement of two integrations for which none is stated: two digits less than are printed.
_DEFAULT_AGREEMENT = 1e-9
_BODIES = {f"body{k + 1}": f"bodies[{k}]" for k in range(4)}
_LOSS = {"eddyCurrentTorque.lossPower": "eddyCurrentTorque.loss_power"}
MODELS: dict[str, tuple[str, str, dict[str, str]]] = {
    "Blocks_PID_Controller": ("blocks", "PIDController", {"PI.I.y": "PI.I"}),
    "Electrical_CauerLowPassAnalog": ("1d", "CauerLowPassAnalog", {}),
    "Electrical_HeatingRectifier": ("heat", "HeatingRectifier", {}),
    "Electrical_ShowSaturatingInductor": ("heat", "ShowSaturatingInductor", {}),
    "Electrical_SwitchWithArc": ("switches", "SwitchWithArc", {}),
    "Heat_Motor": ("heat", "Motor", {}),
    "MultiBody_DoublePendulumInitTip": ("multibody", "DoublePendulumInitTip", {}),
    "MultiBody_Engine1a": ("multibody_loops", "Engine1a", {}),
    "MultiBody_Engine1b": ("multibody_loops", "Engine1b", {}),
    "MultiBody_ForceAndTorque": ("multibody", "ForceAndTorque", {}),
    "MultiBody_Fourbar1": ("multibody_loops", "Fourbar1", {}),
    "MultiBody_FreeBody": ("multibody_free", "FreeBody", {"body.body": "body"}),
    "MultiBody_Pendulum": ("multibody", "MslPendulum", {}),
    "MultiBody_PendulumWithSpringDamper": ("multibody", "PendulumWithSpringDamper", {}),
    "MultiBody_PointGravity": ("multibody_free", "PointGravity", {}),
    "MultiBody_PointGravityWithPointMasses": ("multibody_free", "PointGravityWithPointMasses", _BODIES),
    "MultiBody_SpringDamperSystem": ("multibody_free", "SpringDamperSystem", {}),
    "MultiBody_SpringWithMass": ("multibody_free", "HangingMass", {}),
    "Rotational_Backlash": ("contact", "Backlash", {}),
    "Rotational_EddyCurrentBrake": ("heat", "EddyCurrentBrake", _LOSS),
    "Rotational_ElasticBearing": ("1d", "ElasticBearing", {}),
    "Rotational_First": ("1d", "First", {}),
    "Rotational_LossyGearDemo1": ("lossy_gear", "LossyGearDemo1", {}),
    "Rotational_OneWayClutch": ("friction", "OneWayClutch", {}),
    "Rotational_RollingWheel": ("1d", "RollingWheel", {}),
    "Translational_ElastoGap": ("contact", "ElastoGapExample", {}),
    "Translational_InitialConditions": ("1d", "InitialConditions", {}),
    "Translational_Oscillator": ("1d", "Oscillator", {}),
}


def example(name: str) -> tuple[Problem, float, dict[str, float]]:
    """The problem, its stop time [s], and the range of each signal."""
    module, model, renamed = MODELS[name]
    cls: Any = getattr(importlib.import_module(f"tests.accuracy.test_msl_{module}"), model)
    with (FOLDER / name / "converged.csv").open(newline="") as file:
        names, *rows = csv.reader(file)
    data = np.array(rows, dtype=float)
    known = json.loads((FOLDER / name / "meta.json").read_text()).get("converged") or {}
    agreement = float(known.get("agreement_of_two_runs_over_range") or _DEFAULT_AGREEMENT)
    ranges, values = {}, {}
    for k, signal in enumerate(names[1:], start=1):
        extent = float(np.ptp(data[:, k]))
        if extent > 1e-9 * max(1.0, float(np.abs(data[:, k]).max())):
            path = our_name(signal, renamed)
            values[path], ranges[path] = float(data[-1, k]), extent
    problem = Problem(cls, values, math.floor(-math.log10(agreement)), f"converged.csv of the example, {agreement:.0e}")
    return problem, float(data[-1, 0]), ranges
