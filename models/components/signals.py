"""Arithmetic, limits, lags, delays, noise, means and controllers: continuous components of `acausal.library.blocks`."""

from __future__ import annotations

from typing import ClassVar

from acausal import Component, Equations, Experiment, Panel, connect, fixed
from acausal.library.blocks import (
    PI,
    Add,
    Add3,
    CombiTable1D,
    Constant,
    ContinuousClock,
    DeadZone,
    Der,
    Derivative,
    Division,
    Feedback,
    FirstOrder,
    FixedDelay,
    Hysteresis,
    Integrator,
    Limiter,
    LimPID,
    Mean,
    NormalNoise,
    PadeDelay,
    Product,
    Pulse,
    Ramp,
    RectifiedMean,
    Relay,
    RootMeanSquare,
    SecondOrder,
    Sine,
    UniformNoise,
    VariableDelay,
)


class Arithmetic(Component):
    """Time and a ramp, added, multiplied, divided and integrated."""

    clock: ContinuousClock = ContinuousClock(offset=1.0)
    ramp: Ramp = Ramp(height=2.0, start_time=1.0, duration=2.0)
    two: Constant = Constant(k=2.0)
    add: Add = Add(k2=-1.0)
    add3: Add3 = Add3()
    product: Product = Product()
    division: Division = Division()
    feedback: Feedback = Feedback()
    integrator: Integrator = Integrator(y=fixed(0.0))

    experiment: ClassVar[Experiment] = Experiment(stop_time=4.0)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("clock.y", "ramp.y"), title="clock and ramp"),
        Panel(("add.y", "add3.y", "feedback.y"), title="clock - ramp, clock + ramp + 2, 2 - ramp"),
        Panel(("product.y", "division.y", "integrator.y"), title="clock * ramp, ramp / clock, integral of ramp"),
    )

    def equations(self) -> Equations:
        yield connect(self.clock.y, self.add.u1, self.add3.u1, self.product.u1, self.division.u2)
        yield connect(self.ramp.y, self.add.u2, self.add3.u2, self.product.u2, self.division.u1)
        yield connect(self.ramp.y, self.feedback.u2, self.integrator.u)
        yield connect(self.two.y, self.add3.u3, self.feedback.u1)


class Limits(Component):
    """A sine through a limiter, a dead zone, switches and a table."""

    sine: Sine = Sine(amplitude=2.0, f=1.0)
    limiter: Limiter = Limiter(u_max=1.5)
    dead_zone: DeadZone = DeadZone(u_max=1.0)
    hysteresis: Hysteresis = Hysteresis(u_low=-1.0, u_high=1.0)
    relay: Relay = Relay(u_low=-0.5, u_high=0.5, y_on=2.0, y_off=-2.0)
    table: CombiTable1D = CombiTable1D(table=((-2.0, 0.0), (-1.0, 1.0), (0.0, 0.0), (1.0, 1.0), (2.0, 0.0)))

    experiment: ClassVar[Experiment] = Experiment(stop_time=2.0)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("sine.y", "limiter.y", "dead_zone.y"), title="Limiter and dead zone"),
        Panel(("sine.y", "relay.y", "hysteresis.y"), title="Relay and hysteresis"),
        Panel(("sine.y", "table.y"), title="Table"),
    )

    def equations(self) -> Equations:
        inputs = (self.limiter.u, self.dead_zone.u, self.hysteresis.u, self.relay.u, self.table.u)
        yield connect(self.sine.y, *inputs)


class Responses(Component):
    """Pulses through two lags; the output is differentiated exactly and approximately."""

    pulse: Pulse = Pulse(period=4.0)
    lag: FirstOrder = FirstOrder(T=0.1, y=fixed(0.0))
    second: SecondOrder = SecondOrder(w=6.0, D=0.3, y=fixed(0.0), yd=fixed(0.0))
    exact: Der = Der()
    approximate: Derivative = Derivative(T=0.1, x=fixed(0.0))

    experiment: ClassVar[Experiment] = Experiment(stop_time=8.0)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("pulse.y", "lag.y", "second.y"), title="Answers"),
        Panel(("exact.y", "approximate.y"), title="Derivative of the answer"),
    )

    def equations(self) -> Equations:
        yield connect(self.pulse.y, self.lag.u)
        yield connect(self.lag.y, self.second.u)
        yield connect(self.second.y, self.exact.u, self.approximate.u)


