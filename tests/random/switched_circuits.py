"""Random circuits of ideal switches, and their exact solution: linear between events, by eigenvalues.

In every combination of modes a circuit is linear, E x' = A x + B u with x the voltages of capacitors and currents of
inductors and u made of constants and sines, which are states of a generator here; so x is a sum of exponentials. A
combination holds if every diode's path parameter s (the current while conducting, the voltage while blocking; Clauss et
al., AEU 40, 1995) has the sign that its mode asks for, or is zero and about to: found by trying all of them, the linear
complementarity problem by enumeration. Events are the first zeros of s on the exact solution. Modified nodal analysis
(Ho, Ruehli, Brennan, IEEE Trans. Circuits and Systems 22, 1975) with capacitors as sources of voltage and inductors as
sources of current.
"""

from __future__ import annotations

import random
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

Array = NDArray[np.float64]
SWITCHING = ("diode", "thyristor", "closing", "opening")
# A path parameter below this share of what it could be is zero but for rounding.
_ZERO = 1e-9


class Discard(Exception):
    """The circuit is no test: singular, badly conditioned, grazing, or with more than one solution."""


@dataclass(frozen=True)
class Branch:
    """One element from node a to node b with the numbers of its kind.

    R, L (with its current), C (with its voltage), V: constant or `amplitude, frequency, phase`; diode `Ron, Goff`;
    the others `Ron, Goff` and windows of time in which they are fired or controlled.
    """

    kind: str
    a: int
    b: int
    values: tuple[float, ...]
    windows: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True)
class Circuit:
    """Branches between the nodes 0 (ground) to `nodes - 1`."""

    nodes: int
    branches: tuple[Branch, ...]
    stop: float

    def of(self, *kinds: str) -> list[int]:
        return [k for k, b in enumerate(self.branches) if b.kind in kinds]


@dataclass
class Exact:
    """States (capacitors, then inductors) and voltages of the switching elements at asked times; all events."""

    times: Array
    states: Array
    voltages: Array
    events: list[float]


def random_circuit(seed: int) -> Circuit:
    """The circuit of one seed: a tree over all nodes, then more branches; one to five diodes, switches, thyristors."""
    draw = random.Random(seed)
    nodes = draw.randint(3, 5)
    n_ideal = draw.randint(1, 5)
    kinds = ["V"] + [
        draw.choice(["diode", "diode", "diode", "thyristor", "closing", "opening"]) for _ in range(n_ideal)
    ]
    kinds += [draw.choice(["C", "L"]) for _ in range(draw.randint(1, 3))]
    kinds += ["R"] * draw.randint(1, 3) + (["V"] if draw.random() < 0.2 else [])
    if not any(k == "diode" for k in kinds):
        kinds.append("diode")
    body = kinds[1:]
    draw.shuffle(body)
    stop = 0.05
    branches = []
    for k, kind in enumerate(["V", *body]):
        if k < nodes - 1:
            a, b = draw.randint(0, k), k + 1
        else:
            a, b = draw.sample(range(nodes), 2)
        if draw.random() < 0.5:
            a, b = b, a
        branches.append(Branch(kind, a, b, _values(draw, kind), _windows(draw, kind, stop)))
    return Circuit(nodes, tuple(branches), stop)


def _values(draw: random.Random, kind: str) -> tuple[float, ...]:
    if kind == "R":
        return (draw.choice([1.0, 10.0, 33.0, 100.0, 1000.0]),)
    if kind == "L":
        return (draw.choice([1e-3, 1e-2, 0.1]), draw.choice([0.0, 0.0, 0.1]))
    if kind == "C":
        return (draw.choice([1e-5, 1e-4, 1e-3]), draw.choice([0.0, 0.0, 1.0, -2.0]))
    if kind == "V":
        return (draw.choice([5.0, 10.0]), draw.choice([0.0, 50.0, 50.0, 120.0]), draw.choice([0.3, 1.0, 2.5, 4.0]))
    return (draw.choice([1e-5, 1e-3, 1e-1]), draw.choice([1e-5, 1e-5, 1e-3]))


