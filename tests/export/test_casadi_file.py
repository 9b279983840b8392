"""Saved CasADi models, models in do-mpc, rockit and acados, and optima of them in closed form."""

from __future__ import annotations

import json
import math
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, der, fixed, parameter, sin, time, variable
from acausal.errors import AcausalError, ExportError, UsageError
from acausal.export.adapters import acados_model, do_mpc_limits, do_mpc_model, identifiers, rockit_stage
from acausal.export.casadi.casadi_file import VERSION
from acausal.lower.casadi_model import CasadiModel
from acausal.models.bouncing_ball import BouncingBall
from acausal.models.drilling_dynamic import ThickBlock
from tests.expected import fails_with
from tests.export.scenes import DrivenSlider, Slider, numbers, radau

READER = """
import json, sys
import acausal
model = acausal.load_casadi(sys.argv[1])
p = model.p.start
x, z = model.init(p)
x[0] = 2e-3
rate, alg, y = model.dae(3.0, x, z, [], p)
xdot, seen = model.ode(3.0, x, [], p)
print(json.dumps({
    "loaded": sorted(m for m in sys.modules if m.startswith(("acausal.models", "acausal.library", "tests"))),
    "vectors": {v: [list(vars(q).values()) for q in getattr(model, v)] for v in "xzupy"},
    "values": [m.full().ravel().tolist() for m in (x, z, rate, alg, y, xdot, seen, model.instants(p))],
}))
"""


def test_round_trip_into_a_process_without_the_model(tmp_path: Path) -> None:
    """Values and descriptions come back bit for bit, rootfinders included, where no model was ever imported."""
    file = tmp_path / "block.casadi"
    model = acausal.compile(ThickBlock()).casadi(["drill.F_f", "drill.s"])
    model.save(file)
    command = [sys.executable, "-c", READER, str(file)]
    run = subprocess.run(command, capture_output=True, text=True, check=False, cwd=Path(__file__).parents[2])
    assert run.returncode == 0, run.stderr
    answer = json.loads(run.stdout)
    assert answer["loaded"] == []
    for v in "xzupy":
        assert answer["vectors"][v] == [list(vars(q).values()) for q in getattr(model, v)]
    p = model.p.start
    x, z = model.init(p)
    x[0] = 2e-3
    expected = [x, z, *model.dae(3.0, x, z, [], p), *model.ode(3.0, x, [], p), model.instants(p)]
    for there, here in zip(answer["values"], expected, strict=True):
        np.testing.assert_array_equal(there, numbers(here))


def test_infinite_limits_and_derivatives_survive(tmp_path: Path) -> None:
    acausal.compile(DrivenSlider()).casadi().save(tmp_path / "m.casadi")
    model = CasadiModel.load(tmp_path / "m.casadi")
    assert (model.x[0].min, model.x[0].max) == (-math.inf, math.inf)
    assert "Infinity" not in zipfile.ZipFile(tmp_path / "m.casadi").read("metadata.json").decode()
    u = ca.MX.sym("u")
    current = model.ode([0.0, 0.0], u, model.p.start)[1]
    # u = i + i**3: di/du = 1/4 at u = 2.
    assert float(ca.Function("f", [u], [ca.jacobian(current, u)])(2.0)) == pytest.approx(0.25, rel=1e-9)
    assert repr(model) == "CasadiModel(DrivenSlider: 2 x, 1 z, 1 u, 5 p, 1 y)"


def test_the_same_model_gives_the_same_bytes(tmp_path: Path) -> None:
    """Files can be compared and kept under version control."""
    for name in ("a.casadi", "b.casadi"):
        acausal.compile(Slider()).casadi().save(tmp_path / name)
    assert (tmp_path / "a.casadi").read_bytes() == (tmp_path / "b.casadi").read_bytes()


def test_another_suffix_is_refused_and_the_file_there_is_kept(tmp_path: Path) -> None:
    """An archive written over `model.py` would destroy the source of the model."""
    source = tmp_path / "slider.py"
    source.write_text("# a model\n")
    with pytest.raises(UsageError, match="AC013"):
        acausal.compile(Slider()).casadi().save(source)
    assert source.read_text() == "# a model\n"


