"""Numbers from a linear system with periodic coefficients: orbits, stability, studies, pictures."""

from solve.errors import SolveError
from solve.loading import load
from solve.methods.gauss import Gauss
from solve.methods.hill import boundaries
from solve.methods.newmark import Newmark
from solve.methods.radau import Radau
from solve.methods.runge_kutta import RungeKutta4
from solve.results.orbit import Orbit
from solve.results.stability import Stability
from solve.single import floquet, periodic
from solve.studies.bands import Band, bands
from solve.studies.chart import Chart, chart
from solve.studies.critical_speeds import CriticalSpeeds, critical_speeds
from solve.studies.frequencies import Frequencies, Variation, frequencies, frequencies_over
from solve.studies.sweep import Sweep, sweep
from solve.studies.sweeps import Sweeps, sweeps, variants
from solve.system import PeriodicSystem

__all__ = [
    "Band",
    "Chart",
    "CriticalSpeeds",
    "Frequencies",
    "Gauss",
    "Newmark",
    "Orbit",
    "PeriodicSystem",
    "Radau",
    "RungeKutta4",
    "SolveError",
    "Stability",
    "Sweep",
    "Sweeps",
    "Variation",
    "bands",
    "boundaries",
    "chart",
    "critical_speeds",
    "floquet",
    "frequencies",
    "frequencies_over",
    "load",
    "periodic",
    "sweep",
    "sweeps",
    "variants",
]
