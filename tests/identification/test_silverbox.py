"""A measured circuit with a cubic spring: the Silverbox of Wigren & Schoukens (2013)."""

from pathlib import Path

import pytest

import dynid

DATA = Path(__file__).parents[3] / "shared/data/nonlinear/silverbox_SNLS80mV.mat"
# A mass on a spring: the voltage V1 is its force, V2 its displacement. The arrow comes first, then ten
# multisines, of which the first three quarters are fitted.
SCENE = f"""
dynid: 1
kind: identification
parameters: {{m: {{start: 5.0e-6}}, level: {{start: 0, scale: linear}}}}
structure: {{lumped: {{masses: [m]}}}}
joints:
  spring:
    dofs: [1]
    k: {{start: 1}}
    c: {{start: 2.0e-4}}
    laws: [{{kind: cubic, k3: {{start: 1}}}}, {{kind: power, d: 2, a: {{start: 0}}}}]
excitation: [{{dof: 1, kind: file, path: {DATA}, column: V1, first: 40651}}]
measurement:
  step: 1.6384e-3
  samples: 67816
  channels: [{{dof: 1, quantity: displacement, offset: level}}]
  file: {{path: {DATA}, columns: [V2], first: 40651}}
  held_out:
    - samples: 22606
      file: {{first: 108467}}
      excitation: [{{dof: 1, kind: file, path: {DATA}, column: V1, first: 108467}}]
    - samples: 40575
      initial_samples: 100
      file: {{first: 1}}
      excitation: [{{dof: 1, kind: file, path: {DATA}, column: V1, first: 1}}]
estimator: {{method: output-error}}
derived: []
"""


@pytest.mark.slow
@pytest.mark.skipif(not DATA.exists(), reason="the measured data lie beside the project, in ../shared")
def test_six_parameters_predict_the_multisine_and_the_arrow(tmp_path):
    path = tmp_path / "silverbox.yaml"
    path.write_text(SCENE)
    result = dynid.run(dynid.load_scene(path))
    assert result["identification/diagnostics/residual_rms"].data[0] < 0.31e-3
    multisine, arrow = result["identification/held_out/residual_rms"].data
    assert multisine < 0.31e-3
    assert arrow < 0.40e-3
    assert not result.value("identification/diagnostics/white")
    warnings = " ".join(map(str, result["identification/diagnostics/warnings"].data))
    assert "is not white noise; it is strongest at" in warnings
