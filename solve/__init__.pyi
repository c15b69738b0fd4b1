from .derivatives.point import sensitivities as sensitivities
from .errors import SolveError as SolveError
from .exports.export import export as export
from .exports.harmonic_transfer import HarmonicTransfer as HarmonicTransfer
from .exports.harmonic_transfer import harmonic_transfer as harmonic_transfer
from .exports.state_space import StateSpace as StateSpace
from .exports.state_space import state_space as state_space
from .first_order import FirstOrderSystem as FirstOrderSystem
from .first_order import MixedSystem as MixedSystem
from .loading import case_numbers as case_numbers
from .loading import load as load
from .methods.gauss import Gauss as Gauss
from .methods.hill import boundaries as boundaries
from .methods.newmark import Newmark as Newmark
from .methods.radau import Radau as Radau
from .methods.runge_kutta import RungeKutta4 as RungeKutta4
from .model.cases import Case as Case
from .model.model import Model as Model
from .newton.branches import branch as branch
from .newton.orbits import nonlinear as nonlinear
from .newton.scatter import scatter as scatter
from .newton.transients import transient as transient
from .newton.two_parameters import special_curves as special_curves
from .period.signals import signal_statistics as signal_statistics
from .proof.prove import prove as prove
from .proof.result import Proof as Proof
from .readers.fmu import read_fmu as read_fmu
from .readers.formats import read_mat as read_mat
from .readers.formats import read_netcdf as read_netcdf
from .readers.formats import read_npz as read_npz
from .readers.formats import read_op4 as read_op4
from .readers.matrix_market import read_matrix_market as read_matrix_market
from .readers.openfast import read_openfast as read_openfast
from .results.bands import Band as Band
from .results.branch import Branch as Branch
from .results.chart import Chart as Chart
from .results.controller import Controller as Controller
from .results.critical_speeds import CriticalSpeeds as CriticalSpeeds
from .results.fit import Fitted as Fitted
from .results.followed_modes import FollowedModes as FollowedModes
from .results.frequencies import Frequencies as Frequencies
from .results.frequencies import Variation as Variation
from .results.optimum import Optimum as Optimum
from .results.orbit import Orbit as Orbit
from .results.save import open as open
from .results.scatter import Scatter as Scatter
from .results.sensitivities import Sensitivities as Sensitivities
from .results.sensitivities import SensitivitiesOver as SensitivitiesOver
from .results.special_curves import SpecialCurves as SpecialCurves
from .results.special_orbits import NonlinearOrbit as NonlinearOrbit
from .results.stability import Stability as Stability
from .results.sweep import Sweep as Sweep
from .results.sweeps import Sweeps as Sweeps
from .results.sweeps import Validity as Validity
from .results.tolerances import Tolerances as Tolerances
from .results.transient import Transient as Transient
from .single import floquet as floquet
from .single import periodic as periodic
from .studies.bands import bands as bands
from .studies.chart import chart as chart
from .studies.compare import compare as compare
from .studies.control.closed_loop import closed_loop as closed_loop
from .studies.control.design import control as control
from .studies.control.design import kalman as kalman
from .studies.control.design import lqg as lqg
from .studies.control.design import lqr as lqr
from .studies.control.margin import stability_margin as stability_margin
from .studies.control.norms import h2_norm as h2_norm
from .studies.control.norms import hinf_norm as hinf_norm
from .studies.control.output_feedback import OutputFeedback as OutputFeedback
from .studies.control.sampled import sampled as sampled
from .studies.critical_speeds import critical_speeds as critical_speeds
from .studies.curves import PeriodicCurves as PeriodicCurves
from .studies.fit import fit as fit
from .studies.follow_modes import follow_modes as follow_modes
from .studies.frequencies import frequencies as frequencies
from .studies.frequencies import frequencies_over as frequencies_over
from .studies.optimise import optimise as optimise
from .studies.sensitivities import sensitivities_over as sensitivities_over
from .studies.sensitivities import speed_sensitivities as speed_sensitivities
from .studies.sweep import sweep as sweep
from .studies.sweep import sweeps as sweeps
from .studies.sweep import validity as validity
from .studies.sweep import variants as variants
from .studies.tolerances import tolerances as tolerances
from .system import PeriodicSystem as PeriodicSystem
from .views.animation import Animation as Animation
from .views.animation import animate as animate
from .views.live.window import LiveWindow as LiveWindow
from .views.live.window import explore as explore
from .views.page import Report as Report
from .views.report import report as report

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
