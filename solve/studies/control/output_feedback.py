"""Output feedback for digital controllers: gains that are constant or have a few harmonics, a delay, and
resonators at harmonics of the drive. Derivatives with respect to the gains are available."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Any, NamedTuple, Self

import numpy as np

from solve.arguments import matches_annotations, require_integer, unique_names
from solve.arrays import Array
from solve.contracts import Columns, Dependence, Matrices, ParameterDerivatives
from solve.equations import derivatives_of, input_matrix
from solve.errors import ControlError, MissingValueError, NoDerivativeError, SolveError, ValueOutOfBoundsError
from solve.studies.control.feedback import FeedbackLoop
from solve.studies.control.plant import Plant
from solve.system import PeriodicSystem, relabelled
from solve.units import in_unit, speed_in_si

_DAMPING = 0.01
"""Damping ratio of resonators. Chosen by judgement: the gain at resonance is 50 times that at frequency 0."""


_WIDTH = 0.5
"""Damping ratio of notch filters. Chosen by judgement: half of the amplitude remains at 0.75 and 1.33 times
the notch frequency."""


class _Section(NamedTuple):
    """Filter of a signal w: a section of a delay, or a notch. Its output is w − c ż, where z̈ + b ż + a z = a
    w."""

    a: float
    b: float
    c: float


class Gain(NamedTuple):
    """Gain from a signal to an input, multiplied by one of the functions 1, cos φ, sin φ, cos 2φ, …. `input`,
    `signal` and `wave` are the indices of the input, the signal and the function; `base` is the name of the
    constant gain to which the gain belongs."""

    input: int
    signal: int
    wave: int
    unit: str
    base: str


class OutputFeedback(FeedbackLoop):
    """System with the feedback u = −Σ g(φ) w of measured outputs w; the gains g are parameters of the loop.

    Parameters
    ----------
    system : PeriodicSystem
        System with inputs whose coordinates are all of second order.
    measured : sequence of str
        Names of states, such as q1 and q1_dot, and of outputs.
    harmonics : int
        Highest harmonic of the gains; 0 for constant gains.
    delay : float or str
        Delay of the measured outputs in s, or a string with a unit. A digital controller that computes during
        one sampling period T, and then holds its output, delays the outputs by 1.5 T.
    sections : int
        Number of equal sections into which the delay is divided.
    resonators : sequence of int
        Harmonics at which resonators amplify the measured outputs, for repetitive control.
    notches : sequence of float or str
        Frequencies that filters remove from the measured outputs, in rad/s or as strings with a unit, such as
        "18 Hz".

    Raises
    ------
    ControlError
        If the system has no inputs, or has first-order states.
    SolveError
        Other subclasses for bad input.

    Notes
    -----
    Gains have the names u_by_q1 and, for the harmonics, u_by_q1_cos1 and u_by_q1_sin1. They are initially
    zero; `varied` and `solve.optimise` change them. A section of the delay is Padé's approximant
    1 − sτ/(1 + sτ/2 + s²τ²/12) of exp(−sτ), whose error at the frequency ω is (ωτ)⁵/720. A resonator
    z̈ + 2ζω ż + ω² z = ω² w at a harmonic ω with ζ = 0.01 has two gains: u_by_q1_res2 of z, and
    u_by_q1_res2_dot of ż/ω. A notch at ω is (s² + ω²)/(s² + ωs + ω²).

    Examples
    --------
    >>> import solve
    >>> loop = OutputFeedback(solve.load("manipulator"), ["q1_dot"], delay="0.5 ms")
    >>> list(loop.gains)
    ['u_by_q1_dot']
    >>> solve.floquet(loop.varied({"u_by_q1_dot": 100.0}), "50 rpm").stable
    True
    """

    @matches_annotations
    def __init__(
        self,
        system: PeriodicSystem,
        measured: Sequence[str],
        harmonics: int = 0,
        delay: float | str = 0.0,
        sections: int = 1,
        resonators: Sequence[int] = (),
        notches: Sequence[float | str] = (),
    ):
        if not isinstance(system, PeriodicSystem) or not system.inputs or system.states:
            raise ControlError(
                "output feedback requires a system with inputs and without first-order states, such as "
                f"solve.load('manipulator'), not {system!r}"
            )
        require_integer("harmonics", harmonics, 0)
        require_integer("sections", sections)
        for order in resonators:
            require_integer("harmonic of a resonator", order)
        self.measured, self.resonators = unique_names(measured), tuple(dict.fromkeys(resonators))
        if not self.measured:
            raise MissingValueError("'measured' is empty; name states or outputs, such as q1_dot")
        Plant(system, 1.0).require_names(self.measured)
        self.delay = in_unit(delay, "s", "delay")
        if not 0 <= self.delay < np.inf:
            raise ValueOutOfBoundsError(f"delay is {delay!r}; allowed: numbers of at least 0")
        self._sections = [_notch(each) for each in notches]
        kinds = [f"notch{k + 1}" for k in range(len(self._sections))]
        if self.delay:
            tau = self.delay / sections
            self._sections += [_Section(12 / tau**2, 6 / tau, tau)] * sections
            kinds += [f"late{k + 1}" for k in range(sections)]
        late = [f"{name}_{kind}" for kind in kinds for name in self.measured]
        added = [f"{name}_res{order}" for order in self.resonators for name in self.measured]
        self.gain_terms = _terms(system, self.measured, harmonics, self.resonators)
        self._waves, self.gains = harmonics, dict.fromkeys(self.gain_terms, 0.0)
        super().__init__(system, [*late, *added])

    def _take(self, system: PeriodicSystem) -> None:
        super()._take(system)
        labels = system.labels
        gains = {name: (term.unit, "gain of the feedback") for name, term in self.gain_terms.items()}
        added = {name: labels.units.get(name.rpartition("_")[0], "") for name in self.coordinates[system.n :]}
        self.labels = replace(
            self.labels,
            parameters={**labels.parameters, **self.gains},
            parameter_labels={**labels.parameter_labels, **gains},
            units={**self.labels.units, **added},
        )

    @matches_annotations
    def varied(
        self, parameters: Mapping[str, Any] | None = None, options: Mapping[str, Any] | None = None
    ) -> Self:
        """Closed loop in which some gains, parameters or options of the system are changed."""
        changes = dict(parameters or {})
        gains = {name: float(changes.pop(name)) for name in self.gains if name in changes}
        changed = super().varied(changes, options)
        changed.gains = {**self.gains, **gains}
        return relabelled(changed, parameters={**changed.labels.parameters, **changed.gains})

    def require_bounds(self, parameters: Mapping[str, float]) -> None:
        super().require_bounds({name: value for name, value in parameters.items() if name not in self.gains})

    def bounds_of_gains(self, bounds: Mapping[str, Any]) -> dict[str, Any]:
        """Bounds of gains. The bounds of u_by_q1 also apply to the other gains from q1 to u that have no
        bounds in `bounds`."""
        of_families = {
            name: bounds[gain.base] for name, gain in self.gain_terms.items() if gain.base in bounds
        }
        return {**of_families, **bounds}

    @property
    def derivatives(self) -> ParameterDerivatives:
        """Derivatives with respect to the gains. None are available for equations linearised about a
        motion."""
        return GainDerivatives(self) if self.open_loop is self.model else super().derivatives

    def waves(self, phase: Array) -> Array:
        """Functions 1, cos φ, sin φ, cos 2φ, … (k, w) at phases (k,), where φ is the phase scaled to 2π per
        period."""
        angles = phase[:, None] * (2 * np.pi / self.model.period * np.arange(1, self._waves + 1))
        waves = np.stack((np.cos(angles), np.sin(angles)), axis=-1).reshape(len(phase), -1)
        return np.concatenate((np.ones((len(phase), 1)), waves), axis=1)

    def signals(self, phase: Array, speed: Any) -> tuple[Array, Array, Array]:
        """Return three arrays. The first contains the coefficients (k, s, 2, n) of velocities and coordinates
        in the s signals that the gains multiply. The others are C and K (k, a, n) of the equations of filters
        and resonators; M of these equations is the identity."""
        k, n, y = len(phase), self.model.n, len(self.measured)
        rows = np.zeros((k, y, 2, self.n))
        measured = Plant(self.design, speed).rows(self.measured, phase)
        rows[:, :, 1, :n], rows[:, :, 0, :n] = measured[..., :n], measured[..., n:]
        equations, signals = np.zeros((k, self.n - n, 2, self.n)), []
        at = np.arange(y)
        for section in self._sections:
            equations[:, at] -= section.a * rows
            equations[:, at, 0, n + at] += section.b
            equations[:, at, 1, n + at] += section.a
            rows[:, range(y), 0, n + at] -= section.c
            at = at + y
        for order in self.resonators:
            omega = np.broadcast_to(order * 2 * np.pi / self.model.period * speed, k)[:, None]
            equations[:, at] -= omega[:, None, None] ** 2 * rows
            equations[:, at, 0, n + at] += 2 * _DAMPING * omega
            equations[:, at, 1, n + at] += omega**2
            resonant = np.zeros((2, k, y, 2, self.n))
            resonant[0][:, range(y), 1, n + at], resonant[1][:, range(y), 0, n + at] = 1.0, 1 / omega
            signals += list(resonant)
            at = at + y
        return np.concatenate((rows, *signals), axis=1), equations[:, :, 0], equations[:, :, 1]

    def gain_matrix(self, phase: Array) -> Array:
        """Return the gains (k, r, s) from signals to inputs, at phases (k,)."""
        waves, last = self.waves(phase), max(term.signal for term in self.gain_terms.values()) + 1
        gains = np.zeros((len(phase), len(self.model.inputs), last))
        for name, term in self.gain_terms.items():
            gains[:, term.input, term.signal] += self.gains[name] * waves[:, term.wave]
        return gains

    def closed(
        self,
        phase: Array,
        speed: Any,
        matrices: Matrices,
        inputs: Array,
        observed: Callable[[], tuple[Matrices, Array]],
    ) -> Matrices:
        n, m, k = self.n_open, self.n, len(phase)
        signals, damping, stiffness = self.signals(phase, speed)
        force = np.einsum("knr,krs->kns", inputs, self.gain_matrix(phase))
        M, C, K = (np.zeros((k, m, m)) for _ in range(3))
        M[:, :n, :n], C[:, :n, :n], K[:, :n, :n] = matrices[:3]
        M[:, range(n, m), range(n, m)], C[:, n:], K[:, n:] = 1.0, damping, stiffness
        C[:, :n] += force @ signals[:, :, 0]
        K[:, :n] += force @ signals[:, :, 1]
        return M, C, K, np.concatenate((matrices[3], np.zeros((k, m - n))), axis=1)

    def inputs_of(self, phase: Array, speed: Any, q: Array, qd: Array) -> Array:
        signals = self.signals(phase, speed)[0]
        values = np.einsum("kscn,cnk->ks", signals, np.stack((qd, q)))
        return -np.einsum("krs,ks->rk", self.gain_matrix(phase), values)


def _notch(frequency: float | str) -> _Section:
    """Return the filter that removes a frequency. Raises ValueOutOfBoundsError."""
    try:
        omega = float(speed_in_si(frequency))
    except SolveError:
        raise ValueOutOfBoundsError(
            f"notch is {frequency!r}; allowed: frequencies > 0 in rad/s, or with unit, such as '18 Hz'"
        ) from None
    return _Section(omega**2, 2 * _WIDTH * omega, 2 * _WIDTH / omega)


def _terms(
    system: PeriodicSystem, measured: Sequence[str], harmonics: int, resonators: Sequence[int]
) -> dict[str, Gain]:
    """Return a mapping from names to gains. The indices of signals refer to `OutputFeedback.signals`."""
    waves = ["", *(f"_{wave}{k}" for k in range(1, harmonics + 1) for wave in ("cos", "sin"))]
    resonant = [f"_res{order}{rate}" for order in resonators for rate in ("", "_dot")]
    kinds = [(0, at, wave) for at, wave in enumerate(waves)]
    kinds += [(at, 0, suffix) for at, suffix in enumerate(resonant, start=1)]
    terms = {}
    for (at, u), (place, y), (block, wave, suffix) in product(
        enumerate(system.inputs), enumerate(measured), kinds
    ):
        unit = _unit(system, u, y)
        base = f"{u}_by_{y}"
        terms[base + suffix] = Gain(at, block * len(measured) + place, wave, unit, base)
    return terms


def _unit(system: PeriodicSystem, u: str, y: str) -> str:
    """Return the unit of a gain, such as N m s/rad; empty if the unit of the measured quantity is itself a
    quotient."""
    state = y.removesuffix("_dot") if y not in system.labels.units else y
    of_input, of_state = system.labels.units.get(u, ""), system.labels.units.get(state, "")
    if not of_input or "/" in of_state:
        return ""
    return f"{of_input}{'' if state == y else ' s'}{f'/{of_state}' if of_state not in ('', '1') else ''}"


class GainDerivatives:
    """Derivatives of output feedback with respect to its gains; see `ParameterDerivatives`."""

    @matches_annotations
    def __init__(self, loop: OutputFeedback):
        self._loop = loop

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the gains."""
        return tuple(self._loop.gains)

    def of_breaks(self, names: Sequence[str]) -> Array:
        """Zeros (b, r): breaks do not depend on gains."""
        return np.zeros((len(self._loop.breaks), len(names)))

    def by(self, names: Sequence[str], compiled: Columns | None = None) -> "GainDependence":
        """Return the derivatives with respect to gains. Raises NoDerivativeError for other parameters."""
        for name in names:
            if name not in self._loop.gains:
                raise NoDerivativeError(
                    f"derivatives of output feedback with respect to {name} are not available; allowed: "
                    f"{', '.join(self.names)}"
                )
        return GainDependence(self._loop, tuple(names))


