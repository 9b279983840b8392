"""Signal blocks: sources, arithmetic, continuous transfer functions, limits."""

from __future__ import annotations

from acausal.library.blocks.continuous import PI as PI
from acausal.library.blocks.continuous import Der as Der
from acausal.library.blocks.continuous import Derivative as Derivative
from acausal.library.blocks.continuous import FirstOrder as FirstOrder
from acausal.library.blocks.continuous import Integrator as Integrator
from acausal.library.blocks.continuous import LimPID as LimPID
from acausal.library.blocks.continuous import SecondOrder as SecondOrder
from acausal.library.blocks.interfaces import PartialSI2SO as PartialSI2SO
from acausal.library.blocks.interfaces import PartialSignalSource as PartialSignalSource
from acausal.library.blocks.interfaces import PartialSISO as PartialSISO
from acausal.library.blocks.interfaces import PartialSource as PartialSource
from acausal.library.blocks.math import Add as Add
from acausal.library.blocks.math import Add3 as Add3
from acausal.library.blocks.math import Division as Division
from acausal.library.blocks.math import Feedback as Feedback
from acausal.library.blocks.math import Gain as Gain
from acausal.library.blocks.math import Product as Product
from acausal.library.blocks.nonlinear import Limiter as Limiter
from acausal.library.blocks.sources import Constant as Constant
from acausal.library.blocks.sources import ContinuousClock as ContinuousClock
from acausal.library.blocks.sources import Pulse as Pulse
from acausal.library.blocks.sources import Ramp as Ramp
from acausal.library.blocks.sources import Sine as Sine
from acausal.library.blocks.sources import Step as Step
from acausal.library.blocks.sources import TimeTable as TimeTable
