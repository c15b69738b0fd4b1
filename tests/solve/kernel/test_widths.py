"""Lanes are as wide as the processor's registers, and their number changes no result."""

import platform

import numpy as np
import pytest

import solve
from solve.batch.family import over_speed
from solve.kernel import compiler
from solve.kernel.library import Size, lanes
from tests.solve import systems
from tests.solve.kernel.test_lanes import grids, needs_compiler, same

LACKING = {8: (), 4: ("-mno-avx512f",), 2: ("-mno-avx512f", "-mno-avx")}
"""Flags of the compiler under which registers hold so many numbers, or less."""

on_x86 = pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="flags are those of x86")


@needs_compiler
@on_x86
@pytest.mark.parametrize("width", LACKING)
def test_the_compiler_chooses_the_width(compiled_for, width):
    compiled_for(*LACKING[width])
    macros = compiler.c_compiler()[1]
    has = 8 if "__AVX512F__" in macros else 4 if "__AVX__" in macros else 2
    assert has <= width
    assert lanes(Size(1, 1, 2, True, False)) == has


@needs_compiler
@on_x86
@pytest.mark.parametrize("width", LACKING)
@pytest.mark.parametrize("method", [solve.Radau(5), solve.Gauss(4)], ids=["radau", "gauss"])
def test_every_width_gives_what_numpy_gives(compiled_for, width, method):
    compiled_for(*LACKING[width])
    family = over_speed(systems.random_system(7, 3))
    for points, steps in ((1, 24), (1, 7), (11, 24)):
        for own in (False, True):
            speeds = np.linspace(0.7, 1.4, points)[:, None]
            same(*grids(family, speeds, 3, method, steps, own=own))
