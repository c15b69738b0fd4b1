"""Vector width: as wide as the processor's registers, without effect on results."""

import numpy as np
import pytest

import solve
from solve.batch.family import over_speed
from solve.kernel import compiler
from solve.kernel.library import Size, lanes
from tests.solve import systems
from tests.solve.kernel.test_lanes import grids, needs_compiler, same


@needs_compiler
def test_compiler_determines_the_width(width):
    macros = compiler.c_compiler().macros
    has = 8 if "__AVX512F__" in macros else 4 if "__AVX__" in macros else 2
    assert has <= width
    assert lanes(Size(1, 1, 2, True, False)) == has


@needs_compiler
@pytest.mark.parametrize("method", [solve.Radau(5), solve.Gauss(4)], ids=["radau", "gauss"])
def test_every_width_matches_numpy(width, method):
    family = over_speed(systems.random_system(7, 3))
    for points, steps in ((1, 24), (1, 7), (11, 24)):
        for own in (False, True):
            speeds = np.linspace(0.7, 1.4, points)[:, None]
            same(*grids(family, speeds, 3, method, steps, own=own))
