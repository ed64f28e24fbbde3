"""Modes of a modal analysis handed to an identification: with their covariance and scale."""

import numpy as np
import pytest
import scipy.linalg as sl

import dynid

pytestmark = pytest.mark.thorough

MASSES = [2.0, 2.0, 1.5, 1.0, 1.0]
LINKS = [((0,), 2e4, 6.0), ((0, 1), 3e4, 9.0), ((3, 4), 2e4, 6.0)]
TRUE = {"upper.k": 1.5e4, "upper.c": 12.0, "lower.k": 2.5e4}
OMEGA = 2 * np.pi * np.linspace(2, 45, 431)
CHAIN = """dynid: 1
kind: identification
structure:
  lumped:
    masses: [2, 2, 1.5, 1, 1]
    links: [{dofs: [1], k: 2.0e4, c: 6}, {dofs: [1, 2], k: 3.0e4, c: 9}, {dofs: [4, 5], k: 2.0e4, c: 6}]
joints:
  upper: {dofs: [2, 3], k: {start: 1.0e4}, c: {start: 10}}
  lower: {dofs: [3, 4], k: {start: 1.0e4}}
"""
RESPONSES = """measurement:
  channels:
    - {dof: 1, quantity: acceleration, reference: {dof: 5}}
    - {dof: 3, quantity: acceleration, reference: {dof: 5}}
    - {dof: 5, quantity: acceleration, reference: {dof: 5}}
  noise: {kind: proportional, ratio: 0.02}
  frf: {file: {path: f.csv, frequency: f, columns: [[a, b], [c, d], [e, g]]}, unit: Hz}
"""
MODAL = f"dynid: 1\nkind: modal-analysis\n{RESPONSES}band: {{low: 2, high: 45, unit: Hz}}\n"


def matrices(values=TRUE):
    """Return mass, damping and stiffness of the chain."""
    links = [*LINKS, ((1, 2), values["upper.k"], values["upper.c"]), ((2, 3), values["lower.k"], 0.0)]
    C, K = np.zeros((2, 5, 5))
    for ends, k, c in links:
        v = np.zeros(5)
        v[ends[-1]], v[ends[0]] = 1, -1 if len(ends) > 1 else 1
        K += k * np.outer(v, v)
        C += c * np.outer(v, v)
    return np.diag(MASSES), C, K


def write_responses(path, seed):
    """Write accelerances of DOFs 1, 3 and 5 to a force at 5, with noise of 2 % of each line."""
    M, C, K = matrices()
    exact = -np.array([w**2 * np.linalg.inv(K + 1j * w * C - w**2 * M)[[0, 2, 4], 4] for w in OMEGA])
    random = np.random.default_rng(seed)
    noise = random.standard_normal(exact.shape) + 1j * random.standard_normal(exact.shape)
    values = exact * 1.0 + 0.02 * np.abs(exact) * noise / np.sqrt(2)
    table = np.column_stack([OMEGA / (2 * np.pi), np.ascontiguousarray(values).view(float)])
    np.savetxt(path, table, delimiter=",", header="f,a,b,c,d,e,g", comments="", fmt="%.12g")


def run(folder, text, name):
    """Return the result of a scene, and write it to a file of that name."""
    (folder / f"{name}.yaml").write_text(text)
    result = dynid.run(folder / f"{name}.yaml")
    dynid.write_result(result, folder / f"{name}.h5")
    return result


def estimates(result):
    """Return estimates and standard errors over the true values, in the order of `TRUE`."""
    names = list(result["identification/parameters/name"].data)
    rows = [names.index(name) for name in TRUE]
    columns = (
        result[f"identification/parameters/{key}"].data[rows] for key in ("estimate", "standard_error")
    )
    return [column / np.array(list(TRUE.values())) for column in columns]


def both(folder, seed):
    """Return estimates and errors by the modes of responses, and by the responses."""
    write_responses(folder / "f.csv", seed)
    run(folder, MODAL, "modal")
    by_modes = run(folder, CHAIN + "measurement: {modes: {file: modal.h5}}\n", "by_modes")
    return estimates(by_modes), estimates(run(folder, CHAIN + RESPONSES, "by_responses")), by_modes


