"""Functional mock-up unit for model exchange (FMI 2 or 3, https://fmi-standard.org), run by FMPy."""

import ctypes
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Self

import numpy as np

from solve.arrays import Array
from solve.errors import FileError, MissingLibraryError, SolveError, require_name

_MOST_UPDATES = 100
"""Largest number of updates of the discrete states during initialisation. Chosen by judgement."""


class Unit:
    """Instance of an FMU in continuous-time mode. As a context manager, it removes the instance at the end.

    Attributes
    ----------
    states, inputs, outputs : list of str
        Names of the continuous variables.
    labels : mapping of str to (str, str)
        Mapping from variables to units and descriptions.
    start : (N,) array
        States after initialisation.
    event : float
        Time of the next time event in s; infinite if there is none.
    """

    def __init__(self, path: Path, values: Mapping[str, float]):
        try:
            import fmpy
        except ImportError:
            raise MissingLibraryError.of_extra(f"'{path}'", "fmpy", "fmu") from None
        self.path, self._instance, self._folder = path, None, TemporaryDirectory()
        try:
            # The description is not validated, because tools write descriptions that violate details of the
            # schema.
            self._declare(fmpy.read_model_description(path, validate=False))
            self._initialise(str(fmpy.extract(path, self._folder.name)), values)
        except BaseException as error:
            self.__exit__()
            if isinstance(error, Exception) and not isinstance(error, SolveError):
                reason = " ".join(str(error).split()) or type(error).__name__
                raise FileError(f"'{path}' cannot be run: {reason}") from None
            raise

    def _declare(self, description: Any) -> None:
        """Read names, value references and labels. Raises FileError for unsupported kinds of FMU."""
        exchange = description.modelExchange
        if exchange is None or description.fmiVersion not in ("2.0", "3.0"):
            raise FileError(
                f"'{self.path}' has FMI {description.fmiVersion} without model exchange; allowed: FMI 2 or 3 "
                "for model exchange"
            )
        self.description = description
        rates = [unknown.variable for unknown in description.derivatives]
        found = {
            "states": [rate.derivative for rate in rates],
            "inputs": self._of_causality("input"),
            "outputs": self._of_causality("output"),
        }
        if not rates:
            raise FileError(f"'{self.path}' has no continuous states; give an FMU with states")
        if any(variable.dimensions for group in found.values() for variable in group):
            raise FileError(f"'{self.path}' has array variables; allowed: scalar variables")
        self.states, self.inputs, self.outputs = (
            [variable.name for variable in group] for group in found.values()
        )
        self._rates, self._known, self._unknown = (
            [variable.valueReference for variable in group]
            for group in (rates, found["states"] + found["inputs"], rates + found["outputs"])
        )
        self.labels = {
            variable.name: (
                variable.unit or getattr(variable.declaredType, "unit", None) or "",
                variable.description or "",
            )
            for variable in description.modelVariables
        }

    def _of_causality(self, causality: str) -> list[Any]:
        return [
            variable
            for variable in self.description.modelVariables
            if variable.causality == causality and variable.type in ("Real", "Float64")
        ]

    def _initialise(self, folder: str, values: Mapping[str, float]) -> None:
        """Instantiate the FMU, set the start values, and enter continuous-time mode at time 0."""
        from fmpy.fmi2 import FMU2Model
        from fmpy.fmi3 import FMU3Model

        is_2, description = self.description.fmiVersion == "2.0", self.description
        references = {
            variable.name: variable.valueReference
            for variable in description.modelVariables
            if variable.type in ("Real", "Float64") and variable.causality != "independent"
        }
        for name in values:
            require_name(f"variable of '{self.path}'", name, references)
        unit: Any = (FMU2Model if is_2 else FMU3Model)(
            guid=description.guid,
            unzipDirectory=folder,
            modelIdentifier=description.modelExchange.modelIdentifier,
            instanceName="unit",
        )
        unit.instantiate()
        self._instance = unit
        setter = unit.setReal if is_2 else unit.setFloat64
        if is_2:
            unit.setupExperiment(startTime=0.0)
        if values:
            setter([references[name] for name in values], [float(value) for value in values.values()])
        unit.enterInitializationMode()
        unit.exitInitializationMode()
        self._get_rates = unit.getDerivatives if is_2 else unit.getContinuousStateDerivatives
        for _ in range(_MOST_UPDATES):
            pending, ends, *_, timed, time = unit.newDiscreteStates() if is_2 else unit.updateDiscreteStates()
            if ends:
                raise FileError("it ends the simulation during initialisation")
            if not pending:
                break
        else:
            raise FileError("its discrete states do not converge")
        self.event = float(time) if timed else np.inf
        unit.enterContinuousTimeMode()
        self.start = self._filled(unit.getContinuousStates, len(self.states))
        try:
            self.jacobian(0.0, self.start)
        except Exception:
            raise FileError(
                f"'{self.path}' provides no directional derivatives; export the FMU with directional "
                "derivatives"
            ) from None

    @staticmethod
    def _filled(getter: Callable[..., Any], count: int) -> Array:
        """Call an FMI getter that fills an array (count,), and return the array."""
        values = (ctypes.c_double * count)()
        getter(values, count)
        return np.array(values)

    def _set(self, time: float, x: Array) -> None:
        self._instance.setTime(float(time))  # type: ignore[union-attr]
        pointer = (ctypes.c_double * len(x))(*x)
        self._instance.setContinuousStates(pointer, len(x))  # type: ignore[union-attr]

    def rates(self, time: float, x: Array) -> Array:
        """Rates ẋ (N,) at a time in s for states (N,)."""
        self._set(time, x)
        return self._filled(self._get_rates, len(x))

    def products(self, time: float, x: Array, seeds: Array) -> Array:
        """Directional derivatives (N, k) of ẋ in k directions of the states, `seeds` (N, k)."""
        self._set(time, x)
        known = self._known[: len(x)]
        columns = [self._derivative(self._rates, known, seed) for seed in seeds.T]
        return np.stack(columns, axis=1)

    def jacobian(self, time: float, x: Array) -> Array:
        """Derivatives (N + y, N + r) of ẋ and of the outputs, with respect to the states and the inputs."""
        self._set(time, x)
        columns = [self._derivative(self._unknown, [known], [1.0]) for known in self._known]
        return np.stack(columns, axis=1)

    def _derivative(self, unknown: list[int], known: list[int], seed: Any) -> Array:
        return np.array(self._instance.getDirectionalDerivative(unknown, known, list(seed)))  # type: ignore[union-attr]

    def indicators(self, time: float, x: Array) -> Array:
        """Event indicators at a time in s for states (N,). Their signs change if the equations switch."""
        count = int(self.description.numberOfEventIndicators or 0)
        self._set(time, x)
        return self._filled(self._instance.getEventIndicators, count) if count else np.zeros(0)  # type: ignore[union-attr]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Remove the instance, its library and its folder."""
        if self._instance is not None:
            for remove in (self._instance.terminate, self._instance.freeInstance):
                with suppress(Exception):
                    remove()
            self._instance = None
        with suppress(OSError):
            self._folder.cleanup()
