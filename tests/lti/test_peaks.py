"""Refined maxima of frequency responses, against closed forms."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynid.errors import NumericalError, Singular
from dynid.lti.peaks import peaks


def modes_of(*given):
    """Return sum of r / (w^2 - omega^2 + 2 j z w omega) as a function of omega, as one channel."""

    def evaluate(omega):
        with np.errstate(all="ignore"):  # infinite at an undamped pole
            total = sum(r / (w**2 - omega**2 + 2j * z * w * omega) for r, w, z in given)
        return total[:, None, None]

    return evaluate


def refined(evaluate, omega, near=()):
    found = peaks(evaluate, omega, evaluate(omega), near)
    return float(found.magnitude[0, 0]), float(found.omega[0, 0])


@given(
    st.floats(0.02, 0.6),
    st.floats(2.0, 50.0),
    st.integers(20, 300),
    st.sampled_from([np.geomspace, np.linspace]),
)
def test_the_maximum_of_one_mode_does_not_depend_on_the_grid(damping, natural, points, spaced):
    height, where = refined(modes_of((natural**2, natural, damping)), spaced(1.0, 100.0, points))
    assert height == pytest.approx(1 / (2 * damping * math.sqrt(1 - damping**2)), rel=1e-9)
    # The top is flat to 1e-10: its place is known to some 1e-5 of the width of the resonance.
    assert where == pytest.approx(natural * math.sqrt(1 - 2 * damping**2), rel=1e-4)


@given(st.floats(1e-7, 1e-3), st.floats(3.0, 90.0))
def test_a_resonance_between_the_frequencies_of_a_coarse_grid_is_found_near_its_pole(damping, natural):
    pole = natural * math.sqrt(1 - damping**2)
    height, _ = refined(modes_of((natural**2, natural, damping)), np.linspace(1.0, 100.0, 12), [pole])
    assert height == pytest.approx(1 / (2 * damping * math.sqrt(1 - damping**2)), rel=1e-8)


@pytest.mark.parametrize("near", [(), (7.0,), (math.sqrt(49.0),)])
def test_an_undamped_resonance_is_infinite(near):
    height, where = refined(modes_of((49.0, 7.0, 0.0)), np.linspace(1.0, 20.1, 54), near)
    assert (height, where) == (math.inf, pytest.approx(7.0, rel=1e-14))


def test_a_pole_that_double_precision_cannot_resolve_is_infinite():
    def evaluate(omega):
        if np.any(np.abs(omega - 7.0) < 1e-13 * 7.0):
            raise Singular("too near")
        return (1 / (49.0 - omega**2))[:, None, None]

    height, where = refined(evaluate, np.linspace(1.0, 20.1, 54))
    assert (height, where) == (math.inf, pytest.approx(7.0, rel=1e-12))


def test_channels_are_refined_on_their_own():
    one, other = modes_of((1.0, 5.0, 0.05)), modes_of((1.0, 11.0, 0.02), (0.4, 3.0, 0.1))
    grid = np.geomspace(1.0, 30.0, 40)

    def both(omega):
        return np.concatenate([one(omega), other(omega)], axis=1)

    found = peaks(both, grid, both(grid))
    dense = np.linspace(1.0, 30.0, 2_000_001)
    assert found.magnitude.shape == found.omega.shape == (2, 1)
    for place, alone in enumerate((one, other)):
        sampled = np.abs(alone(dense)[:, 0, 0])
        assert found.magnitude[place, 0] == pytest.approx(sampled.max(), rel=1e-9)  # h^2 of the dense grid
        assert found.omega[place, 0] == pytest.approx(dense[sampled.argmax()], abs=1e-4)


@pytest.mark.parametrize(
    ("evaluate", "expected"),
    [
        (lambda omega: 1 / (1 + 1j * omega), (1 / math.sqrt(2), 1.0)),  # falls: at the start of the band
        (lambda omega: 1j * omega, (10.0, 10.0)),  # rises: at its end
        (lambda omega: 0 * omega + 3, (3.0, 1.0)),
        (lambda omega: 0 * omega, (0.0, 1.0)),
    ],
)
def test_the_band_ends_where_the_grid_does(evaluate, expected):
    found = refined(lambda omega: evaluate(omega)[:, None, None], np.geomspace(1.0, 10.0, 7), [0.5, 11.0])
    assert found == (pytest.approx(expected[0], rel=1e-12), expected[1])


def test_one_frequency_is_its_own_maximum():
    assert refined(modes_of((1.0, 5.0, 0.05)), np.array([2.0]))[1] == 2.0


def test_a_response_that_cannot_be_computed_anywhere_is_refused():
    """Infinite only beside frequencies where it can be; an undamped pole is at one frequency."""

    def nowhere(omega):
        raise Singular(f"at {len(omega)} frequencies")

    grid = np.linspace(1.0, 2.0, 5)
    response = (1 / (1 + (grid - 1.5) ** 2))[:, None, None]
    with pytest.raises(Singular, match=r"^at 1 frequencies$"):
        peaks(nowhere, grid, response, [1.6])
    with pytest.raises(Singular, match=r"^at 2 frequencies$"):
        peaks(nowhere, grid, response, [1.3, 1.6])


@pytest.mark.parametrize("near", [(2.5,), (2.5, 3.5)])
def test_an_error_at_all_frequencies_beside_the_grid_is_raised(near):
    omega = np.linspace(1.0, 5.0, 5)

    def evaluate(at):
        if not np.isin(at, omega).all():
            raise NumericalError("no value here")
        return np.ones((len(at), 1, 1))

    with pytest.raises(NumericalError, match="no value here"):
        peaks(evaluate, omega, evaluate(omega), near)
