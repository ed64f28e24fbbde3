"""Loops with delays by an integrator of their own: Dormand and Prince's, from break point to break point."""

from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.integrate import solve_ivp


@dataclass(frozen=True)
class DelayEquations:
    """``x' = A x + B u + E v``, ``z = C x + D u + F v``, ``v_i(t) = z_i(t - delays[i])``."""

    A: np.ndarray
    B: np.ndarray
    E: np.ndarray
    C: np.ndarray
    D: np.ndarray
    F: np.ndarray
    delays: tuple[float, ...]

    def response(self, u, breaks, start, times, levels):
        """Return x and v (times x …) for an input u(t, middle), given the middle of the interval it is in.

        `breaks`: where u is not smooth; these and t = 0 are passed on by up to so many `levels` of delays.
        """
        sums = (np.dot(counts, self.delays) for counts in product(range(levels + 1), repeat=len(self.delays)))
        at = [b + s for s in sums for b in (0.0, *breaks)]
        at += [*np.arange(0, times[-1], min(self.delays)), times[-1]]  # no interval is longer than a delay
        borders = np.unique(np.round(at, 12))
        borders = borders[(borders >= 0) & (borders <= times[-1])]
        middles, pieces = (borders[:-1] + borders[1:]) / 2, []

        def z(t, middle):
            k = int(np.searchsorted(borders, t + 1e-9 * (middle - t))) - 1
            if k < 0:
                return np.zeros(len(self.C))
            prompt = self.C @ pieces[k](t) + self.D @ u(t, middle)
            return prompt + self.F @ v(t, middle) if self.F.any() else prompt

        def v(t, middle):
            late = [z(t - delay, middle - delay)[i] for i, delay in enumerate(self.delays)]
            return np.array(late)

        x = np.array(start, dtype=float)
        states, answers = np.zeros((len(times), len(x))), np.zeros((len(times), len(self.delays)))
        for k, middle in enumerate(middles):
            ends = borders[k : k + 2]

            def rate(t, x, middle=middle):
                return self.A @ x + self.B @ u(t, middle) + self.E @ v(t, middle)

            solution = solve_ivp(rate, ends, x, "DOP853", rtol=1e-12, atol=1e-13, dense_output=True)
            pieces.append(solution.sol)
            x = solution.y[:, -1]
            for index in np.flatnonzero((times >= ends[0]) & (times < ends[1] + (k == len(middles) - 1))):
                states[index], answers[index] = solution.sol(times[index]), v(times[index], middle)
        return states, answers


def servo(m, b, k, tau, kp=2.0, ki=1.0):
    """Return a mass on spring and damper, its position under a PI controller whose force comes late."""
    A = np.array([[0, 1, 0], [-k / m, -b / m, 0], [-1, 0, 0]])
    B, E = np.array([[0.0], [0.0], [1.0]]), np.array([[0.0], [1 / m], [0.0]])
    return DelayEquations(A, B, E, np.array([[-kp, 0.0, ki]]), np.array([[kp]]), np.zeros((1, 1)), (tau,))


def force_loop(m, b, tau, kp=0.6):
    """Return a mass with a damper whose force of inertia is fed back late: z = kp (r - F + b v)."""
    A, E = np.array([[-b / m]]), np.array([[1 / m]])
    C, D, F = np.array([[kp * b]]), np.array([[kp]]), np.array([[-kp]])
    return DelayEquations(A, np.zeros((1, 1)), E, C, D, F, (tau,))