def _windows(draw: random.Random, kind: str, stop: float) -> tuple[tuple[float, float], ...]:
    if kind in ("R", "L", "C", "V", "diode"):
        return ()
    edges = sorted(round(draw.uniform(0.01, 0.99) * stop, 5) for _ in range(2 * draw.randint(1, 3)))
    return tuple(zip(edges[::2], edges[1::2], strict=True))


Mode = tuple[bool, ...]


class Solver:
    """The exact solution of one circuit."""

    def __init__(self, circuit: Circuit) -> None:
        self.circuit = circuit
        self.ideal = circuit.of(*SWITCHING)
        self.capacitors, self.inductors, self.sources = circuit.of("C"), circuit.of("L"), circuit.of("V")
        self.n = len(self.capacitors) + len(self.inductors)
        if not self.n:
            raise Discard("no states")
        self.linear: dict[Mode, tuple[Array, Array, Array]] = {}
        self.spectra: dict[Mode, tuple[NDArray[np.complex128], NDArray[np.complex128], NDArray[np.complex128]]] = {}
        self.dead: set[int] = set()
        # the generator: 1, then sine and cosine of each source
        self.w_size = 1 + 2 * len(self.sources)
        self.generator = np.zeros((self.w_size, self.w_size))
        for j, k in enumerate(self.sources):
            omega = 2 * np.pi * circuit.branches[k].values[1]
            self.generator[1 + 2 * j, 2 + 2 * j], self.generator[2 + 2 * j, 1 + 2 * j] = omega, -omega

    def start(self) -> Array:
        b = self.circuit.branches
        w = [1.0]
        for k in self.sources:
            w += [np.sin(b[k].values[2]), np.cos(b[k].values[2])]
        return np.array([b[k].values[1] for k in (*self.capacitors, *self.inductors)] + w)

    def system(self, mode: Mode) -> tuple[Array, Array, Array]:
        """`(A, S, V)` with X' = A X, path parameters S X and voltages V X of the switching elements."""
        if mode in self.linear:
            return self.linear[mode]
        c, n = self.circuit, self.n
        fixed_v = [*self.capacitors, *self.sources]
        size = c.nodes - 1 + len(fixed_v)
        m, right = np.zeros((size, size)), np.zeros((size, n + self.w_size))

        def stamp(a: int, b: int, g: float) -> None:
            for i, j, s in ((a, a, g), (b, b, g), (a, b, -g), (b, a, -g)):
                if i and j:
                    m[i - 1, j - 1] += s

        for k, b in enumerate(c.branches):
            if b.kind == "R":
                stamp(b.a, b.b, 1 / b.values[0])
            elif k in self.ideal:
                stamp(b.a, b.b, b.values[1] if mode[self.ideal.index(k)] else 1 / b.values[0])
            elif b.kind == "L":
                column = len(self.capacitors) + self.inductors.index(k)
                for node, s in ((b.a, -1.0), (b.b, 1.0)):
                    if node:
                        right[node - 1, column] += s
        for j, k in enumerate(fixed_v):
            b, row = c.branches[k], c.nodes - 1 + j
            for node, s in ((b.a, 1.0), (b.b, -1.0)):
                if node:
                    m[row, node - 1] += s
                    m[node - 1, row] += s
            if b.kind == "C":
                right[row, self.capacitors.index(k)] = 1.0
            elif b.values[1] == 0:
                right[row, n] = b.values[0]
            else:
                right[row, n + 1 + 2 * self.sources.index(k)] = b.values[0]
        scale = np.sqrt(np.abs(np.diag(m)))
        scale[scale == 0] = 1.0
        if np.linalg.cond(m / scale[:, None] / scale) > 1e12:
            raise Discard("singular")
        y = np.linalg.solve(m, right)
        potential = np.vstack([np.zeros(n + self.w_size), y[: c.nodes - 1]])
        a_matrix = np.zeros((n + self.w_size, n + self.w_size))
        a_matrix[n:, n:] = self.generator
        for j, k in enumerate(self.capacitors):
            a_matrix[j] = y[c.nodes - 1 + j] / c.branches[k].values[0]
        for j, k in enumerate(self.inductors, len(self.capacitors)):
            b = c.branches[k]
            a_matrix[j] = (potential[b.a] - potential[b.b]) / b.values[0]
        v = np.array([potential[c.branches[k].a] - potential[c.branches[k].b] for k in self.ideal])
        paths = v.copy()
        for j, (k, off) in enumerate(zip(self.ideal, mode, strict=True)):
            if not off:
                paths[j] /= c.branches[k].values[0]
        self.linear[mode] = a_matrix, paths, v
        return self.linear[mode]

    def spectrum(self, mode: Mode) -> tuple[NDArray[np.complex128], NDArray[np.complex128], NDArray[np.complex128]]:
        if mode not in self.spectra:
            values, vectors = np.linalg.eig(self.system(mode)[0])
            vectors = vectors.astype(complex)
            size = np.abs(vectors).max(axis=0)
            vectors /= size
            if np.linalg.cond(vectors) > 1e9:
                raise Discard("defective")
            if (values.real > 1e-3 * (1 + np.abs(values))).any():
                raise Discard("unstable by rounding")
            self.spectra[mode] = values.astype(complex), vectors, np.linalg.inv(vectors)
        return self.spectra[mode]

    def at(self, mode: Mode, x: Array, times: Array) -> Array:
        """X at times from now, one column each."""
        values, vectors, inverse = self.spectrum(mode)
        return np.real(vectors @ (np.exp(np.outer(values, times)) * (inverse @ x)[:, None]))

    def commanded(self, k: int, t: float) -> bool:
        """Whether an element is fired or controlled just after t."""
        return any(a <= t + 1e-12 < b for a, b in self.circuit.branches[k].windows)

    def mode_at(self, t: float, x: Array, before: Mode) -> Mode:
        """The one combination that holds just after t."""
        choices: list[Mode] = []
        for j, k in enumerate(self.ideal):
            kind = self.circuit.branches[k].kind
            if kind == "closing":
                choices.append((not self.commanded(k, t),))
            elif kind == "opening":
                choices.append((self.commanded(k, t),))
            elif kind == "thyristor" and before[j] and not self.commanded(k, t):
                choices.append((True,))
            else:
                choices.append((False, True))
        found: list[tuple[Mode, set[int]]] = []
        for mode in product(*choices):
            dead = self.holds(t, x, mode, before)
            if dead is not None:
                found.append((mode, dead))
        # an element without voltage and current may be in either mode: it stays in its own
        kept = [f for f in found if all(f[0][j] == before[j] for j in f[1])]
        found = kept or found
        if len(found) != 1:
            raise Discard(f"{'no' if not found else 'more than one'} combination holds")
        self.dead = found[0][1]
        return found[0][0]

    def free(self, j: int, t: float, mode: Mode) -> bool:
        """Whether the sign of s decides element j: switches and thyristors that are not fired stay as they are."""
        kind = self.circuit.branches[self.ideal[j]].kind
        if kind == "thyristor":
            return not mode[j] or self.commanded(self.ideal[j], t)
        return kind == "diode"

    def holds(self, t: float, x: Array, mode: Mode, before: Mode) -> set[int] | None:
        """None unless every s has the sign of its mode: now, or, where it is zero, as soon as it is not.

        Returns the elements whose s stays zero.
        """
        s = self.system(mode)[1]
        near = []
        for j in range(len(self.ideal)):
            # one that conducted just before goes on doing so unless s is negative
            if self.free(j, t, before):
                value = float(s[j] @ x) * (-1.0 if mode[j] else 1.0)
                if abs(value) < _ZERO * self.size(s[j], x):
                    near.append(j)
                elif value < 0:
                    return None
        dead: set[int] = set()
        if not near:
            return dead
        soon = s[near] @ self.at(mode, x, np.geomspace(1e-10, 0.2 * self.circuit.stop, 400))
        for j, row in zip(near, soon, strict=True):
            row = row * (-1.0 if mode[j] else 1.0)
            clear = np.flatnonzero(np.abs(row) > _ZERO * self.size(s[j], x))
            if not len(clear):
                dead.add(j)
            elif row[clear[0]] < 0:
                return None
        return dead

    @staticmethod
    def size(row: Array, x: Array) -> float:
        """What s could be: volts and amperes are of the order of one."""
        return float(np.abs(row) @ np.maximum(np.abs(x), 0.1))

    def next_event(self, t: float, x: Array, mode: Mode) -> float:
        """Time from now at which s of a free element passes zero; at most up to the next command."""
        c = self.circuit
        edges = [e for k in self.ideal for w in c.branches[k].windows for e in w] + [c.stop]
        until = min(e for e in edges if e > t + 1e-12) - t
        values = self.spectrum(mode)[0]
        fast = max((abs(v.imag) for v in values if abs(v.real) * until < 50 * (1 + abs(v.imag) * until)), default=0.0)
        count = int(np.clip(20 * fast * until / np.pi, 1500, 40000))
        grid = np.unique(np.concatenate([np.geomspace(1e-11, until, 1200), np.linspace(0, until, count)[1:]]))
        signals = self.system(mode)[1] @ self.at(mode, x, grid)
        first = until
        for j in range(len(self.ideal)):
            if not self.free(j, t, mode):
                continue
            sign = -1.0 if mode[j] else 1.0
            s = sign * signals[j]
            size = np.abs(s).max() + 1e-300
            if j in self.dead and size < _ZERO * self.size(self.system(mode)[1][j], x):
                continue
            # what has just begun at zero is judged once it is clear of rounding
            clear = np.flatnonzero(s > _ZERO * size)
            wrong = np.flatnonzero(s < -_ZERO * size)
            if len(wrong) and (not len(clear) or wrong[0] < clear[0]):
                raise Discard("leaves its mode at once")
            inner = s[1:-1]
            dips = (inner < s[:-2]) & (inner < s[2:]) & (inner > 0) & (inner < 1e-5 * size)
            if len(clear) and (np.flatnonzero(dips) > clear[0]).any():
                raise Discard("touches")
            if not len(wrong):
                continue
            k = wrong[0]
            i = int(clear[clear < k][-1])

            def path(tau: float, j: int = j, sign: float = sign) -> float:
                return sign * float(self.system(mode)[1][j] @ self.at(mode, x, np.array([tau]))[:, 0])

            root = float(brentq(path, grid[i], grid[k], xtol=1e-16, rtol=1e-14))
            first = min(first, root)
        return first

    def solve(self, times: Array) -> Exact:
        t, x = 0.0, self.start()
        mode: Mode = tuple(True for _ in self.ideal)
        mode = self.mode_at(t, x, mode)
        states, voltages = np.zeros((len(times), self.n)), np.zeros((len(times), len(self.ideal)))
        events: list[float] = []
        while True:
            span = self.next_event(t, x, mode)
            last = t + span > self.circuit.stop * (1 - 1e-12)
            here = np.flatnonzero((times >= t) & ((times < t + span) | last))
            if len(here):
                columns = self.at(mode, x, times[here] - t)
                states[here] = columns[: self.n].T
                voltages[here] = (self.system(mode)[2] @ columns).T
            if last:
                return Exact(times, states, voltages, events)
            x = self.at(mode, x, np.array([span]))[:, 0]
            t += span
            # the generator is exact
            for j, k in enumerate(self.sources):
                omega, phase = 2 * np.pi * self.circuit.branches[k].values[1], self.circuit.branches[k].values[2]
                x[self.n + 1 + 2 * j : self.n + 3 + 2 * j] = np.sin(omega * t + phase), np.cos(omega * t + phase)
            mode = self.mode_at(t, x, mode)
            events.append(t)
            if len(events) > 200:
                raise Discard("too many events")


def exact(circuit: Circuit, rows: int = 200) -> Exact:
    """The solution at the ends of `rows` equal intervals."""
    return Solver(circuit).solve(circuit.stop * np.arange(rows + 1) / rows)