def test_unwritable_place_leaves_nothing(tmp_path: Path) -> None:
    model = acausal.compile(Slider()).casadi()
    with fails_with(AcausalError, "AC012"):
        model.save(tmp_path / "missing" / "m.casadi")
    assert list(tmp_path.iterdir()) == []


def _text(path: Path) -> None:
    path.write_text("time,drill.s\n0,0\n")


def _foreign_archive(path: Path) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("metadata.json", "{}")


def _foreign_json(path: Path) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("metadata.json", "[]")
        archive.writestr("functions.casadi", "")


def _cut_functions(path: Path) -> None:
    _rewritten(path, functions=lambda text: text[: len(text) // 2])


def _newer_format(path: Path) -> None:
    _rewritten(path, metadata=lambda text: text.replace(f'"version": {VERSION}', f'"version": {VERSION + 1}'))


def _newer_casadi(path: Path) -> None:
    _rewritten(
        path,
        metadata=lambda text: text.replace(f'"casadi": "{ca.CasadiMeta.version()}"', '"casadi": "99.0"'),
        functions=lambda _: "unheard of",
    )


def _rewritten(path: Path, metadata: Callable[[str], str] = str, functions: Callable[[str], str] = str) -> None:
    acausal.compile(Slider()).casadi().save(path)
    with zipfile.ZipFile(path) as archive:
        old = {name: archive.read(name).decode() for name in archive.namelist()}
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("metadata.json", metadata(old["metadata.json"]))
        archive.writestr("functions.casadi", functions(old["functions.casadi"]))


@pytest.mark.parametrize(
    ("spoil", "code"),
    [
        (lambda path: None, "AC014"),
        (lambda path: path.mkdir(), "AC014"),
        (_text, "AC601"),
        (_foreign_archive, "AC601"),
        (_foreign_json, "AC601"),
        (_cut_functions, "AC601"),
        (_newer_format, "AC602"),
        (_newer_casadi, "AC602"),
    ],
    ids=["missing", "folder", "text", "archive", "json", "cut", "newer format", "newer casadi"],
)
def test_what_is_no_saved_model_is_refused(tmp_path: Path, spoil: Callable[[Path], None], code: str) -> None:
    path = tmp_path / "m.casadi"
    spoil(path)
    with fails_with(AcausalError, code) as caught:
        acausal.load_casadi(path)
    assert "m.casadi" in str(caught.value)


class Driven(Component):
    """x' = a sin t."""

    a: Real = parameter(default=2.0)
    x: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.a * sin(time)


def test_the_shape_of_acados() -> None:
    """Fields evaluate to the model: i + i^3 = u = 2 has i = 1, so v' = 1; explicit only without algebraic variables."""
    shape = acados_model(acausal.compile(DrivenSlider()).casadi())
    theirs = SimpleNamespace()
    for name, value in vars(shape).items():
        setattr(theirs, name, value)
    assert (theirs.name, theirs.f_expl_expr, theirs.x_labels) == ("DrivenSlider", None, ["mass.s", "mass.v"])
    p = acausal.compile(DrivenSlider()).casadi().p.start
    f = ca.Function("f", [shape.xdot, shape.x, shape.z, shape.u, shape.p], [theirs.f_impl_expr])
    np.testing.assert_allclose(numbers(f([0.3, 1.0], [0.0, 0.3], 1.0, 2.0, p)), 0.0, atol=1e-15)
    explicit = acados_model(acausal.compile(Slider()).casadi())
    g = ca.Function("g", [explicit.x, explicit.u, explicit.p], [explicit.f_expl_expr])
    np.testing.assert_allclose(numbers(g([0.0, 2.0], 3.0, [1.0, 1.0])), [2.0, 3.0])


def test_what_has_no_place_is_refused() -> None:
    timed = acausal.compile(Driven()).casadi()
    ball = acausal.compile(BouncingBall()).casadi(events=True)
    for call in (
        lambda: acados_model(timed),
        lambda: do_mpc_model(timed, None),
        lambda: acados_model(ball),
        lambda: rockit_stage(ball, None),
    ):
        with fails_with(ExportError, "AC614"):
            call()


@pytest.mark.parametrize("model", [Slider(), DrivenSlider()], ids=["ode", "dae"])
def test_rockit_moves_it_with_least_effort(model: Component) -> None:
    """u = 6 - 12 t costs 12; of forces held in N intervals the best costs 12/(1 - 1/N^2)."""
    rockit = pytest.importorskip("rockit", reason="pip install rockit-meco")
    made = acausal.compile(model).casadi()
    ocp = rockit.Ocp(T=1.0)
    stage = rockit_stage(made, ocp)
    ocp.subject_to(ocp.at_t0(stage.x) == 0)
    ocp.subject_to(ocp.at_tf(stage["mass.s"]) == 1)
    ocp.subject_to(ocp.at_tf(stage["mass.v"]) == 0)
    force = stage["drive.i"] if made.z else stage["u"]
    ocp.add_objective(ocp.integral(force**2))
    ocp.solver("ipopt", {"ipopt.print_level": 0, "ipopt.tol": 1e-10, "print_time": False})
    ocp.method(rockit.DirectCollocation(N=20) if made.z else rockit.MultipleShooting(N=20, intg="rk"))
    solution = ocp.solve()
    assert solution.value(ocp.objective) == pytest.approx(12.0 / (1 - 1 / 400), rel=1e-7)


def test_rockit_knows_the_time() -> None:
    """x(1) = 1 + a (1 - cos 1)."""
    rockit = pytest.importorskip("rockit", reason="pip install rockit-meco")
    made = acausal.compile(Driven()).casadi()
    ocp = rockit.Ocp(T=1.0)
    stage = rockit_stage(made, ocp)
    ocp.subject_to(ocp.at_t0(stage.x) == made.x.start)
    ocp.solver("ipopt", {"ipopt.print_level": 0, "print_time": False})
    ocp.method(rockit.MultipleShooting(N=20, intg="rk"))
    solution = ocp.solve()
    assert solution.value(ocp.at_tf(stage["x"])) == pytest.approx(1 + 2 * (1 - np.cos(1.0)), abs=1e-6)


def test_do_mpc_simulates_and_controls_it() -> None:
    """u = 2 drives i = 1: s = 1/2, v = 1 after one second. Then a controller brings it to rest at 1."""
    do_mpc = pytest.importorskip("do_mpc", reason="pip install do-mpc")
    made = acausal.compile(DrivenSlider()).casadi()
    theirs = do_mpc_model(made, do_mpc.model.Model("continuous", "SX"))
    simulator = do_mpc.simulator.Simulator(theirs)
    simulator.set_param(t_step=0.1, integration_tool="idas", abstol=1e-10, reltol=1e-10)
    given = simulator.get_p_template()
    for name, value in zip(identifiers(made.p), made.p.start, strict=True):
        given[name] = value
    simulator.set_p_fun(lambda t: given)
    simulator.setup()
    simulator.x0, simulator.z0 = np.zeros((2, 1)), np.zeros((1, 1))
    simulator.set_initial_guess()
    for _ in range(10):
        x = simulator.make_step(np.array([[2.0]]))
    np.testing.assert_allclose(x.ravel(), [0.5, 1.0], atol=1e-8)

    controller = do_mpc.controller.MPC(theirs)
    controller.settings.n_horizon, controller.settings.t_step = 10, 0.1
    controller.settings.supress_ipopt_output()
    cost = (theirs.x["mass_s"] - 1) ** 2 + theirs.x["mass_v"] ** 2
    controller.set_objective(mterm=cost, lterm=1e-3 * theirs.u["u"] ** 2)
    controller.set_rterm(u=1e-4)
    do_mpc_limits(made, controller)
    assert float(controller.bounds["upper", "_z", "drive_i"]) == 20.0
    known = controller.get_p_template(1)
    for name, value in zip(identifiers(made.p), made.p.start, strict=True):
        known["_p", 0, name] = value
    controller.set_p_fun(lambda t: known)
    controller.setup()
    controller.x0, controller.z0 = x, np.zeros((1, 1))
    controller.set_initial_guess()
    for _ in range(40):
        x = simulator.make_step(controller.make_step(x))
    np.testing.assert_allclose(x.ravel(), [1.0, 0.0], atol=0.02)


def loaded(model: Component, folder: Path, outputs: list[str] | None = None) -> CasadiModel:
    """The model after a way through a file."""
    file = folder / "model.casadi"
    acausal.compile(model).casadi(outputs).save(file)
    return acausal.load_casadi(file)


def test_least_effort_from_rest_to_rest(tmp_path: Path) -> None:
    """Unit mass, unit distance, unit time: u = 6 - 12 t, its square integrates to 12.

    By the Euler-Lagrange equations of the integral of s''**2 the optimum is a cubic in time, s = 3 t**2 - 2 t**3, which
    three Radau points represent exactly.
    """
    model = loaded(Slider(), tmp_path)
    problem = radau(model, 1.0, ca.Opti(), intervals=4)
    s, v = (model.x.position(name) for name in ("mass.s", "mass.v"))
    problem.opti.subject_to(problem.x[s, -1] == 1.0)
    problem.opti.subject_to(problem.x[v, -1] == 0.0)
    effort = problem.integral(problem.u**2)
    problem.opti.minimize(effort)
    solution = problem.solve()
    t = problem.times
    assert solution.value(effort) == pytest.approx(12.0, rel=1e-9)
    np.testing.assert_allclose(solution.value(problem.u).ravel(), 6 - 12 * t, atol=1e-7)
    np.testing.assert_allclose(solution.value(problem.x[s, 1:]).ravel(), 3 * t**2 - 2 * t**3, atol=1e-9)
    # y holds what the model declares itself: here the power u*v.
    assert model.y.names == ("power",)
    np.testing.assert_allclose(solution.value(problem.y).ravel(), (6 - 12 * t) * (6 * t - 6 * t**2), atol=1e-7)


@pytest.mark.parametrize("distance", [0.25, 4.0])
def test_least_time_from_rest_to_rest(tmp_path: Path, distance: float) -> None:
    """|u| <= 1 N on 1 kg: full force to the middle, full brake from there, T = 2 sqrt(distance).

    The first example of Pontryagin et al., The mathematical theory of optimal processes, 1962, chapter 1.

    The switch lies on the border of two intervals, so the discrete optimum is the exact one.
    """
    model = loaded(Slider(), tmp_path)
    opti = ca.Opti()
    horizon = opti.variable()
    opti.subject_to(horizon >= 0.1)
    opti.set_initial(horizon, 1.0)
    problem = radau(model, horizon, opti, intervals=8)
    opti.subject_to(opti.bounded(-1.0, problem.u, 1.0))
    opti.subject_to(problem.x[model.x.position("mass.s"), -1] == distance)
    opti.subject_to(problem.x[model.x.position("mass.v"), -1] == 0.0)
    opti.minimize(horizon)
    solution = problem.solve()
    assert solution.value(horizon) == pytest.approx(2 * np.sqrt(distance), rel=1e-7)
    u = solution.value(problem.u).ravel()
    np.testing.assert_allclose(u, np.where(problem.times < 0.5 + 1e-9, 1.0, -1.0), atol=1e-4)


@pytest.mark.parametrize("reduced", [False, True], ids=["dae", "ode"])
def test_algebraic_variable_in_an_optimal_control_problem(tmp_path: Path, reduced: bool) -> None:
    """The drive's current i is force on 1 kg: least integral of i**2 is again 12 at i = 6 - 12 t, so u = i + i**3.

    With `ode` the current is found inside, by a rootfinder that ipopt differentiates twice.
    """
    model = loaded(DrivenSlider(), tmp_path)
    assert model.z.names == ("drive.i",)
    problem = radau(model, 1.0, ca.Opti(), intervals=4, reduced=reduced)
    opti = problem.opti
    opti.subject_to(problem.x[model.x.position("mass.s"), -1] == 1.0)
    opti.subject_to(problem.x[model.x.position("mass.v"), -1] == 0.0)
    current = problem.y[model.y.position("current"), :]
    opti.minimize(problem.integral(current**2))
    opti.set_initial(problem.u, 1.0)
    solution = problem.solve()
    i = 6 - 12 * problem.times
    assert solution.value(opti.f) == pytest.approx(12.0, rel=1e-8)
    np.testing.assert_allclose(solution.value(problem.u).ravel(), i + i**3, rtol=1e-5, atol=1e-5)
