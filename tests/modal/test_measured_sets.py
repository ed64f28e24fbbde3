"""Modal analysis of measured records, whose modes other methods know."""

from pathlib import Path

import numpy as np
import pytest

import dynid

SHARED = Path(__file__).parents[3] / "shared" / "data"
BEAM = SHARED / "measured/resonantdoublebeam_data.mat"

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
