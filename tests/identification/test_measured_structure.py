"""A measured structure: two beams with a joint, free decays after hammer impacts."""

from pathlib import Path

import numpy as np
import pytest

import dynid

ROOT = Path(__file__).parents[2]
DATA = ROOT.parent / "shared/data/measured/resonantdoublebeam_data.mat"


@pytest.mark.slow
@pytest.mark.skipif(not DATA.exists(), reason="the measured data lie beside the project, in ../shared")
def test_the_double_beam_has_the_two_modes_that_were_measured():
    scene = dynid.load_scene(ROOT / "configs/measured/double_beam.yaml", ["measurement.samples=2048"])
    result = dynid.run(scene)
    hertz = result["structure/modes/omega"].data / (2 * np.pi)
    np.testing.assert_allclose(hertz, [122.5, 243.3], rtol=0.005)  # peaks, as published with the data
    assert result.value("identification/diagnostics/settled")
    # Linear joints leave a tenth to a quarter of every record, and this is no noise.
    left = result["identification/diagnostics/residual_ratio"].data
    assert len(left) == 9
    assert left.max() < 0.35
    assert result.value("identification/diagnostics/lacks_fit")
