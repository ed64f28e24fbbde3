"""Records that are held out: predicted at the estimate, and not fitted."""

import numpy as np
import pytest

import dynid
from dynid.errors import SceneError

BODY = """
dynid: 1
kind: identification
structure: {{lumped: {{masses: [1, 0.7], links: [{{dofs: [1], k: 1.5e4, c: 5}}]}}}}
joints: {{bolt: {{dofs: [1, 2], k: {{start: 9.0e3, true: 1.0e4}}, c: 4{laws}}}}}
excitation: [{{dof: 2, kind: multisine, amplitude: [6, 6], frequency: [60, 120]}}]
measurement:
  step: 0.004
  samples: 60
  channels: [{{dof: 1, quantity: velocity}}, {{dof: 2, quantity: displacement}}]
  simulate: {{noise_ratio: 0.01, seed: 1}}
  held_out: {held_out}
estimator: {{method: output-error}}
"""
CUBIC = ", laws: [{kind: cubic, k3: {start: 1.0e8, true: 2.0e8}}]"


def run(folder, held_out, laws=""):
    path = folder / "scene.yaml"
    path.write_text(BODY.format(held_out=held_out, laws=laws))
    return dynid.run(dynid.load_scene(path))


@pytest.mark.parametrize("laws", ["", CUBIC], ids=["linear", "cubic"])
def test_a_record_is_predicted_to_its_noise(tmp_path, laws):
    held_out = "[{}, {samples: 100, initial_samples: 40}]"
    result = run(tmp_path, held_out, laws)
    ratio = result["identification/held_out/residual_ratio"].data
    assert ratio == pytest.approx(0.01, rel=0.3)
    assert list(result["identification/held_out/channel"].data)[:3] == [
        "record_1.1.velocity", "record_1.2.displacement", "record_2.1.velocity",
    ]  # fmt: skip
    group = "identification/held_out/record_2"
    assert len(result[f"{group}/time"].data) == 100
    residual = result[f"{group}/measured"].data - result[f"{group}/predicted"].data
    assert np.sqrt(np.mean(residual**2, axis=0)) == pytest.approx(
        result["identification/held_out/residual_rms"].data[2:4]
    )
    assert len(result["identification/measurement/time"].data) == 60  # the fitted record stands alone


def test_records_held_out_are_of_a_structure_and_of_time(tmp_path):
    with pytest.raises(SceneError, match="the file of held-out record 1 needs the key 'path'"):
        run(tmp_path, "[{file: {}}]")


def test_a_free_decay_has_no_load(tmp_path):
    path = tmp_path / "decay.yaml"
    text = BODY.format(held_out="[]", laws=CUBIC)
    text = text.replace(
        "excitation: [{dof: 2, kind: multisine, amplitude: [6, 6], frequency: [60, 120]}]", ""
    )
    path.write_text(text + "initial: {2: {x: 2.0e-3}}\n")
    result = dynid.run(dynid.load_scene(path))
    estimate, error = (
        result[f"identification/parameters/{key}"].data for key in ("estimate", "standard_error")
    )
    assert (np.abs(estimate - [1e4, 2e8]) < 4 * error).all()
    assert (error < [20.0, 2e7]).all()