def test_modes_determine_joints_nearly_as_well_as_the_responses(tmp_path):
    (estimate, error), (_, direct), result = both(tmp_path, 0)
    assert np.all(error < 1.2 * direct)
    assert np.all(np.abs(estimate - 1) < 4 * error)
    assert result.value("identification/diagnostics/converged")
    squares, degrees = (result.value(f"identification/modes/{name}") for name in ("chi2", "chi2_degrees"))
    assert squares < degrees + 5 * np.sqrt(2 * degrees)
    assert degrees == 5 * (2 + 2 * 3) - 3  # no scale of a shape is free


@pytest.mark.slow
def test_estimates_by_modes_are_covered(tmp_path):
    runs = [both(tmp_path, seed)[:2] for seed in range(200)]
    standard = np.array([(modes[0] - 1) / modes[1] for modes, _ in runs])
    assert 0.92 < np.mean(np.abs(standard) < 1.96) < 0.98
    assert np.all(np.mean([modes[1] / direct[1] for modes, direct in runs], axis=0) < 1.2)


@pytest.mark.slow
def test_modes_listed_with_the_usual_floors_say_less(tmp_path):
    _, (_, direct), _ = both(tmp_path, 0)
    modal = dynid.run(tmp_path / "modal.yaml")
    names = ("frequency", "frequency_standard_error", "damping", "damping_standard_error")
    heads, columns = ["frequency [rad/s]", "frequency_std [rad/s]", "damping", "damping_std"], []
    columns += [[repr(float(value)) for value in modal[f"modal/{name}"].data] for name in names]
    for k, channel in enumerate(modal["modal/channel"].data):
        heads += [str(channel), f"std {channel}"]
        shape, error = modal["modal/shape"].data[:, k], modal["modal/shape_standard_error"].data[:, k]
        columns += [[f"{z.real:.17g}{z.imag:+.17g}i" for z in shape], [repr(float(e)) for e in error]]
    rows = [heads, *zip(*columns, strict=True)]
    (tmp_path / "modes.csv").write_text("\n".join(",".join(row) for row in rows))
    listed = estimates(run(tmp_path, CHAIN + "measurement: {modes: {file: modes.csv}}\n", "listed"))[1]
    assert np.allclose(listed / direct, [20.8, 10.2, 31.7], rtol=0.02)


def test_some_modes_of_a_file_without_a_scale(tmp_path):
    write_responses(tmp_path / "f.csv", 1)
    two = MODAL.replace("    - {dof: 5, quantity: acceleration, reference: {dof: 5}}\n", "")
    run(tmp_path, two.replace(", [e, g]", ""), "modal")
    chosen = CHAIN + "measurement: {modes: {file: {path: modal.h5, modes: [1, 2, 3, 5]}}}\n"
    result = run(tmp_path, chosen, "by_modes")
    estimate, error = estimates(result)
    assert np.all(np.abs(estimate - 1) < 4 * error)
    assert result.value("identification/modes/chi2_degrees") == 4 * (2 + 2 * 2 - 2) - 3