class Delays(Component):
    """A ramp delayed by half a second, by a Pade approximation of that delay, and by a growing delay."""

    ramp: Ramp = Ramp(height=1.0, start_time=1.0, duration=1.0)
    fixed_delay: FixedDelay = FixedDelay(delay_time=0.5)
    pade: PadeDelay = PadeDelay(delay_time=0.5)
    growing: Ramp = Ramp(offset=0.1, height=0.8, duration=4.0)
    variable: VariableDelay = VariableDelay(delay_max=1.0)

    experiment: ClassVar[Experiment] = Experiment(stop_time=4.0)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("ramp.y", "fixed_delay.y", "pade.y", "variable.y"), title="A ramp and its delays"),
        Panel(("growing.y",), title="Delay time of `variable` in s"),
    )

    def equations(self) -> Equations:
        yield connect(self.ramp.y, self.fixed_delay.u, self.pade.u, self.variable.u)
        yield connect(self.growing.y, self.variable.delay_time)


class NoisySignals(Component):
    """Two reproducible noise signals, the second one behind a lag."""

    uniform: UniformNoise = UniformNoise(sample_period=0.05, y_min=-1.0)
    normal: NormalNoise = NormalNoise(sample_period=0.05, sigma=0.5, seed=2)
    lag: FirstOrder = FirstOrder(T=0.3, y=fixed(0.0))

    experiment: ClassVar[Experiment] = Experiment(stop_time=5.0)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("uniform.y",), title="Uniform from -1 to 1"),
        Panel(("normal.y", "lag.y"), title="Normal, and behind a lag"),
    )

    def equations(self) -> Equations:
        yield connect(self.normal.y, self.lag.u)


class MeansOfSine(Component):
    """Mean, rectified mean and root mean square of a sine with offset, period by period."""

    sine: Sine = Sine(offset=0.5, amplitude=1.0, f=1.0)
    mean: Mean = Mean(f=1.0)
    rectified: RectifiedMean = RectifiedMean(f=1.0)
    rms: RootMeanSquare = RootMeanSquare(f=1.0)

    experiment: ClassVar[Experiment] = Experiment(stop_time=4.0)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("sine.y", "mean.y", "rectified.y", "rms.y"), title="A sine and its means"),
    )

    def equations(self) -> Equations:
        yield connect(self.sine.y, self.mean.u, self.rectified.u, self.rms.u)


class TwoControllers(Component):
    """A PID controller with limits and a PI controller, each with a plant of two lags."""

    set_point: Pulse = Pulse(period=20.0)
    pid: LimPID = LimPID(k=4.0, Ti=2.0, Td=0.3, y_max=2.0, I=fixed(0.0), x_D=fixed(0.0))
    plant1a: FirstOrder = FirstOrder(T=1.0, y=fixed(0.0))
    plant1b: FirstOrder = FirstOrder(T=0.5, y=fixed(0.0))
    error: Feedback = Feedback()
    pi: PI = PI(k=1.0, T=1.5, x=fixed(0.0))
    plant2a: FirstOrder = FirstOrder(T=1.0, y=fixed(0.0))
    plant2b: FirstOrder = FirstOrder(T=0.5, y=fixed(0.0))

    experiment: ClassVar[Experiment] = Experiment(stop_time=20.0)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("set_point.y", "plant1b.y", "plant2b.y"), title="Set point and controlled values"),
        Panel(("pid.y", "pi.y"), title="Outputs of the controllers"),
    )

    def equations(self) -> Equations:
        yield connect(self.set_point.y, self.pid.u_s, self.error.u1)
        yield connect(self.pid.y, self.plant1a.u)
        yield connect(self.plant1a.y, self.plant1b.u)
        yield connect(self.plant1b.y, self.pid.u_m)
        yield connect(self.error.y, self.pi.u)
        yield connect(self.pi.y, self.plant2a.u)
        yield connect(self.plant2a.y, self.plant2b.u)
        yield connect(self.plant2b.y, self.error.u2)
