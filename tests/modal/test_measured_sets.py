"""Modal analysis of measured records, whose modes other methods know."""

from pathlib import Path

import numpy as np
import pytest

import dynid

SHARED = Path(__file__).parents[3] / "shared" / "data"
BEAM = SHARED / "measured/resonantdoublebeam_data.mat"
ARM = SHARED / "measured/robot_arm.dat"

pytestmark = pytest.mark.slow


@pytest.mark.skipif(not BEAM.is_file(), reason="the measured double beam is not here")
def test_free_decays_of_a_double_beam_after_hits_at_three_points(tmp_path):
    """Fits in time find 122.15 to 122.39 Hz and 243.1 to 244.8 Hz, rising as the decay falls.

    A mode whose frequency depends on the amplitude is described by two close ones.
    """
    records = "".join(
        f"    - {{file: {{row: {row}}}, excitation: {{dof: {11 + row // 4}, kind: impulse, amplitude: 1}}}}\n"
        for row in (1, 2, 3, 5, 6, 7, 9, 10, 11)
    )
    (tmp_path / "beam.yaml").write_text(
        "dynid: 1\nkind: modal-analysis\nmeasurement:\n  step: 1.953e-4\n  samples: 15000\n"
        "  channels: [{dof: 2, quantity: velocity}]\n"
        f"  file: {{path: {BEAM}, columns: [2]}}\n  records:\n{records}"
        "band: {low: 90, high: 280, unit: Hz}\n"
    )
    result = dynid.run(tmp_path / "beam.yaml")
    frequency = result["modal/frequency"].data / (2 * np.pi)
    assert len(frequency) == 4
    assert np.all(np.abs(frequency[:2] - 122.25) < 0.2)
    assert np.all(np.abs(frequency[2:] - 243.5) < 1.2)
    damping = result["modal/damping"].data
    assert np.all((damping > 2e-4) & (damping < 0.01))


@pytest.mark.skipif(not ARM.is_file(), reason="the measured robot arm is not here")
def test_a_flexible_robot_arm_under_a_periodic_torque(tmp_path):
    """One period of 1,024 samples, of unknown rate: its ratio at the lines that the torque has.

    The poles are those of an ARX model of order 16, fitted to the record in time by least squares.
    """
    torque, acceleration = np.loadtxt(ARM).T
    spectra, order = [np.fft.rfft(one) for one in (torque, acceleration)], 16
    driven = np.flatnonzero(np.abs(spectra[0]) > 0.05 * np.abs(spectra[0]).max())
    ratio = spectra[1][driven] / spectra[0][driven]
    table = np.column_stack([driven / 1024, ratio.real, ratio.imag])
    np.savetxt(tmp_path / "arm.csv", table, delimiter=",", header="f,re,im", comments="")
    (tmp_path / "arm.yaml").write_text(
        "dynid: 1\nkind: modal-analysis\nmeasurement:\n"
        "  channels: [{dof: 1, quantity: acceleration, reference: {dof: 1}}]\n"
        "  frf: {file: {path: arm.csv, frequency: f, columns: [[re, im]]}, unit: Hz}\n"
        "band: {low: 0.03, high: 0.196, unit: Hz}\n"  # cycles a sample
    )
    result = dynid.run(tmp_path / "arm.yaml")
    past = np.array(
        [np.r_[-acceleration[k - order : k], torque[k - order : k + 1]] for k in range(order, len(torque))]
    )
    coefficients = np.linalg.lstsq(past, acceleration[order:])[0][:order]
    poles = np.log(np.roots(np.r_[1, coefficients[::-1]]) + 0j)
    poles = poles[(poles.imag > 2 * np.pi * 0.03) & (poles.imag < 2 * np.pi * 0.196)]
    light = np.sort_complex(poles[-poles.real < 0.01 * np.abs(poles)] * -1j)
    np.testing.assert_allclose(result["modal/frequency"].data, np.abs(light), rtol=2e-3)
    np.testing.assert_allclose(result["modal/damping"].data, light.imag / np.abs(light), rtol=0.1)
