"""Make the input files of this folder: `python data/make.py`.

- suspension_noisy.h5: the record of configs/suspension_noisy.yaml (time, two velocities, the force), as a
  measurement would deliver it.
- suspension_raw.h5: a longer record at four times the rate, on zeros that drift, for
  configs/suspension_prepared.yaml.
- machine_logger.csv: a hammer blow on a machine on a frame, as a data logger writes it: semicolons, times
  rounded to six decimals, the force in kN, accelerations in g, one sensor reversed; for
  configs/machine_logger.yaml.
- machine_hammer.npz, machine_mount.wav, machine_rail.wav: the same machine, struck again (seed 12): force (N)
  and one acceleration (g) as arrays, the others as WAV of ±50 g, 16 bits;
  for configs/machine_recorders.yaml.
- machine_daq.npz, machine_handheld.csv: the same machine under a random force (seed 13): force (N) and two
  accelerations (g) at 1,024 Hz, and one of a recorder of 1,000 Hz that was started 0.25 s later, whose clock
  is slow by 40 parts in a million; for configs/machine_clocks.yaml.
- chain_frf.csv, chain_modal.h5: accelerances of a chain (2 % noise of every line, seed 3), and its modes by
  configs/chain_frf_modes.yaml.
- chain_ambient.npz: accelerations (g) of that chain under random forces and a machine at 20 Hz (seed 5), for
  configs/chain_ambient.yaml.
- process_delay.csv: a set point that is moved now and then, and what a process of gain 2, time constant 10 s
  and dead time 3.2 s does in its PI loop (noise of 0.02, seed 9), for configs/process_delay.yaml.
- rotor_mass.mtx, rotor_stiffness.mtx, rotor_gyroscopic.mtx: an overhung disc on a shaft, for
  configs/rotor.yaml.
- eq25_mass.mtx, eq25_damping.mtx, eq25_stiffness.mtx: the reduced beam of Yang (1997), eq 25, with the
  misprinted (2,3) entry of the stiffness (-11.0029, which makes it indefinite) as -1.0029.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.io import mmwrite, wavfile
from scipy.linalg import expm

import dynid
from dynid.result import Result
from dynid.store import write_result

HERE = Path(__file__).parent
MASS = [[0.0569, -0.0228, 0.0931], [-0.0228, 0.6041, -0.6186], [0.0931, -0.6186, 1.1973]]
STIFFNESS = [[0.2425, -0.2275, 0.2017], [-0.2275, 0.7355, -1.0029], [0.2017, -1.0029, 1.5588]]


def record() -> None:
    """Write the noisy record of the suspension."""
    run = dynid.run(HERE.parent / "configs" / "suspension_noisy.yaml")
    result = Result("record", "Suspension, velocities of DOFs 2 and 3, 5 % noise")
    measurement = "identification/measurement"
    result.add_axis("time", run[f"{measurement}/time"].data, "s")
    result.add_axis("channel", run[f"{measurement}/channel"].data)
    result.add("measured", run[f"{measurement}/measured"].data, ("time", "channel"), "m/s")
    result.add("force", run[f"{measurement}/input"].data[:, 0], ("time",), "N")
    write_result(result, HERE / "suspension_noisy.h5")


def raw() -> None:
    """Write a record as a sensor gives it: sampled too fast, on a drifting zero, with noise (seed 7)."""
    scene = dynid.load_scene(
        HERE.parent / "configs" / "suspension_noisy.yaml",
        ["measurement.step=0.0005", "measurement.samples=6400", "measurement.simulate.seed=7"],
    )
    run = dynid.run(scene)
    measurement = "identification/measurement"
    time = run[f"{measurement}/time"].data
    drift = np.column_stack([0.4 + 0.1 * time, -0.2 + 0.3 * time])
    result = Result("record", "Suspension, velocities of DOFs 2 and 3 as sensors give them")
    result.add_axis("time", time, "s")
    result.add_axis("channel", run[f"{measurement}/channel"].data)
    result.add("measured", (run[f"{measurement}/measured"].data + drift).round(6), ("time", "channel"), "m/s")
    write_result(result, HERE / "suspension_raw.h5")


MACHINE = """
dynid: 1
kind: identification
structure:
  lumped: {masses: [60, 25, 40], links: [{dofs: [1], k: 2.0e7, c: 3000}, {dofs: [1, 3], k: 6.0e6, c: 600}]}
joints:
  mount: {dofs: [1, 2], k: {start: 3.0e6, true: 9.0e6}, c: {start: 1000, true: 700}}
  bolt: {dofs: [2, 3], k: {start: 3.0e6, true: 5.0e6}, c: {start: 1000, true: 400}}
excitation: {dof: 3, kind: impact, amplitude: 2000, duration: 0.006}
measurement:
  step: 1/1024
  samples: 512
  channels:
    - {dof: 1, quantity: acceleration}
    - {dof: 2, quantity: acceleration}
    - {dof: 3, quantity: acceleration}
  simulate: {noise_ratio: 0.03, seed: 11}
