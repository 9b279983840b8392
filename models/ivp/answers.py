"""Reference end values of the problems in this folder, and the errors of results relative to them.

The values are those of the sources named in `PROBLEMS`, to their reliable digits; tests compare them with independent
copies.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from acausal.models.ivp.andrews_squeezer import AndrewsSqueezer
from acausal.models.ivp.car_axis import CarAxis
from acausal.models.ivp.charge_pump import ChargePump
from acausal.models.ivp.chemical_akzo_nobel import ChemicalAkzoNobel
from acausal.models.ivp.e5 import E5
from acausal.models.ivp.fekete_points import FeketePoints
from acausal.models.ivp.hires import Hires
from acausal.models.ivp.oregonator import Oregonator
from acausal.models.ivp.planar_pendulum import PlanarPendulum
from acausal.models.ivp.pleiades import Pleiades
from acausal.models.ivp.pollution import Pollution
from acausal.models.ivp.ring_modulator import RingModulator
from acausal.models.ivp.robertson import Robertson
from acausal.models.ivp.transistor_amplifier import TransistorAmplifier
from acausal.models.ivp.vanderpol import VanDerPol
from acausal.models.ivp.wheelset import Wheelset


@dataclass(frozen=True)
class Problem:
    """A problem with its reference solution at the stop time of its experiment.

    `values` are those of the compared components by path, accurate to `digits`. `floor` is the ratio of absolute to
    relative tolerance in the mixed error: 1 as in the published tables, 0 (a relative error) if all components are
    tiny. `stiff` problems are not for explicit methods.
    """

    model: Any  # a component class, or a function that returns a component
    values: dict[str, float]
    digits: int
    source: str
    floor: float = 1.0
    index: int = 0
    stiff: bool = True

    def digits_reached(self, final: Callable[[str], Any]) -> float:
        """The measure `mescd` of the test set: -log10 max |y - r| / (floor + |r|), at most the reliable digits."""
        return self._digits(final, self.floor)

    def relative_digits(self, final: Callable[[str], Any]) -> float:
        """The measure `scd`: the same with relative errors, without components whose end value is 0."""
        return self._digits(final, 0.0)

    def _digits(self, final: Callable[[str], Any], floor: float) -> float:
        errors = [abs(final(path) - r) / (floor + abs(r)) for path, r in self.values.items() if floor + abs(r) > 0.0]
        worst = max(errors)
        if not math.isfinite(worst):
            return -math.inf
        return min(-math.log10(max(worst, 1e-300)), float(self.digits))


_ROBERTSON: dict[str, float] = {
    "y1": 2.083340149701255e-08,
    "y2": 8.333360770334713e-14,
    "y3": 0.999999979166505,
}
_VANDERPOL: dict[str, float] = {
    "y1": 1.706167732170469,
    "y2": -0.0008928097010248125,
}
_OREGONATOR: dict[str, float] = {
    "y1": 1.000814870318523,
    "y2": 1228.178521549917,
    "y3": 132.0554942846706,
}
_CHEMICAL_AKZO_NOBEL: dict[str, float] = {
    "y1": 0.1150794920661702,
    "y2": 0.001203831471567715,
    "y3": 0.1611562887407974,
    "y4": 0.0003656156421249283,
    "y5": 0.01708010885264404,
    "y6": 0.004873531310307455,
}
_RING_MODULATOR: dict[str, float] = {
    "y1": -0.02339057358486745, "y2": -0.007367485485540825, "y3": 0.2582956709291169, "y4": -0.406446572128345,
    "y5": -0.4039455665149794, "y6": 0.2607966765422943, "y7": 0.1106761861269975, "y8": 2.939904342435596e-07,
    "y9": -2.840029933642329e-08, "y10": 0.0007267198267264553, "y11": 0.000792948719696084,
    "y12": -0.0007255283495698965, "y13": -0.0007941401968526521, "y14": 7.088495416976114e-05,
    "y15": 2.39005907523657e-05,
}  # fmt: skip
_CAR_AXIS: dict[str, float] = {
    "xl": 0.04934557842754028,
    "yl": 0.49698946023017115,
    "xr": 1.0417425248854215,
    "yr": 0.37391102726536124,
    "vxl": -0.07705836840409723,
    "vyl": 0.007446866587237785,
    "vxr": 0.017556815753723223,
    "vyr": 0.7703410437792519,
    "lam1": -0.004736886590848933,
    "lam2": -0.0011046803312573436,
}
_E5: dict[str, float] = {
    "y2": 8.86123352e-23,
    "y3": 8.86123352e-23,
}
_POLLUTION: dict[str, float] = {
    "y[0]": 0.05646255480022769, "y[1]": 0.1342484130422339, "y[2]": 4.139734331099427e-09,
    "y[3]": 0.005523140207484359, "y[4]": 2.018977262302196e-07, "y[5]": 1.464541863493966e-07,
    "y[6]": 0.07784249118997964, "y[7]": 0.3245075353396018, "y[8]": 0.007494013383880406,
    "y[9]": 1.622293157301561e-08, "y[10]": 1.135863833257075e-08, "y[11]": 0.002230505975721359,
    "y[12]": 0.000208716288279863, "y[13]": 1.396921016840158e-05, "y[14]": 0.008964884856898295,
    "y[15]": 4.352846369330103e-18, "y[16]": 0.006899219696263405, "y[17]": 0.0001007803037365946,
    "y[18]": 1.772146513969984e-06, "y[19]": 5.682943292316392e-05,
}  # fmt: skip
_PLEIADES: dict[str, float] = {
    "x[0]": 0.3706139143970502, "x[1]": 3.237284092057233, "x[2]": -3.222559032418324, "x[3]": 0.659709145577531,
    "x[4]": 0.3425581707156584, "x[5]": 1.562172101400631, "x[6]": -0.7003092922212495, "y[0]": -3.943437585517392,
    "y[1]": -3.27138097397255, "y[2]": 5.225081843456543, "y[3]": -2.59061243497747, "y[4]": 1.198213693392275,
    "y[5]": -0.2429682344935824, "y[6]": 1.09144924042898,
}  # fmt: skip
_PLANAR_PENDULUM: dict[str, float] = {
    "x": 1.0,
    "y": 0.0,
}
_ANDREWS_SQUEEZER: dict[str, float] = {
    "beta": 15.81077119629904,
    "theta": -15.75637105984298,
    "gamma": 0.04082224013073101,
    "phi": -0.5347301163226948,
    "delta": 0.5244099658805303,
    "omega": 0.5347301163226948,
    "eps": 1.048080741042263,
}
_WHEELSET: dict[str, float] = {
    "x": 0.0086355382475, "y": 1.30383415e-05, "z": -9.3635811e-05, "theta": -0.013642295979,
    "phi": 0.0015292894208, "vx": -0.0769852414, "vy": -0.00025151063868, "vz": 0.0020541149,
    "vtheta": -0.239048402, "vphi": -0.0136334449, "beta": -0.244213706, "right.psi": -0.00033666742637,
    "right.xi": -0.15949425637, "left.psi": 0.0003783960367, "left.xi": 0.141732150101, "lam1": -0.010124044992,
    "lam2": -0.005628562909,
}  # fmt: skip
_CHARGE_PUMP: dict[str, float] = {
    "circuit.YT1": 1.2628004298767594e-13,
    "circuit.I": 0.00015225661038485337,
}
_FEKETE_POINTS: dict[str, float] = {
    "particles[0].p[0]": -0.4070263380333202, "particles[0].p[1]": 0.3463758772791802,
    "particles[0].p[2]": 0.8451942450030429, "particles[1].p[0]": 0.0775293475252155,
    "particles[1].p[1]": -0.2628662719972299, "particles[1].p[2]": 0.9617122871829146,
    "particles[2].p[0]": 0.7100577833343567, "particles[2].p[1]": 0.121294805558612,
    "particles[2].p[2]": 0.6936177005172217, "particles[3].p[0]": 0.2348267744557627,
    "particles[3].p[1]": 0.7449277976923311, "particles[3].p[2]": 0.6244509285956391,
    "particles[4].p[0]": -0.4341114738782885, "particles[4].p[1]": 0.8785430442262876,
    "particles[4].p[2]": 0.199272044423766, "particles[5].p[0]": -0.9515059600312596,
    "particles[5].p[1]": 0.2203508762787005, "particles[5].p[2]": 0.2146669498274008,
    "particles[6].p[0]": -0.6385191643609878, "particles[6].p[1]": -0.4310833259390688,
    "particles[6].p[2]": 0.6375425027722121, "particles[7].p[0]": -0.1464175087914336,
    "particles[7].p[1]": -0.9380871635228862, "particles[7].p[2]": 0.313933729874469,
    "particles[8].p[0]": 0.5666974065069942, "particles[8].p[1]": -0.6739221885076542,
    "particles[8].p[2]": 0.4740073135462156, "particles[9].p[0]": 0.9843259538440293,
    "particles[9].p[1]": -0.1696995357819996, "particles[9].p[2]": -0.0480050429060909,
    "particles[10].p[0]": 0.1464175087914331, "particles[10].p[1]": 0.9380871635228875,
    "particles[10].p[2]": -0.3139337298744656, "particles[11].p[0]": -0.7092757549979014,
    "particles[11].p[1]": 0.5264062637139616, "particles[11].p[2]": -0.4688542938854929,
    "particles[12].p[0]": -0.8665731819284478, "particles[12].p[1]": -0.4813878059756024,
    "particles[12].p[2]": -0.1315929352982178, "particles[13].p[0]": -0.2347897778700538,
    "particles[13].p[1]": -0.859434040801313, "particles[13].p[2]": -0.4541441287957579,
    "particles[14].p[0]": 0.5530976940074118, "particles[14].p[1]": -0.7674370265615124,
    "particles[14].p[2]": -0.3242273140037833, "particles[15].p[0]": 0.7711050969896927,
    "particles[15].p[1]": 0.6357041816577034, "particles[15].p[2]": 0.03573685519777001,
    "particles[16].p[0]": 0.7103951209379591, "particles[16].p[1]": 0.2403570431280519,
    "particles[16].p[2]": -0.6614886725910596, "particles[17].p[0]": -0.0303820873873566,
    "particles[17].p[1]": 0.4501923293640461, "particles[17].p[2]": -0.8924145871442046,
    "particles[18].p[0]": -0.5772996158107093, "particles[18].p[1]": -0.1766763414971813,
    "particles[18].p[2]": -0.7971892020969544, "particles[19].p[0]": 0.2414481766969039,
    "particles[19].p[1]": -0.3416456818373135, "particles[19].p[2]": -0.908284650344625,
}  # fmt: skip

_TRANSISTOR_AMPLIFIER: dict[str, float] = {
    "U[0]": -0.5562145012262709e-2, "U[1]": 0.3006522471903042e1, "U[2]": 0.2849958788608128e1,
    "U[3]": 0.2926422536206241e1, "U[4]": 0.2704617865010554e1, "U[5]": 0.2761837778393145e1,
    "U[6]": 0.4770927631616772e1, "U[7]": 0.1236995868091548e1,
}  # fmt: skip
_HIRES: dict[str, float] = {
    "y[0]": 0.7371312573325668e-3, "y[1]": 0.1442485726316185e-3, "y[2]": 0.5888729740967575e-4,
    "y[3]": 0.1175651343283149e-2, "y[4]": 0.2386356198831331e-2, "y[5]": 0.6238968252742796e-2,
    "y[6]": 0.2849998395185769e-2, "y[7]": 0.2850001604814231e-2,
}  # fmt: skip

PROBLEMS: dict[str, Problem] = {
    "robertson": Problem(Robertson, _ROBERTSON, 14, "Bari test set: rober", floor=1e-6),
    "pollution": Problem(Pollution, _POLLUTION, 15, "Bari test set: pollu; RADAU5, tolerance 1.1e-18"),
    "vanderpol": Problem(VanDerPol, _VANDERPOL, 14, "Bari test set: vdpolm"),
    "oregonator": Problem(Oregonator, _OREGONATOR, 13, "Bari test set: orego"),
    # The published values, 7e-4 away, contradict the invariant y2 - y3 - y4 = 0.
    "e5": Problem(E5, _E5, 9, "invariant-reduced system: CVODES and IDAS at 1e-12, Radau at 1e-10 agree", floor=0.0),
    "chemical_akzo_nobel": Problem(ChemicalAkzoNobel, _CHEMICAL_AKZO_NOBEL, 15, "Bari test set: chemakzo", index=1),
    "ring_modulator": Problem(RingModulator, _RING_MODULATOR, 9, "Bari test set: ringmod; RADAU, tolerance 1e-12"),
    "andrews_squeezer": Problem(AndrewsSqueezer, _ANDREWS_SQUEEZER, 13, "Bari test set: andrews; PSIDE", index=3),
    "car_axis": Problem(CarAxis, _CAR_AXIS, 16, "Bari test set: caraxis; GAMD, quadruple precision", index=3),
    "planar_pendulum": Problem(PlanarPendulum, _PLANAR_PENDULUM, 16, "exact: complete elliptic integral", index=3),
    "fekete_points": Problem(FeketePoints, _FEKETE_POINTS, 12, "Bari test set: fekete; RADAU5, 1e-12", index=2),
    # The published values (DASSL at 1e-9) are 5e-8 to 6e-6 away from these.
    "wheelset": Problem(Wheelset, _WHEELSET, 8, "IDAS at 1e-12, 118262 steps", index=2),
    "charge_pump": Problem(ChargePump, _CHARGE_PUMP, 16, "closed form, left limit", floor=0.0, index=2),
    "transistor_amplifier": Problem(TransistorAmplifier, _TRANSISTOR_AMPLIFIER, 13, "Bari test set: transamp", index=1),
    "hires": Problem(Hires, _HIRES, 14, "Bari test set: hires"),
    "pleiades": Problem(Pleiades, _PLEIADES, 15, "Bari test set: plei; PSIDE, 1e-16", stiff=False),
}
