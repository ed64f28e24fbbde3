"""Recurrences by blocks are those of one step after the other."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynid.lti.recurrence import free_response, powers_of, recurrence


def stable(n, seed):
    rng = np.random.default_rng(seed)
    Phi = rng.standard_normal((n, n))
    return rng, Phi / max(1.0, np.abs(np.linalg.eigvals(Phi)).max())


@given(steps=st.integers(0, 300), columns=st.integers(1, 3), n=st.integers(1, 5), seed=st.integers(0, 99))
def test_blocks_give_what_single_steps_give(steps, columns, n, seed):
    rng, Phi = stable(n, seed)
    forcing, start = rng.standard_normal((steps, columns, n)), rng.standard_normal((columns, n))
    states, state = [], start
    for f in forcing:
        state = (Phi @ state.T).T + f
        states.append(state)
    expected = np.array(states).reshape(forcing.shape)
    scale = np.abs(expected).max(initial=1.0)
    np.testing.assert_allclose(recurrence(Phi, forcing, start), expected, rtol=0, atol=1e-12 * scale)


@pytest.mark.thorough
@given(steps=st.integers(0, 300), n=st.integers(1, 5), seed=st.integers(0, 99))
def test_a_free_response_is_read_without_its_states(steps, n, seed):
    rng, Phi = stable(n, seed)
    start, readout = rng.standard_normal((n, 3)), rng.standard_normal((2, n))
    outputs, end = free_response(Phi, start, readout, steps)
    state = start
    scale = np.abs(np.linalg.inv(np.linalg.eig(Phi)[1])).max() * 100
    for output in outputs:
        state = Phi @ state
        np.testing.assert_allclose(output, readout @ state, rtol=0, atol=1e-14 * scale)
    np.testing.assert_allclose(end, state, rtol=0, atol=1e-14 * scale)


@pytest.mark.parametrize("count", [1, 2, 3, 7, 8, 9])
def test_powers(count):
    _, Phi = stable(3, 1)
    for k, power in enumerate(powers_of(Phi, count), 1):
        np.testing.assert_allclose(power, np.linalg.matrix_power(Phi, k), rtol=1e-13)


def test_the_work_grows_with_the_steps_and_no_faster():
    """Products of a record ten times as long: the root of ten times as many, each over as many columns."""
    counts = []
    for steps in (800, 8_000, 80_000):
        counted = Counted(np.eye(2)[::-1] * 0.5)
        recurrence(counted, np.zeros((steps, 1, 2)), np.zeros((1, 2)))
        counts.append(Counted.products)
        Counted.products = 0
    assert counts[1] < 3.5 * counts[0]
    assert counts[2] < 3.5 * counts[1]


class Counted(np.ndarray):
    """A matrix that counts what is multiplied by it, or by what is made of it."""

    products = 0

    def __new__(cls, values):
        return np.asarray(values).view(cls)

    def __array_ufunc__(self, ufunc, method, *inputs, out=None, **options):
        Counted.products += ufunc is np.matmul
        plain = [np.asarray(x) for x in inputs]
        if out is not None:
            options["out"] = tuple(np.asarray(x) for x in out)
        return np.asarray(getattr(ufunc, method)(*plain, **options)).view(Counted)
