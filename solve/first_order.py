"""Systems with first-order states, which have no second derivatives: ẋ = A(Ωt)x + b(Ωt), and mixed systems.

In the form M q̈ + C q̇ + K q = d, first-order coordinates come last, and their columns of M are zero. A
system ẋ = A x + b has M = 0, C = 1, K = -A and d = b."""

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from solve.arguments import matches_annotations
from solve.arrays import Array
from solve.capabilities import Capabilities, Evaluation, Outputs
from solve.contracts import Matrices
from solve.equations import entries_of
from solve.errors import MatricesError, ValueOutOfBoundsError
from solve.matrices import checked_phases, leading, require_inertia, require_shapes
from solve.samples import sampled
from solve.system import PeriodicSystem, require_own_names

Signals = tuple[Array, Array, Array, Sequence[str], Sequence[str]]
"""Samples B (k, N, r), C (k, y, N) and D (k, y, r) of a first-order system, followed by the names of its
inputs and of its outputs."""


class FirstOrderSystem(PeriodicSystem, Evaluation, Outputs):
    """System ẋ = A(Ωt)x + B(Ωt)u + b(Ωt), y = C(Ωt)x + D(Ωt)u with named states.

    Parameters
    ----------
    matrices : callable
        matrices(phase, speed) returns A of shape (m, N, N) and b of shape (m, N) for phases φ = Ωt of shape
        (m,) and a speed Ω in rad/s. Units are SI, derivatives with respect to time. If inputs or outputs are
        named, it returns A, b, B (m, N, r), C (m, y, N) and D (m, y, r).
    states : sequence of str
        Names of the N states.
    period : float
        Period of the matrices in phase.
    breaks : sequence of float
        Phases at which the matrices jump; see `PeriodicSystem`.
    inputs, outputs : sequence of str
        Names of the r inputs u and the y outputs. Results are for u = 0; exports contain B, C and D.

    Raises
    ------
    ValueOutOfBoundsError
        If names, period or breaks are invalid.

    Notes
    -----
    The states are the coordinates of orbits: `x` is `q`, and `xd` is `qd`.

    Examples
    --------
    >>> def filtered(phase, speed):
    ...     A = np.full((len(phase), 1, 1), -2.0)
    ...     return A, np.cos(phase)[:, None]
    >>> FirstOrderSystem(filtered, ["x"]).states
    ('x',)
    """

    @matches_annotations
    def __init__(
        self,
        matrices: Callable[[Array, float], Sequence[Array]],
        states: Sequence[str],
        period: float = 2 * math.pi,
        breaks: Sequence[float] = (),
        inputs: Sequence[str] = (),
        outputs: Sequence[str] = (),
    ):
        super().__init__(matrices, states, period, breaks)
        for kind, names in (("inputs", inputs), ("outputs", outputs)):
            require_own_names(kind, names, self.coordinates)
        self.states, self.inputs, self.outputs = self.coordinates, tuple(inputs), tuple(outputs)
        self._symbols = "AbBCD" if inputs or outputs else "Ab"

    @classmethod
    def from_samples(  # type: ignore[override]
        cls,
        A: Array,
        b: Array,
        states: Sequence[str],
        phases: Sequence[float] | Array | None = None,
        period: float = 2 * math.pi,
        signals: Signals | None = None,
    ) -> "FirstOrderSystem":
        """Create a system from samples at azimuths of the period, see `PeriodicSystem.from_samples`.

        Parameters
        ----------
        A : (k, N, N) array
            Samples in SI units, valid at the speed at which they were taken.
        b : (k, N) array
            Samples of the load.
        states : sequence of str
            Names of the N states.
        phases : (k,) array, optional
            Azimuths in rad. By default, they are uniform from 0, without the end of the period.
        period : float
            Period in phase.
        signals : tuple, optional
            Tuple (B, C, D, inputs, outputs): samples B (k, N, r), C (k, y, N) and D (k, y, r), and the names
            of the inputs and outputs.

        Returns
        -------
        FirstOrderSystem

        Raises
        ------
        MatricesError
            As `PeriodicSystem.from_samples`.

        Examples
        --------
        >>> A = np.full((8, 1, 1), -2.0)
        >>> FirstOrderSystem.from_samples(A, A[:, 0], ["x"]).states
        ('x',)
        """
        arrays, inputs, outputs = (A, b), (), ()
        if signals is not None:
            *matrices, inputs, outputs = signals
            arrays = (A, b, *matrices)
        samples = sampled(arrays, "AbBCD"[: len(arrays)], period, phases)
        return cls(samples, states, samples.period, (), inputs, outputs)

    def equations_at(self, phase: Array, speed: float) -> list[Array]:
        """Return matrices A (m, N, N) and b (m, N) at phases (m,). If inputs or outputs are named, also
        return B (m, N, r), C (m, y, N) and D (m, y, r).

        Raises MatricesError if the function `matrices` does not return real arrays, or returns NaN or
        infinite entries."""
        return self._called(phase, speed, self._symbols, "A", "b")

    def at(self, phase: Array, speed: float) -> Matrices:
        A, b, *_ = self.equations_at(phase, speed)
        return np.zeros_like(A), np.broadcast_to(np.eye(self.n), A.shape), -A, b

    @property
    def capabilities(self) -> Capabilities:
        return super().capabilities._replace(evaluation=self, outputs=self if self.outputs else None)

    def _inputs_at(self, phase: Array, speed: float) -> list[Array]:
        return self.equations_at(phase, speed)[2:3]

    def used_entries(self, phase: Array, speed: float) -> tuple[Array, Array]:
        A, b, *_ = self.equations_at(phase, speed)
        N, m = self.n, len(phase)
        diagonal = N**2 + np.arange(N) * (N + 1)
        entries = np.empty((m, N * (N + 2)))
        entries[:, :N], entries[:, N * (N + 1) :] = speed, b
        np.negative(A.reshape(m, -1), out=entries[:, N : N * (N + 1)])
        return entries, np.concatenate((diagonal, np.arange(2 * N**2, 3 * N**2 + N)))

    def output_values(
        self, phase: Array, speed: Array | float, q: Array, qd: Array, qdd: Array, acceleration: float = 0.0
    ) -> Mapping[str, Array]:
        values, speeds = np.empty((len(self.outputs), len(phase))), np.broadcast_to(speed, len(phase))
        for omega in np.unique(speeds):
            some = speeds == omega
            C = self.equations_at(phase[some], float(omega))[3]
            values[:, some] = np.einsum("kyi,ik->yk", C, q[:, some])
        return dict(zip(self.outputs, values, strict=True))

    def _check(self, speed: float) -> None:
        """Raise MatricesError unless the matrices have the required shapes and are periodic."""
        phase = checked_phases(self.period, self.breaks)
        N, r, y = map(len, (self.states, self.inputs, self.outputs))
        sizes = {"A": (4, N, N), "b": (4, N), "B": (4, N, r), "C": (4, y, N), "D": (4, y, r)}
        arrays = dict(zip(self._symbols, self.equations_at(phase, speed), strict=True))
        require_shapes(arrays, sizes, f"{N} states ({', '.join(self.states)})")
        self._require_periodicity(phase, speed, "MCAb")


