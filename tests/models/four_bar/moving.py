"""Four-bar linkage with varying speed and moving ground pivot, integrated by SciPy.

Independent reference with one hand-coded beam element per link. Degrees of freedom: A_x, A_y, rotation of the
crank at A, of the coupler at A and at B, B_x, B_y, rotation of the follower at B and at C; then the
prescribed ones: O_x, O_y, rotation at O, C_x, C_y.
"""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import eigh

FREE = 9
# Of each link: u, v, rotation at its start, then at its end.
MAP = ((9, 10, 11, 0, 1, 2), (0, 1, 3, 5, 6, 4), (12, 13, 8, 5, 6, 7))


class Moving:
    """Four-bar linkage in motion.

    p: parameters of the case. phi(t), L4(t): crank angle (rad) and length of the ground link (m) as functions
    of time (s).
    """

    def __init__(self, p, phi, L4):
        self.p, self.phi, self.L4 = p, phi, L4
        self.lengths = p["L1"], p["L2"], p["L3"]

    def places(self, t):
        """Positions of A, B and C as complex numbers, and the angles of the links."""
        L1, L2, L3 = self.lengths
        A, C = L1 * np.exp(1j * self.phi(t)), self.L4(t)
        d = abs(C - A)
        along = (L2**2 - L3**2 + d**2) / (2 * d)
        B = A + (C - A) / d * (along + 1j * np.sqrt(L2**2 - along**2))
        return A, B, C, (self.phi(t), np.angle(B - A), np.angle(B - C))

    def rigid(self, t):
        """Rigid motion of all 14 degrees of freedom."""
        A, B, C, (t1, t2, t3) = self.places(t)
        return np.array([A.real, A.imag, t1, t2, t2, B.real, B.imag, t3, t3, 0, 0, t1, C, 0])

    def matrices(self, t):
        """M and K (14, 14)."""
        p, angles = self.p, self.places(t)[3]
        M, K = np.zeros((14, 14)), np.zeros((14, 14))
        for i, (L, angle, index) in enumerate(zip(self.lengths, angles, MAP, strict=True), start=1):
            m, k = element(L, p["rho"] * p[f"A{i}"], p["E"] * p[f"A{i}"], p["E"] * p[f"I{i}"])
            R = rotation_matrix(angle)
            M[np.ix_(index, index)] += R.T @ m @ R
            K[np.ix_(index, index)] += R.T @ k @ R
        M[[0, 1], [0, 1]] += p["mA"]
        M[[5, 6], [5, 6]] += p["mB"]
        return M, K

    def rate(self, t, x):
        M, C, K, d = self.equation(t)
        return np.concatenate((x[FREE:], np.linalg.solve(M, d - C @ x[FREE:] - K @ x[:FREE])))

    def jacobian(self, t, x):
        M, C, K, _ = self.equation(t)
        lower = np.linalg.solve(M, -np.hstack((K, C)))
        return np.vstack((np.hstack((np.zeros_like(M), np.eye(FREE))), lower))

    def equation(self, t, step=1e-4):
        """M, C, K and d for the free degrees of freedom. The acceleration is a central difference of fourth
        order."""
        M, K = self.matrices(t)
        weights = np.array([-1, 16, -30, 16, -1]) / (12 * step**2)
        acceleration = sum(w * self.rigid(t + j * step) for j, w in zip(range(-2, 3), weights, strict=True))
        d = -(M @ acceleration)[:FREE]
        M, K = M[:FREE, :FREE], K[:FREE, :FREE]
        squares, shapes = eigh(K, M)
        left = M @ shapes
        return M, left * (2 * self.p["zeta"] * np.sqrt(squares)) @ left.T, K, d

    def run(self, end):
        """Times and q (9, k) of the motion that starts in quasi-static equilibrium at t = 0."""
        _, _, K, d = self.equation(0.0)
        start = np.concatenate((np.linalg.solve(K, d), np.zeros(FREE)))
        solution = solve_ivp(
            self.rate, (0, end), start, "Radau", rtol=1e-5, atol=1e-8, jac=self.jacobian, dense_output=True
        )
        assert solution.success
        times = np.linspace(0, end, 1501)
        return times, solution.sol(times)[:FREE]

    def stress(self, times, q, link, fraction):
        """Largest |stress| (k,) on both surfaces of link 0, 1 or 2 at a fraction of its length."""
        p, L, computed = self.p, self.lengths[link], []
        B = np.array([-6 + 12 * fraction, (6 * fraction - 4) * L, 6 - 12 * fraction, (6 * fraction - 2) * L])
        for t, values in zip(times, q.T, strict=True):
            whole = np.concatenate((values, np.zeros(5)))
            local = rotation_matrix(self.places(t)[3][link]) @ whole[list(MAP[link])]
            axial = (local[3] - local[0]) / L
            bending = p[f"h{link + 1}"] / 2 * (B @ local[[1, 2, 4, 5]]) / L**2
            computed.append(p["E"] * (abs(axial) + abs(bending)))
        return np.array(computed)


def element(L, mu, EA, EI):
    """Textbook mass and stiffness matrices for u, v and rotation at both ends."""
    m, k = np.zeros((6, 6)), np.zeros((6, 6))
    a, b = [0, 3], [1, 2, 4, 5]
    m[np.ix_(a, a)] = mu * L / 6 * np.array([[2, 1], [1, 2]])
    k[np.ix_(a, a)] = EA / L * np.array([[1, -1], [-1, 1]])
    m[np.ix_(b, b)] = (
        mu * L / 420
        * np.array(
            [
                [156, 22 * L, 54, -13 * L],
                [22 * L, 4 * L**2, 13 * L, -3 * L**2],
                [54, 13 * L, 156, -22 * L],
                [-13 * L, -3 * L**2, -22 * L, 4 * L**2],
            ]
        )
    )  # fmt: skip
    k[np.ix_(b, b)] = (
        EI / L**3
        * np.array(
            [
                [12, 6 * L, -12, 6 * L],
                [6 * L, 4 * L**2, -6 * L, 2 * L**2],
                [-12, -6 * L, 12, -6 * L],
                [6 * L, 2 * L**2, -6 * L, 4 * L**2],
            ]
        )
    )  # fmt: skip
    return m, k


def rotation_matrix(angle):
    """Matrix that transforms displacements from the ground axes to those of the link."""
    c, s = np.cos(angle), np.sin(angle)
    R = np.eye(6)
    for i in (0, 3):
        R[i : i + 2, i : i + 2] = [[c, s], [-s, c]]
    return R
