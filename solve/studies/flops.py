"""Numbers of floating-point operations that four methods require for a periodic solution, as counted in the
thesis (Table 6.1 and the formula above Table 6.3). They refer to n coordinates, N steps per period and
Newmark's method.

If `stored` is True, the matrices of all steps are kept in memory. The counts are those of the thesis for
algorithms that form and invert these matrices. They do not apply to the code of this package.
"""


def time_marching(N: int, n: int, cycles: int, stored: bool = True) -> int:
    """Number of operations for time marching from rest over `cycles` cycles, in which the transient
    decays."""
    if stored:
        return N * (22 * n**3 + (29 + 4 * cycles) * n**2 + (3 + 2 * cycles) * n)
    return N * cycles * (22 * n**3 + 33 * n**2 + 5 * n)


def algorithm_1(N: int, n: int, stored: bool = True) -> int:
    """Number of operations for the transition matrix and two cycles (thesis, section 6.5)."""
    if stored:
        return N * (38 * n**3 + 37 * n**2 + 7 * n) + 16 * n**3 + 8 * n**2
    return N * (78 * n**3 + 77 * n**2 + 10 * n) - 14 * n**3 - 21 * n**2 - 3 * n


def algorithm_2(N: int, n: int, stored: bool = True) -> int:
    """Number of operations for the closed form, which uses the inverse of the matrix of each step (thesis,
    section 6.6)."""
    if stored:
        return N * (62 * n**3 + 37 * n**2 + 9 * n) + 8 * n**3 + 8 * n**2 + 2 * n
    return N * (102 * n**3 + 87 * n**2 + 10 * n) - 14 * n**3 - 21 * n**2 - n


def fourier_series(N: int, n: int, harmonics: int) -> int:
    """Number of operations for the Fourier series of the matrices, the load and the response (thesis, section
    6.4)."""
    N_h = harmonics
    return (
        N_h**3 * (8 * n**3 + 32 * n**2)
        + N_h**2 * (12 * n**3 - 120 * n**2 + 8 * n + 32)
        + N_h * (6 * n**3 + 270 * n**2 + 10 * n + 4 * n * N)
        + n**3
        - 135 * n**2
        + 4 * n
    )