@pytest.mark.parametrize("real", [False, True])
def test_scaled_shapes_and_their_slopes(real):
    from dynid.identification.likelihood.paired_modes import _scaled
    from dynid.scene.kinds.structures import build_structure
    from dynid.scene.load import check_source
    from dynid.scene.yaml.source import parse_source
    from dynid.structure.mode_derivatives import lowest_modes

    scene = check_source(parse_source(CHAIN + RESPONSES, "s.yaml"))
    model = build_structure(scene, scene.model.structure, scene.model.joints)
    rows = np.eye(5)[[0, 2, 4]]

    def shape(mode, values):
        M, C, K = matrices(values)
        A = np.block([[np.zeros((5, 5)), np.eye(5)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
        poles, vectors = sl.eig(A)
        index = np.argsort(np.where(poles.imag > 0, np.abs(poles), np.inf))[mode]
        pole, psi = poles[index], vectors[:5, index]
        scaled = psi / np.sqrt(psi @ (2 * pole * M + C) @ psi)
        scaled = (np.sqrt(2j * pole.imag) * scaled).real if real else scaled
        return scaled[[0, 2, 4]]

    solution = lowest_modes(model, TRUE, 5, 30.0, damped=True)
    for mode in (0, 3):
        scaled, slopes = _scaled(solution, mode, model.slopes(TRUE), rows, real=real)
        exact = shape(mode, TRUE)
        sign = np.sign((scaled[0] / exact[0]).real)
        assert np.allclose(scaled, sign * exact, rtol=1e-8, atol=1e-10)
        names = [unknown.name for unknown in model.unknowns]
        for column, name in enumerate(names):
            step = 1e-5 * TRUE[name]
            moved = [shape(mode, {**TRUE, name: TRUE[name] + way * step}) for way in (1, -1)]
            moved = [np.sign((values[0] / exact[0]).real) * values for values in moved]
            difference = sign * (moved[0] - moved[1]) / (2 * step)
            assert np.allclose(slopes[:, column], difference, rtol=1e-5, atol=1e-6 * np.abs(difference).max())


def test_a_floor_beside_a_covariance_is_refused_and_an_error_of_the_form_added(tmp_path):
    from dynid.errors import UsageError

    write_responses(tmp_path / "f.csv", 2)
    run(tmp_path, MODAL, "modal")
    modes = "measurement: {modes: {file: modal.h5, %s: {frequency: 0.002, damping: 0, shape: 0.01}}}\n"
    with pytest.raises(UsageError, match="to which no floor is added"):
        run(tmp_path, CHAIN + modes % "floor", "by_modes")
    _, wider = estimates(run(tmp_path, CHAIN + modes % "model_error", "by_modes"))
    _, error = estimates(run(tmp_path, CHAIN + "measurement: {modes: {file: modal.h5}}\n", "by_modes"))
    assert np.all(wider > 5 * error[[0, 1, 2]] * [1, 0.2, 1])


def test_a_file_that_is_no_modal_analysis_is_refused(tmp_path):
    from dynid.errors import FileError

    write_responses(tmp_path / "f.csv", 0)
    run(tmp_path, CHAIN + RESPONSES, "other")
    with pytest.raises(FileError, match="is no result of a modal analysis"):
        run(tmp_path, CHAIN + "measurement: {modes: {file: other.h5}}\n", "by_modes")
    with pytest.raises(FileError, match="has modes by their usual names"):
        run(tmp_path, CHAIN + "measurement: {modes: {file: {path: other.h5, frequency: f}}}\n", "by_modes")


AMBIENT = """dynid: 1
kind: modal-analysis
measurement:
  step: 0.01
  samples: 12000
  channels:
    [{dof: 1, quantity: acceleration}, {dof: 3, quantity: acceleration}, {dof: 5, quantity: acceleration}]
  file: {path: ambient.npy}
band: {low: 2, high: 45, unit: Hz}
"""


def write_ambient(path, seed, step=0.01, samples=12000, settle=1000):
    """Write accelerations of DOFs 1, 3 and 5 under white forces held in each step, with 5 % noise."""
    from scipy.signal import lfilter

    M, C, K = matrices()
    random = np.random.default_rng(seed)
    forces = random.standard_normal((samples + settle, 5))
    A = np.block([[np.zeros((5, 5)), np.eye(5)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    poles, vectors = np.linalg.eig(A)
    drive = np.linalg.solve(vectors, np.vstack([np.zeros((5, 5)), np.linalg.inv(M)]))
    z = np.stack(
        [
            lfilter([0, (np.exp(pole * step) - 1) / pole], [1, -np.exp(pole * step)], forces @ row)
            for pole, row in zip(poles, drive, strict=True)
        ],
        axis=1,
    )
    motion = (z * poles) @ vectors[5:].T
    values = (motion.real + forces @ np.linalg.inv(M).T)[settle:, [0, 2, 4]]
    np.save(path, values + 0.05 * values.std(axis=0) * random.standard_normal(values.shape))


@pytest.mark.slow
def test_modes_of_ambient_vibration_give_joints_with_covered_intervals(tmp_path):
    """40 records: errors over standard errors, RMS and share within 1.96 (120 values)."""
    joints, errors = CHAIN + "measurement: {modes: {file: ambient_modes.h5}}\n", []
    for seed in range(40):
        write_ambient(tmp_path / "ambient.npy", seed)
        run(tmp_path, AMBIENT, "ambient_modes")
        estimate, error = estimates(run(tmp_path, joints, "joints"))
        errors.append((estimate - 1) / error)
    z = np.array(errors)
    print(f"RMS {np.sqrt(np.mean(z**2, axis=0))}, covered {100 * np.mean(np.abs(z) < 1.96):.1f} %")
    assert np.mean(np.abs(z) < 1.96) > 0.88
    assert np.all(np.abs(z.mean(axis=0)) < 0.6)