"""


def machine(text: str) -> list[np.ndarray]:
    """Return times, accelerations and the force of the struck machine."""
    with TemporaryDirectory() as folder:
        scene = Path(folder) / "machine.yaml"
        scene.write_text(text)
        run = dynid.run(scene)
    return [run[f"identification/measurement/{name}"].data for name in ("time", "measured", "input")]


def recorders() -> None:
    """Write a record as arrays and as WAV files."""
    time, a, force = machine(MACHINE.replace("seed: 11", "seed: 12"))
    np.savez_compressed(HERE / "machine_hammer.npz", time=time, force=force[:, 0], acc_3=a[:, 2] / 9.80665)
    for name, values in (("mount", a[:, 0]), ("rail", a[:, 1])):
        counts = np.round(values / (50 * 9.80665) * 2**15).astype(np.int16)
        wavfile.write(HERE / f"machine_{name}.wav", 1024, counts)


def clocks() -> None:
    """Write a record of two recorders, of other rates, starts and clocks."""
    text = MACHINE.replace("seed: 11", "seed: 13").replace("samples: 512", "samples: 1024")
    text = text.replace("noise_ratio: 0.03", "noise_ratio: 0.01")
    noise = "kind: random, amplitude: 200, seed: 2, band: [10, 2000]"
    text = text.replace("kind: impact, amplitude: 2000, duration: 0.006", noise)
    clock = "clock: {step: 0.001, start: 0.25, samples: 700, drift: 4.0e-5}"
    text = text.replace("dof: 2, quantity: acceleration", f"dof: 2, quantity: acceleration, {clock}")
    time, a, force = machine(text)
    arrays = {"force": force[:, 0], "acc_1": a[:, 0] / 9.80665, "acc_3": a[:, 2] / 9.80665}
    arrays = {name: values.astype(np.float32) for name, values in arrays.items()}
    np.savez_compressed(HERE / "machine_daq.npz", time=time, **arrays)
    rows = [f"{k / 1000:.3f},{acc:.5f}" for k, acc in enumerate(a[:700, 1] / 9.80665)]
    (HERE / "machine_handheld.csv").write_text("\n".join(["t,acc 2 [g]", *rows, ""]))


def logger() -> None:
    """Write a record as a data logger does."""
    time, a, force = machine(MACHINE)
    rows = ["Time (s);Force [kN];acc 1+Z [g];acc 2-Z [g];acc 3+Z [g]"]
    for t, newton, (a1, a2, a3) in zip(time, force[:, 0], a / 9.80665, strict=True):
        rows.append(f"{t:.6f};{newton / 1e3:.6f};{a1:.6f};{-a2:.6f};{a3:.6f}")
    (HERE / "machine_logger.csv").write_text("\n".join([*rows, ""]))


def chain_matrices() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return mass, damping and stiffness of the chain of configs/chain_from_modes.yaml."""
    C, K = np.zeros((2, 5, 5))
    links = [((0,), 2e4, 6), ((0, 1), 3e4, 9), ((1, 2), 1.5e4, 12), ((2, 3), 2.5e4, 0), ((3, 4), 2e4, 6)]
    for ends, stiffness, damping in links:
        v = np.zeros(5)
        v[ends[-1]], v[ends[0]] = 1, -1 if len(ends) > 1 else 1
        K += stiffness * np.outer(v, v)
        C += damping * np.outer(v, v)
    return np.diag([2, 2, 1.5, 1, 1]), C, K


def chain() -> None:
    """Write accelerances of the chain, and the modes of these."""
    omega = 2 * np.pi * np.linspace(2, 45, 216)
    M, C, K = chain_matrices()
    force = np.eye(5)[:, 4]
    H = np.array([-(w**2) * np.linalg.solve(K + 1j * w * C - w**2 * M, force)[[0, 2, 4]] for w in omega])
    random = np.random.default_rng(3)
    H *= 1 + 0.02 * (random.standard_normal(H.shape) + 1j * random.standard_normal(H.shape)) / np.sqrt(2)
    heads = "f,H15_re,H15_im,H35_re,H35_im,H55_re,H55_im"
    table = np.column_stack([omega / (2 * np.pi), H.view(float)])
    np.savetxt(HERE / "chain_frf.csv", table, delimiter=",", header=heads, comments="", fmt="%.6g")
    write_result(dynid.run(HERE.parent / "configs" / "chain_frf_modes.yaml"), HERE / "chain_modal.h5")


