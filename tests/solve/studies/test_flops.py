"""Counts of operations, compared with Tables 6.2 and 6.3 of the thesis."""

import pytest

from solve.studies.flops import algorithm_1, algorithm_2, fourier_series, time_marching

# N, n, cycles, then millions: TMS, algorithms 1 and 2 with storage, the same without.
TABLE_6_2 = [
    (90, 10, 5, ("2.43", "3.78", "5.93"), ("11.4", "7.71", "9.96")),
    (90, 10, 100, ("6.02", "3.78", "5.93"), ("228", "7.71", "9.96")),
    (90, 50, 5, ("259", "438", "707"), ("1270", "893", "1170")),
    (90, 50, 100, ("345", "438", "707"), ("25500", "893", "1170")),
    (720, 10, 5, ("19.5", "30.1", "47.4"), ("91.3", "61.8", "79.8")),
    (720, 10, 100, ("48.2", "30.1", "47.4"), ("1830", "61.8", "79.8")),
    (720, 50, 5, ("2070", "3490", "5650"), ("10200", "7160", "9340")),
    (720, 50, 100, ("2760", "3490", "5650"), ("204000", "7160", "9340")),
]
# N, harmonics, n, then millions: Fourier series, algorithm 1.
TABLE_6_3 = [
    (90, 6, 10, 2.50, "3.78"),
    (90, 6, 50, 277, "438"),
    (90, 10, 10, 11.6, "3.78"),
    (90, 10, 50, 1200, "438"),
    (720, 6, 10, 2.59, "30.1"),
    (720, 6, 50, 277, "3490"),
    (720, 10, 10, 11.8, "30.1"),
    (720, 10, 50, 1200, "3490"),
    (720, 15, 10, 39.7, "30.1"),
    (720, 15, 50, 3920, "3490"),
]


def half_a_digit(printed):
    """Return half a unit of the last of the three digits printed in the table."""
    value = float(printed)
    power = len(str(int(value))) - 3
    return 0.5 * 10.0 ** (power if "." not in printed else -len(printed.split(".")[1]))


@pytest.mark.parametrize(("N", "n", "cycles", "stored", "not_stored"), TABLE_6_2)
def test_counts_match_table_6_2(N, n, cycles, stored, not_stored):
    for printed, keep in ((stored, True), (not_stored, False)):
        counts = time_marching(N, n, cycles, keep), algorithm_1(N, n, keep), algorithm_2(N, n, keep)
        for text, count in zip(printed, counts, strict=True):
            assert count / 1e6 == pytest.approx(float(text), abs=1.01 * half_a_digit(text)), (text, keep)


@pytest.mark.parametrize(("N", "harmonics", "n", "fourier", "first"), TABLE_6_3)
def test_counts_match_table_6_3(N, harmonics, n, fourier, first):
    """The counts of algorithm 1 agree to the digits printed. Those of the Fourier series agree with the
    formula above the table to 7 %."""
    assert algorithm_1(N, n) / 1e6 == pytest.approx(float(first), abs=1.01 * half_a_digit(first))
    assert abs(misfit(N, harmonics, n, fourier)) < 0.07


def misfit(N, harmonics, n, printed):
    """Return the difference of the printed number, in millions, from the formula, relative to the formula."""
    return printed * 1e6 / fourier_series(N, n, harmonics) - 1


def test_printed_fourier_column_differs_from_its_formula():
    """Differences from the formula at the four entries with the largest differences."""
    assert fourier_series(90, 10, 6) == 216 * 11_200 + 36 * 112 + 6 * 36_700 - 12_460
    for (N, harmonics, n), millions in {
        (90, 6, 10): 2.63, (90, 6, 50): 285, (90, 10, 50): 1214, (720, 15, 10): 38.7,
    }.items():  # fmt: skip
        assert fourier_series(N, n, harmonics) / 1e6 == pytest.approx(millions, rel=2e-3)
    misfits = {row[:3]: 100 * misfit(*row[:4]) for row in TABLE_6_3}
    print("misfit of Table 6.3 in percent:", {case: f"{value:+.1f}" for case, value in misfits.items()})
    assert max(map(abs, misfits.values())) == pytest.approx(100 * (1 - 2.59 / 2.782_172))


def test_marching_is_cheaper_only_for_few_cycles():
    """With stored matrices, marching is cheaper if the transient decays quickly. Algorithm 1 always requires
    fewer operations than algorithm 2."""
    assert time_marching(90, 10, 5) < algorithm_1(90, 10) < time_marching(90, 10, 100)
    for n in range(1, 60):
        for keep in (True, False):
            assert algorithm_1(90, n, keep) < algorithm_2(90, n, keep)