class GainDependence(Dependence):
    """Derivatives of the equations and outputs with respect to gains; see `Dependence`."""

    linear = partial_outputs = True

    @matches_annotations
    def __init__(self, loop: OutputFeedback, names: Sequence[str]):
        terms = [loop.gain_terms[name] for name in names]
        self._loop, self._input = loop, [term.input for term in terms]
        self._signal, self._wave = [term.signal for term in terms], [term.wave for term in terms]

    def residual(self, phase: Array, speed: float, states: Array) -> Array:
        loop, n = self._loop, self._loop.model.n
        derivatives = np.zeros((len(phase), loop.n, len(self._input)))
        B = input_matrix(loop.model, phase, speed)
        derivatives[:, :n] = B[:, :, self._input] * -self._of_input(phase, speed, states)[:, None]
        return derivatives

    def matrices(self, phase: Array, speed: float, states: Array, weights: Array) -> tuple[Array, Array]:
        loop, n = self._loop, self._loop.model.n
        B, signals = input_matrix(loop.model, phase, speed), loop.signals(phase, speed)[0]
        along = np.einsum("kna,kcnm->kacm", B, weights[:, 1:, :n]) * np.array([speed, 1.0])[:, None]
        sums = np.einsum("kacm,kscm->kas", along, signals)
        chosen = sums[:, self._input, self._signal] * loop.waves(phase)[:, self._wave]
        return chosen.sum(axis=0), np.zeros_like(states)

    def output(self, name: str, phase: Array, speed: float, states: Array) -> tuple[Array, Array]:
        loop, n = self._loop, self._loop.model.n
        by, by_states = np.zeros((len(phase), len(self._input))), np.zeros((len(phase), 3, loop.n))
        if name not in loop.model.inputs:
            open_loop = derivatives_of(loop.model).by(())
            by_states[..., :n] = open_loop.output(name, phase, speed, states[..., :n])[1]
            return by, by_states
        at = loop.model.inputs.index(name)
        by = np.where(np.array(self._input) == at, self._of_input(phase, speed, states), 0.0)
        gains = -loop.gain_matrix(phase)[:, at]
        by_states[:, 1:] = np.einsum("ks,kscn->kcn", gains, loop.signals(phase, speed)[0])
        by_states[:, 1] *= speed
        return by, by_states

    def _of_input(self, phase: Array, speed: float, states: Array) -> Array:
        """Return an array (k, r) with one column per gain: the derivative, with respect to the gain, of the
        input on which the gain acts."""
        loop = self._loop
        rates = np.array([speed, 1.0])[:, None] * states[:, 1:]
        values = np.einsum("kscn,kcn->ks", loop.signals(phase, speed)[0], rates)
        return -values[:, self._signal] * loop.waves(phase)[:, self._wave]
