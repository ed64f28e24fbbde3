"""A measured robot arm predicted by a graph, beside peers of the same order."""

import numpy as np
import pytest

from dynid.bench.cases.robot_arm import by_arx, by_graph, by_subspace, fit, missing_data, record


def peers_on_known_data():
    """Return the input and the output, without noise, of a known model of second order."""
    u = np.random.default_rng(1).standard_normal(400)
    y = np.zeros(400)
    for k in range(2, 400):
        y[k] = 1.6 * y[k - 1] - 0.9 * y[k - 2] + 0.5 * u[k] + 0.3 * u[k - 1] - 0.2 * u[k - 2]
    return u, y


@pytest.mark.parametrize("peer", [by_arx, by_subspace])
def test_a_peer_predicts_what_it_can_describe(peer):
    u, y = peers_on_known_data()
    assert fit(y[200:], peer(u, y, 2, 200)) > 99.9


@pytest.mark.slow
@pytest.mark.skipif(bool(missing_data()), reason=missing_data() or "data")
def test_two_inertias_predict_the_second_half_as_well_as_arx_of_that_order():
    u, y = record(1024)
    found, predicted = by_graph(1024)
    reached, arx, subspace = (
        fit(y[512:], each) for each in (predicted[512:], by_arx(u, y, 4, 512), by_subspace(u, y, 4, 512))
    )
    assert all(value > 0 for value in found.values())
    assert reached > 75  # 78 %, of ARX 79 %, of the subspace model 25 %
    assert reached > arx - 5
    assert reached > subspace
