"""Linear-quadratic regulator, Kalman filter, and their combination, for systems with periodic
coefficients."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from solve.arguments import checked_rtol, described, unique_names
from solve.certify.coefficients import require_load
from solve.errors import MissingValueError, NoLoadError, ValueOutOfBoundsError
from solve.labels import require_motion
from solve.period.curve import Curve
from solve.results.controller import Controller, Norms, Vibration
from solve.single import floquet, periodic
from solve.studies.control.closed_loop import ClosedLoop, Compensator, Observer
from solve.studies.control.equations import error_equations, filter_of, regulator
from solve.studies.control.margin import stability_margin
from solve.studies.control.norms import h2_norm, hinf_norm
from solve.studies.control.plant import Plant
from solve.studies.control.riccati import Solved
from solve.studies.control.sampled import sampled
from solve.studies.control.weights import Weight
from solve.system import PeriodicSystem, check, of_system, shown_in
from solve.units import speed_in_si


@of_system
def lqr(
    system: PeriodicSystem,
    speed: float | str,
    Q: Weight,
    R: Weight,
    rtol: float = 1e-8,
    feedforward: bool = False,
) -> Controller:
    """Compute the periodic state feedback u = −K(φ)x that minimises the mean of xᵀQx + uᵀRu.

    Parameters
    ----------
    system : PeriodicSystem
        System with r inputs, of first or second order. The states x are (q, q̇), or the states of a
        first-order system.
    speed : float or str
        Ω in rad/s, or a string with a unit.
    Q : (N, N) array, mapping or callable
        Weights of the states: a positive semidefinite matrix; a mapping from names of states and outputs to
        numbers, such as {"q1": 1e6, "q1_dot": 10}; or a function of phases (k,) that returns matrices (k, N,
        N).
    R : (r, r) array, mapping or callable
        Weights of the inputs: a positive definite matrix, a mapping from names of inputs to numbers, or a
        function of phases (k,) that returns matrices (k, r, r).
    rtol : float
        Relative tolerance of the solution of the Riccati equation and of the multipliers.
    feedforward : bool
        Whether to add the periodic feedforward f(φ) in u = −K x + f that minimises the mean under the load.
        Without feedforward, the feedback opposes every motion, including the forced vibration.

    Returns
    -------
    Controller
        Solution X(φ), gain K(φ) = R⁻¹BᵀX and the closed loop.

    Raises
    ------
    ControlError
        If the system has no inputs, or if there is no stabilising solution.
    SolveError
        Other subclasses for bad input.

    Notes
    -----
    X is the stabilising periodic solution of −Ẋ = AᵀX + XA − XBR⁻¹BᵀX + Q (S. Bittanti, P. Colaneri, Periodic
    Systems, 2009). It is computed by doubling on the symplectic maps of Gauss collocation and corrected by
    Newton's method. Multipliers of the closed loop are those of `solve.floquet`. f = −R⁻¹Bᵀg, where g is the
    periodic solution of −ġ = (A − BK)ᵀg + Xb and b the load of the states.

    Examples
    --------
    >>> import numpy as np
    >>> def unstable(phase, speed):
    ...     one = np.ones((len(phase), 1, 1))
    ...     return one, 0 * one, -(2 + np.cos(phase)[:, None, None]), 0 * phase[:, None], one
    >>> found = lqr(PeriodicSystem(unstable, ["q"], inputs=["u"]), 1.0, {"q": 1.0}, {"u": 1.0})
    >>> found.stable
    True
    """
    plant, rtol = _plant(system, speed), checked_rtol(rtol)
    plant.require_inputs()
    solved, gain, ahead = regulator(plant, Q, R, rtol, feedforward)
    closed = ClosedLoop(plant.system, gain, None, ahead)
    controller = _controller("lqr", plant, solved, gain, plant.system.inputs, closed, rtol)
    return replace(controller, ahead=ahead)


@of_system
def kalman(
    system: PeriodicSystem, speed: float | str, W: Weight, V: Weight, rtol: float = 1e-8
) -> Controller:
    """Compute the gain L(φ) of the observer x̂′ = A x̂ + b + B u + L (y − C x̂) with minimum mean-square
    error.

    Parameters
    ----------
    system : PeriodicSystem
        System of first or second order.
    speed : float or str
        Ω in rad/s, or a string with a unit.
    W : (N, N) array, mapping or callable
        Spectral density of the process noise: a positive semidefinite matrix; a mapping from names to
        numbers; or a function of phases (k,) that returns matrices (k, N, N). In a mapping, the number of an
        input is the density of noise that acts like this input. The number of a state is the density of noise
        that is added to the rate of this state.
    V : (y, y) array, mapping or callable
        Spectral density of the measurement noise: a mapping from the names of the measured states and outputs
        to numbers; a positive definite matrix; or a function of phases. For a matrix or a function, the
        measured quantities are the named outputs if the system is a `FirstOrderSystem` that has any, and
        otherwise all coordinates.
    rtol : float
        Relative tolerance of the solution of the Riccati equation and of the multipliers.

    Returns
    -------
    Controller
        Covariance P(φ) of the estimation error, gain L(φ) = P Cᵀ V⁻¹ (N, y) and, as the closed loop, the
        equations of the estimation error.

    Raises
    ------
    ControlError
        If there is no stabilising solution.
    SolveError
        Other subclasses for bad input.

    Notes
    -----
    P is the stabilising periodic solution of Ṗ = AP + PAᵀ − PCᵀV⁻¹CP + W (R. E. Kalman, R. S. Bucy, J. Basic
    Eng. 83 (1961) 95-108).

    Examples
    --------
    >>> import numpy as np
    >>> import solve
    >>> def integrator(phase, speed):
    ...     zero = np.zeros((len(phase), 1, 1))
    ...     return zero, zero[:, 0]
    >>> found = kalman(solve.FirstOrderSystem(integrator, ["x"]), 1.0, [[4.0]], {"x": 1.0})
    >>> round(float(found.gain(0.0)[0, 0, 0]), 9)
    2.0
    """
    plant, rtol = _plant(system, speed), checked_rtol(rtol)
    solved, gain, measured = filter_of(plant, W, V, rtol)
    return _controller("kalman", plant, solved, gain, measured, error_equations(plant, gain, measured), rtol)


@of_system
def lqg(
    system: PeriodicSystem,
    speed: float | str,
    Q: Weight,
    R: Weight,
    W: Weight,
    V: Weight,
    rtol: float = 1e-8,
    feedforward: bool = False,
) -> Controller:
    """Compute output feedback: the regulator of `lqr` with the state estimates of `kalman`.

    Parameters
    ----------
    system : PeriodicSystem
        System with inputs.
    speed : float or str
        Ω in rad/s, or a string with a unit.
    Q, R : array, mapping or callable
        Weights of the regulator, as in `lqr`.
    W, V : array, mapping or callable
        Noise of the filter, as in `kalman`.
    rtol : float
        As in `lqr`.
    feedforward : bool
        As in `lqr`.

    Returns
    -------
    Controller
        Result as from `lqr`, with the filter as its attribute `observer`. The closed loop has the estimates
        NAME_hat as additional states.

    Raises
    ------
    ControlError
        If the system has no inputs, or if there is no stabilising solution.
    SolveError
        Other subclasses for bad input.

    Examples
    --------
    >>> import solve
    >>> press = solve.load("manipulator")
    >>> found = lqg(press, "50 rpm", {"q2": 1e8}, {"u": 1e-2}, {"u": 1.0}, {"q1": 1e-9})
    >>> found.closed.n
    6
    """
    plant, rtol = _plant(system, speed), checked_rtol(rtol)
    plant.require_inputs()
    solved, gain, ahead = regulator(plant, Q, R, rtol, feedforward)
    filtered, observer_gain, measured = filter_of(plant, W, V, rtol)
    errors = error_equations(plant, observer_gain, measured)
    observer = _controller("kalman", plant, filtered, observer_gain, measured, errors, rtol)
    closed = ClosedLoop(plant.system, gain, Observer(observer_gain, measured), ahead)
    controller = _controller("lqg", plant, solved, gain, plant.system.inputs, closed, rtol)
    return replace(controller, ahead=ahead, observer=observer, compensator=Compensator(closed))


@of_system
def control(
    system: PeriodicSystem,
    speed: float | str,
    lqr: Mapping[str, float] | tuple[Weight, Weight] | None = None,
    kalman: Mapping[str, float] | tuple[Weight, Weight] | None = None,
    rtol: float = 1e-8,
    feedforward: bool = False,
    vibration: bool = False,
    margin: Sequence[str] = (),
    norms: Sequence[str] = (),
    samples: int | None = None,
) -> Controller:
    """Compute a regulator, a filter, or both, from named weights and noise intensities.

    Parameters
    ----------
    system : PeriodicSystem
        System with inputs.
    speed : float or str
        Ω in rad/s, or a string with a unit.
    lqr : mapping of str to float, or pair of matrices, optional
        Mapping from names of inputs, states and outputs to weights, such as {"q3": 1e6, "u": 1}; or Q and R.
    kalman : mapping of str to float, or pair of matrices, optional
        Mapping from names of inputs, and of measured states and outputs, to noise intensities, such as {"u":
        1, "q1": 1e-9}; or W and V.
    rtol : float
        As in `lqr`.
    feedforward : bool
        As in `lqr`.
    vibration : bool
        Whether to compute the periodic vibration without and with feedback.
    margin : sequence of str
        Names of parameters. The smallest change of these parameters that makes the closed loop unstable is
        computed; see `stability_margin`.
    norms : sequence of str
        Names of states and outputs. The norms of the transfer from disturbances at the inputs to each of
        these quantities are computed; see `h2_norm` and `hinf_norm`.
    samples : int, optional
        Number of samples per period of a digital controller, which holds the inputs and delays them by one
        sample. The stability with this controller is computed; see `sampled`.

    Returns
    -------
    Controller
        Result of `lqr` or of `kalman` or, if both are given, of `lqg`.

    Raises
    ------
    SolveError
        The exceptions of `lqr` and `kalman`.

    Examples
    --------
    >>> import solve
    >>> control(solve.load("manipulator"), "50 rpm", lqr={"q2": 1e8, "u": 1e-2}).verdict
    'asymptotically stable'
    """
    weights = None if lqr is None else _pair(system, lqr, "lqr", inputs_first=False)
    noise = None if kalman is None else _pair(system, kalman, "kalman", inputs_first=True)
    if weights is None:
        if noise is None:
            raise MissingValueError(
                'a controller requires weights; give lqr, such as {"q3": 1e6, "u": 1}, or kalman'
            )
        if feedforward or margin or norms or vibration or samples is not None:
            raise ValueOutOfBoundsError(
                "feedforward, vibration, margin, norms and samples require a closed loop; give lqr"
            )
        return _DESIGNS["kalman"](system, speed, *noise, rtol)
    if noise is None:
        controller = _DESIGNS["lqr"](system, speed, *weights, rtol, feedforward)
    else:
        controller = _DESIGNS["lqg"](system, speed, *weights, *noise, rtol, feedforward)
    if margin:
        controller = replace(controller, margin=stability_margin(controller.closed, speed, margin))
    if samples is not None:
        controller = replace(controller, sampled=sampled(controller.closed, speed, samples))
    if norms:
        controller = replace(
            controller, norms={name: _norms(controller, name) for name in unique_names(norms)}
        )
    return replace(controller, vibration=_vibration(controller)) if vibration else controller


def _norms(controller: Controller, name: str) -> Norms:
    """Return the norms of the transfer from the inputs to the state or output `name`, with and without
    feedback. Raises SolveError subclasses."""
    speed, rtol = controller.speed, max(controller.rtol, _NORM_RTOL)
    h2, hinf = (norm(controller.closed, speed, [name], rtol=rtol) for norm in (h2_norm, hinf_norm))
    h2_before = hinf_before = None
    if floquet(controller.system, speed, rtol=rtol).verdict == "asymptotically stable":
        h2_before, hinf_before = (
            norm(controller.system, speed, [name], rtol=rtol) for norm in (h2_norm, hinf_norm)
        )
    every = [each for each in (h2, hinf, h2_before, hinf_before) if each is not None]
    return Norms(
        h2=h2.value,
        hinf=hinf.value,
        h2_without=h2_before and h2_before.value,
        hinf_without=hinf_before and hinf_before.value,
        frequency=hinf.frequency,
        error=max(each.error for each in every),
        warnings=tuple(dict.fromkeys(text for each in every for text in each.warnings)),
    )


_NORM_RTOL = 1e-6
"""Smallest relative tolerance of norms. Chosen by judgement: H∞ norms are found by bisection."""

_DESIGNS = {"lqr": lqr, "kalman": kalman, "lqg": lqg}
"""Mapping from names to design functions. It is needed because the arguments of `control` hide the functions
of the same names."""


def _vibration(controller: Controller) -> dict[str, Vibration]:
    """Return the periodic vibration of coordinates and inputs, without and with feedback. The result is empty
    if there is no load.

    Raises SolveError subclasses if an orbit does not exist."""
    system = controller.system
    try:
        require_load(system, controller.speed)
    except NoLoadError:
        return {}
    before, after = (
        periodic(each, controller.speed, rtol=controller.rtol) for each in (system, controller.closed)
    )
    found = {}
    for name in (*system.coordinates, *system.inputs):
        without = before.statistics(name).max_abs if name in system.coordinates else 0.0
        figures = after.statistics(name)
        found[name] = Vibration(without, figures.max_abs, figures.rms)
    return found


def _pair(
    system: PeriodicSystem, given: Mapping[str, float] | tuple[Weight, Weight], name: str, inputs_first: bool
) -> tuple[Weight, Weight]:
    """Return weights (Q, R), or noise intensities (W, V), from named numbers. Raises MissingValueError."""
    if not isinstance(given, Mapping):
        if not isinstance(given, tuple) or len(given) != 2:
            raise ValueOutOfBoundsError(
                f"{name} is {described(given)}; allowed: a mapping of names to numbers, or a pair of weights"
            )
        return given
    inputs = {key: value for key, value in given.items() if key in system.inputs}
    others = {key: value for key, value in given.items() if key not in system.inputs}
    if not inputs or not others:
        known = ", ".join(system.inputs) or "none"
        missing = "state or output" if inputs else f"input (inputs of the system: {known})"
        raise MissingValueError(
            f"{name} contains no {missing}; give numbers for at least one input and one state or output"
        )
    return (inputs, others) if inputs_first else (others, inputs)


def _plant(system: PeriodicSystem, speed: float | str) -> Plant:
    omega = speed_in_si(speed)
    require_motion(system)
    check(system, omega)
    return Plant(shown_in(system, omega), omega)


def _controller(
    kind: str,
    plant: Plant,
    solved: Solved,
    gain: Curve,
    signals: tuple[str, ...],
    closed: PeriodicSystem,
    rtol: float,
) -> Controller:
    """Return a controller with the certified multipliers of its closed loop."""
    return Controller(
        system=plant.system,
        speed=plant.speed,
        kind=kind,
        states=plant.states,
        signals=signals,
        solution=solved.curve,
        gains=gain,
        closed=closed,
        stability=floquet(closed, plant.speed, rtol=rtol),
        error_estimate=solved.error,
        residual=solved.residual,
        rtol=rtol,
    )
