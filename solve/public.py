"""Public names of `solve`, loaded at their first use."""

from solve.derivatives.point import sensitivities
from solve.errors import SolveError
from solve.exports.export import export
from solve.exports.harmonic_transfer import HarmonicTransfer, harmonic_transfer
from solve.exports.state_space import StateSpace, state_space
from solve.first_order import FirstOrderSystem, MixedSystem
from solve.loading import case_numbers, load
from solve.methods.gauss import Gauss
from solve.methods.hill import boundaries
from solve.methods.newmark import Newmark
from solve.methods.radau import Radau
from solve.methods.runge_kutta import RungeKutta4
from solve.model.cases import Case
from solve.model.model import Model
from solve.newton.branches import branch
from solve.newton.orbits import nonlinear
from solve.newton.scatter import scatter
from solve.newton.transients import transient
from solve.newton.two_parameters import special_curves
from solve.period.quantities import statistics as signal_statistics
from solve.proof.prove import prove
from solve.proof.result import Proof
from solve.readers.fmu import read_fmu
from solve.readers.formats import read_mat, read_netcdf, read_npz, read_op4
from solve.readers.matrix_market import read_matrix_market
from solve.readers.openfast import read_openfast
from solve.results.bands import Band
from solve.results.branch import Branch
from solve.results.chart import Chart
from solve.results.controller import Controller
from solve.results.critical_speeds import CriticalSpeeds
from solve.results.fit import Fitted
from solve.results.followed_modes import FollowedModes
from solve.results.frequencies import Frequencies, Variation
from solve.results.optimum import Optimum
from solve.results.orbit import Orbit
from solve.results.save import opened as open
from solve.results.scatter import Scatter
from solve.results.sensitivities import Sensitivities, SensitivitiesOver
from solve.results.special_curves import SpecialCurves
from solve.results.special_orbits import NonlinearOrbit
from solve.results.stability import Stability
from solve.results.sweep import Sweep
from solve.results.sweeps import Sweeps, Validity
from solve.results.tolerances import Tolerances
from solve.results.transient import Transient
from solve.single import floquet, periodic
from solve.studies.bands import bands
from solve.studies.chart import chart
from solve.studies.compare import compare
from solve.studies.control.closed_loop import closed_loop
from solve.studies.control.design import control, kalman, lqg, lqr
from solve.studies.control.margin import stability_margin
from solve.studies.control.norms import h2_norm, hinf_norm
from solve.studies.control.output_feedback import OutputFeedback
from solve.studies.control.sampled import sampled
from solve.studies.critical_speeds import critical_speeds
from solve.studies.curves import PeriodicCurves
from solve.studies.fit import fit
from solve.studies.follow_modes import follow_modes
from solve.studies.frequencies import frequencies, frequencies_over
from solve.studies.optimise import optimise
from solve.studies.sensitivities import sensitivities_over, speed_sensitivities
from solve.studies.sweep import sweep, sweeps, validity, variants
from solve.studies.tolerances import tolerances
from solve.system import PeriodicSystem
from solve.views.animation import Animation, animate
from solve.views.live.window import LiveWindow, explore
from solve.views.page import Report
from solve.views.report import report

__all__ = [
    "Animation",
    "Band",
    "Branch",
    "Case",
    "Chart",
    "Controller",
    "CriticalSpeeds",
    "FirstOrderSystem",
    "Fitted",
    "FollowedModes",
    "Frequencies",
    "Gauss",
    "HarmonicTransfer",
    "LiveWindow",
    "MixedSystem",
    "Model",
    "Newmark",
    "NonlinearOrbit",
    "Optimum",
    "Orbit",
    "OutputFeedback",
    "PeriodicCurves",
    "PeriodicSystem",
    "Proof",
    "Radau",
    "Report",
    "RungeKutta4",
    "Scatter",
    "Sensitivities",
    "SensitivitiesOver",
    "SolveError",
    "SpecialCurves",
    "Stability",
    "StateSpace",
    "Sweep",
    "Sweeps",
    "Tolerances",
    "Transient",
    "Validity",
    "Variation",
    "animate",
    "bands",
    "boundaries",
    "branch",
    "case_numbers",
    "chart",
    "closed_loop",
    "compare",
    "control",
    "critical_speeds",
    "explore",
    "export",
    "fit",
    "floquet",
    "follow_modes",
    "frequencies",
    "frequencies_over",
    "h2_norm",
    "harmonic_transfer",
    "hinf_norm",
    "kalman",
    "load",
    "lqg",
    "lqr",
    "nonlinear",
    "open",
    "optimise",
    "periodic",
    "prove",
    "read_fmu",
    "read_mat",
    "read_matrix_market",
    "read_netcdf",
    "read_npz",
    "read_op4",
    "read_openfast",
    "report",
    "sampled",
    "scatter",
    "sensitivities",
    "sensitivities_over",
    "signal_statistics",
    "special_curves",
    "speed_sensitivities",
    "stability_margin",
    "state_space",
    "sweep",
    "sweeps",
    "tolerances",
    "transient",
    "validity",
    "variants",
]