def ambient() -> None:
    """Write accelerations of the chain under white forces held in each step and a machine at 20 Hz, in g."""
    M, C, K = chain_matrices()
    step, samples, settle = 0.01, 11000, 1000
    A = np.block([[np.zeros((5, 5)), np.eye(5)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    B = np.vstack([np.zeros((5, 5)), np.linalg.inv(M)])
    joint = expm(step * np.block([[A, B], [np.zeros((5, 15))]]))
    random = np.random.default_rng(5)
    forces = 20 * random.standard_normal((settle + samples, 5))
    state, values = np.zeros(10), np.zeros((settle + samples, 5))
    for k, force in enumerate(forces):
        values[k] = A[5:] @ state + B[5:] @ force
        state = joint[:10] @ np.concatenate([state, force])
    values = values[settle:, [0, 2, 4]]
    values += 12 * np.sin(2 * np.pi * 20 * step * np.arange(samples))[:, None] * [1, 2, 1.5]
    values += 0.05 * values.std(axis=0) * random.standard_normal(values.shape)
    a1, a3, a5 = (values / 9.80665).astype(np.float32).T
    np.savez_compressed(HERE / "chain_ambient.npz", a1=a1, a3=a3, a5=a5)


def process() -> None:
    """Write a record of a process with dead time in its loop: T y' + y = K u(t - L), u = kp e + ki ∫ e."""
    rng, (K, T, L), (kp, ki) = np.random.default_rng(9), (2.0, 10.0, 3.2), (0.8, 0.08)
    wanted = np.repeat(rng.integers(-2, 3, 12), 20).astype(float)
    wanted[:20] = 1
    step, fine = 0.5, 1000  # steps of Heun's method in each of the record; the delay is a multiple of them
    h, late = step / fine, round(L * fine / step)
    y = integral = 0.0
    answers, outputs = np.zeros(len(wanted) * fine + late), []
    for k in range(len(wanted) * fine):
        if k % fine == 0:
            outputs.append(y)
        w = wanted[k // fine]
        answers[k + late] = kp * (w - y) + ki * integral
        rate = (K * answers[k] - y) / T
        end = y + h * rate
        moved = y + h / 2 * (rate + (K * answers[k + 1] - end) / T)
        integral += h * (w - (y + moved) / 2)
        y = moved
    measured = np.array(outputs) + 0.02 * rng.standard_normal(len(wanted))
    table = np.column_stack([step * np.arange(len(wanted)), wanted, measured])
    head = "time (s),wanted,measured"
    np.savetxt(HERE / "process_delay.csv", table, delimiter=",", header=head, comments="", fmt="%.6g")


def matrices() -> None:
    """Write eq 25."""
    mass, stiffness = np.array(MASS), 1e4 * np.array(STIFFNESS)
    damping = 0.1 * mass
    for name, matrix, unit in (
        ("mass", mass, "kg"),
        ("damping", damping, "N s/m"),
        ("stiffness", stiffness, "N/m"),
    ):
        comment = f"Yang (1997), eq 25: {name}, {unit}; DOFs theta_1, w_4, w_6"
        target = HERE / f"eq25_{name}.mtx"
        mmwrite(target, matrix.round(12), comment=comment, symmetry="symmetric", precision=15)


def rotor() -> None:
    """Write an overhung disc on a shaft that is clamped at its drive, with a bearing beside the disc."""
    EI = 2.0e4

    def bend(a: float) -> np.ndarray:
        rows = [[12, 6 * a, -12, 6 * a], [6 * a, 4 * a**2, -6 * a, 2 * a**2]]
        rows += [[-12, -6 * a, 12, -6 * a], [6 * a, 2 * a**2, -6 * a, 4 * a**2]]
        return EI / a**3 * np.array(rows)

    plane = bend(0.2)  # displacement and slope of the bearing, of the disc
    plane[:2, :2] += bend(0.6)[2:, 2:]
    kept, slope = [2, 3, 0], 1  # the slope at the bearing has no inertia: it is condensed
    plane = plane[np.ix_(kept, kept)] - np.outer(plane[kept, slope], plane[slope, kept]) / plane[slope, slope]
    M, G, K = np.diag([12, 12, 0.06, 0.06, 1, 1]), np.zeros((6, 6)), np.zeros((6, 6))
    G[2, 3], G[3, 2] = 0.11, -0.11
    for places, signs in (([0, 3, 4], [1, 1, 1]), ([1, 2, 5], [1, -1, 1])):  # dx/dz = ry, dy/dz = -rx
        K[np.ix_(places, places)] = plane * np.outer(signs, signs)
    comment = "rotor with a disc; DOFs 1:x, 1:y, 1:rx, 1:ry, 2:x, 2:y"
    for name, matrix in (("mass", M), ("stiffness", K), ("gyroscopic", G)):
        mmwrite(HERE / f"rotor_{name}.mtx", matrix.round(9), comment=comment, precision=15)


if __name__ == "__main__":
    record()
    raw()
    logger()
    recorders()
    clocks()
    matrices()
    chain()
    ambient()
    process()
    rotor()
