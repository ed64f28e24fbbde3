"""Scenes as users write them, and what is said of them."""

from dynid.errors import SceneError
from dynid.scene.load import check_source
from dynid.scene.yaml.source import parse_source

# Both as the documentation gives them, every key of which stays valid.
ISOLATOR = """\
dynid: 1                      # scene format
kind: bond-graph
title: Passive tuned isolator
parameters: {m_s: 10, b: 50, A_p: 0.01, I_f: 2.0e4, C_a: 1.0e-8, m_e: A_p**2 * I_f}
graph:
  nodes:
    v_in: Sf                  # Se Sf I C R TF GY 0 1
    m_s: {type: I, value: m_s}   # TF: value is the modulus n (e1 = n e2)
    base: 0
    body: '1'
    b: {type: R, value: b}
    tuning: {type: TF, value: A_p}
    fluid: 1
    I_f: {type: I, value: I_f}
    C_a: {type: C, value: C_a}
  bonds:                      # power positive along the arrow; chains allowed
    - v_in -> base -> body
    - body -> m_s
    - body -> b
    - base -> tuning -> fluid
    - fluid -> I_f
    - fluid -> C_a
analysis:
  inputs: [v_in]
  outputs: [m_s.f]            # NODE.e, NODE.f, NODE.q, NODE.p
  results: [transfer_function, zeros, poles, properties, frequency_response, time_response]
  frequency: {start: 0.1, stop: 100, points: 400, scale: log, unit: Hz}
  time: {stop: 2, step: 1.0e-3, input: {kind: step}}
initial: {m_s: {f: 0.1}}
expect:
  - {path: bond_graph/properties/m_s.f/v_in/relative_degree, value: 0}
  - {path: bond_graph/properties/m_s.f/v_in/dc_gain, value: 1, rtol: 1.0e-9}
"""

JOINTS = """\
dynid: 1
kind: identification
structure:
  lumped:
    masses: [2, 2, 1.5, 1, 1]
    links: [{dofs: [1], k: 2.0e4, c: 20}, {dofs: [1, 2], k: 3.0e4, c: 30}, {dofs: [4, 5], k: 2.0e4, c: 20}]
joints:
  upper: {dofs: [2, 3], k: {start: 1.0e4, true: 2.0e4}, c: {start: 10, true: 20}}
excitation: [{dof: 5, kind: multisine, amplitude: [100, 100, 100], frequency: [70, 110, 250]}]
measurement:
  step: 0.002
  samples: 800
  channels: [{dof: 2, quantity: velocity}, {dof: 3, quantity: velocity}]
  simulate: {noise_ratio: 0.05, seed: 1, settle: 10, model: full}
estimator: {method: filter, passes: 2}
"""

REDUCTIONS = """\
dynid: 1
kind: reduction
structure:
  lumped:
    masses: [2, 2, 1.5, 1, 1]
    links: [{dofs: [1], k: 2.0e4, c: 20}, {dofs: [1, 2], k: 3.0e4, c: 30}, {dofs: [4, 5], k: 2.0e4, c: 20}]
joints:
  upper: {dofs: [2, 3], k: 2.0e4, c: 20}
  lower: {dofs: [3, 4], k: {value: 2.0e4}}
reduction:
  - {method: serep, masters: [1, 3, 5], modes: [1, 2, 3]}
  - {method: joint-aware, masters: {count: 3, choose: qr}, modes: {count: 3}}
  - {method: guyan}
  - {method: irs, masters: [1, 3], iterations: 3}
  - {method: dynamic, masters: [1, 3], frequency: 10, unit: Hz}
  - {method: craig-bampton, masters: [2, 3, 4], modes: {below: 30, unit: Hz}}
  - {method: modal, modes: [1, 2], residuals: [5]}
  - {method: serep, modes: {count: 4}}
frequency: {start: 10, stop: 100}
inputs: [5]
outputs: [{dof: 2, quantity: velocity}]
substructures: {base: [1, 2]}
"""

SYNTHESIS = """\
dynid: 1
kind: synthesis
title: A wanted impedance
parameters: {r: 4}
impedance: {numerator: [1, 3, 1], denominator: [1, r]}
forms: [cauer, brune]
domain: electrical
expect:
  - {path: synthesis/brune/residual, max: 1.0e-12}
"""

MODAL = """\
dynid: 1
kind: modal-analysis
title: Modes of a chain
measurement:
  channels:
    - {dof: 1, quantity: acceleration, reference: {dof: 3}}
    - {dof: "12:-z", quantity: velocity, reference: {dof: 3}, gain: 2}
  noise: {kind: proportional, ratio: 0.02}
  frf: {file: {path: f.csv, frequency: f, columns: [[a, b], [c, d]]}, unit: Hz}
band: {low: 2, high: 45, unit: Hz}
modes: {shapes: real, reciprocal: auto}
"""

STUDY = """\
dynid: 1
kind: study
scene: suspension.yaml
vary:
  joints.upper.k.true: {start: 1.0e4, stop: 3.0e4, points: 5, scale: log}
  joints.upper.c.true: {distribution: lognormal, mean: 20, std: 5, high: 60}
  joints.lower.k.true: {distribution: uniform, low: 1.0e4, high: 3.0e4}
  joints.lower.c.true: {distribution: triangular, low: 10, mode: 20, high: 30, name: c_low}
  measurement.simulate.seed: [1, 2, 3]
derive: {joints.lower.c.start: c_low / 2}
sampling:
  method: latin-hypercube
  samples: 15
  seed: 1
  correlation: [{between: [joints.upper.c.true, joints.lower.k.true], value: 0.5}]
collect: [identification/parameters/estimate]
"""


def check(text):
    """Read and check a scene."""
    return check_source(parse_source(text, "s.yaml"))


def faults_of(text):
    """Return what is wrong with a scene, as `line:column: message`; nothing when it is valid."""
    try:
        check(text)
    except SceneError as error:
        return [str(fault).removeprefix("s.yaml:") for fault in error.faults]
    return []
