"""Orders of convergence, measured against DOP853 on a system in which everything varies."""

import numpy as np
import pytest

from solve import Newmark, Radau, RungeKutta4, periodic
from solve.methods.gauss import Gauss
from solve.methods.hsu import Hsu
from tests.solve.systems import random_system
from tests.solve.witnesses import Shooting, multiplier_error, slope

SYSTEM = random_system(4, 2)
PHASES = np.linspace(0.0, 2 * np.pi, 1001)
MEASURED = [  # the method, its order, steps at which multipliers show it; curve's order and steps
    (Newmark(0.5, 1 / 4), 2, (128, 192, 256), 2, (128, 192, 256)),
    (Newmark(0.5, 1 / 6), 2, (128, 192, 256), 2, (128, 192, 256)),
    (Newmark(0.5, 0.0), 2, (128, 192, 256), 2, (128, 192, 256)),
    (Newmark(0.25, 1 / 6), 1, (512, 768, 1024), 1, (512, 768, 1024)),
    (Newmark(0.75, 0.5), 1, (512, 768, 1024), 1, (512, 768, 1024)),
    (RungeKutta4(), 4, (64, 96, 128), 4, (64, 96, 128)),
    (Hsu(), 2, (128, 192, 256), 2, (128, 192, 256)),
    (Radau(3), 3, (96, 128, 192), 3, (96, 128, 192)),
    (Radau(5), 5, (32, 48, 64), 5, (32, 48, 64)),
    (Radau(7), 7, (24, 32, 48), 7, (24, 32, 48)),
    (Radau(9), 9, (20, 28, 40), 8, (32, 40, 48)),
    (Radau(11), 11, (14, 18, 24), 9, (14, 18, 24)),
    (Radau(13), 13, (12, 14, 16), 10, (10, 12, 14)),
    (Gauss(4), 4, (64, 96, 128), 4, (64, 96, 128)),
    (Gauss(6), 6, (32, 48, 64), 6, (32, 48, 64)),
    (Gauss(8), 8, (24, 32, 48), 7, (32, 48, 64)),
    (Gauss(10), 10, (16, 20, 28), 8, (20, 24, 28)),
    (Gauss(12), 12, (12, 14, 16), 9, (14, 16, 18)),
    (Gauss(14), 14, (10, 11, 12), 10, (10, 12, 14)),
    (Gauss(16), 16, (9, 10), 11, (8, 10)),
]
NAMES = [repr(method) for method, *_ in MEASURED]


@pytest.fixture(scope="module")
def truth():
    return Shooting(SYSTEM, 1.0)


def solved(method, steps):
    return [periodic(SYSTEM, 1.0, method, steps=m, rtol=0.5) for m in steps]


@pytest.mark.parametrize(("method", "order", "steps", "curve_order", "curve_steps"), MEASURED, ids=NAMES)
def test_order_at_the_nodes(method, order, steps, curve_order, curve_steps, truth):
    errors = [multiplier_error(orbit.multipliers, truth.multipliers) for orbit in solved(method, steps)]
    assert slope(steps, errors) == pytest.approx(order, abs=0.15)
    assert method.order == order


@pytest.mark.parametrize(("method", "order", "steps", "curve_order", "curve_steps"), MEASURED, ids=NAMES)
def test_order_of_the_continuous_curve(method, order, steps, curve_order, curve_steps, truth):
    q = truth.states(PHASES)[:2]
    errors = [np.linalg.norm(orbit.at(PHASES) - q) for orbit in solved(method, curve_steps)]
    assert slope(curve_steps, errors) == pytest.approx(curve_order, abs=0.15)
    assert method.curve_order == curve_order