class MixedSystem(PeriodicSystem, Evaluation):
    """System M(Ωt)z̈ + C(Ωt)ż + K(Ωt)z = d(Ωt), where z consists of coordinates and first-order states.

    First-order states describe filters, actuators, inflow or other quantities without inertia.

    Parameters
    ----------
    matrices : callable
        As for `PeriodicSystem`, where n is the number of coordinates and states. The columns of M that belong
        to the states are zero.
    coordinates : sequence of str
        Names of the coordinates with second derivatives, which are listed first.
    states : sequence of str
        Names of the first-order states. In matrices and results, they follow the coordinates.
    period, breaks, inputs : optional
        As for `PeriodicSystem`.

    Raises
    ------
    ValueOutOfBoundsError
        For invalid names, period or breaks.

    Examples
    --------
    A mass on a spring, with a force x that follows the displacement of the mass with a lag:

    >>> def lagged(phase, speed):
    ...     one = np.ones(len(phase))
    ...     M, C, K = (np.zeros((len(phase), 2, 2)) for _ in range(3))
    ...     M[:, 0, 0], K[:, 0, 0], K[:, 0, 1] = one, 4.0, -one
    ...     C[:, 1, 1], K[:, 1, 1], K[:, 1, 0] = 0.5, one, 0.2
    ...     return M, C, K, np.stack((np.cos(phase), 0 * phase), axis=1)
    >>> MixedSystem(lagged, ["q"], ["x"]).coordinates
    ('q', 'x')
    """

    @matches_annotations
    def __init__(
        self,
        matrices: Callable[[Array, float], Sequence[Array]],
        coordinates: Sequence[str],
        states: Sequence[str],
        period: float = 2 * math.pi,
        breaks: Sequence[float] = (),
        inputs: Sequence[str] = (),
    ):
        for kind, names in (("coordinates", coordinates), ("states", states)):
            if isinstance(names, str):
                raise ValueOutOfBoundsError(f"{kind} are {names!r}; give a sequence of names")
        super().__init__(matrices, [*coordinates, *states], period, breaks, inputs)
        self.states = tuple(states)

    @classmethod
    def from_samples(  # type: ignore[override]
        cls,
        matrices: Sequence[Array],
        coordinates: Sequence[str],
        states: Sequence[str],
        period: float = 2 * math.pi,
        phases: Sequence[float] | Array | None = None,
    ) -> "MixedSystem":
        """Create a system from samples at azimuths of the period, see `PeriodicSystem.from_samples`.

        Parameters
        ----------
        matrices : sequence of array
            Samples of M, C, K (k, n, n) and d (k, n), with n the number of coordinates and states.
        coordinates, states, period, phases
            As for the constructor and `PeriodicSystem.from_samples`.

        Returns
        -------
        MixedSystem

        Raises
        ------
        MatricesError
            As `PeriodicSystem.from_samples`.
        """
        samples = sampled(matrices, "MCKd", period, phases)
        return cls(samples, coordinates, states, samples.period)

    @property
    def capabilities(self) -> Capabilities:
        return super().capabilities._replace(evaluation=self)

    def used_entries(self, phase: Array, speed: float) -> tuple[Array, Array]:
        n = self.n
        entries, numbers = entries_of(self, phase, speed), np.arange(3 * n**2 + n)
        used = (numbers >= n**2) | (numbers % n < n - len(self.states))
        return entries[:, used], numbers[used]

    def _check(self, speed: float) -> None:
        """Raise MatricesError unless the matrices have the required shapes, are periodic, and determine the
        highest derivatives."""
        n, phase = self.n, checked_phases(self.period, self.breaks)
        matrices = dict(zip("MCKd", self.at(phase, speed), strict=True))
        shapes = dict.fromkeys("MCK", (4, n, n)) | {"d": (4, n)}
        require_shapes(matrices, shapes, f"{n} coordinates and states ({', '.join(self.coordinates)})")
        if self.states and matrices["M"][..., n - len(self.states) :].any():
            raise MatricesError(
                f"M has entries in the columns of the states {', '.join(self.states)}; set them to "
                "zero, or list quantities with inertia among the coordinates"
            )
        self._require_periodicity(phase, speed, "MCKd")
        require_inertia(leading(matrices["M"], matrices["C"], len(self.states)), self.states)
