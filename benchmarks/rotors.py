"""Modes and responses of a rotor of ROSS against dynid's, with the matrices of ROSS.

    PYTHONPATH=src python -m benchmarks.rotors [SPEED]

in an environment with ross-rotordynamics (2.3.0 needs plotly below 6) prints the largest relative differences
of the elastic frequencies of `ross.rotor_example()`, and of responses to a force at its third node whose
frequency is the speed.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

from dynid.structure.model import Rotor, StructuralModel
from dynid.structure.ports import Channel
from dynid.structure.response import frequency_response
from dynid.structure.rotors import whirl_modes

_DIRECTIONS = ("x", "y", "z", "rx", "ry", "rz")
_OUTPUTS = ("3:x", "3:y", "5:ry")
_RESPONSE = "structure/frequency_response/response"


def main(speed: float) -> None:
    """Print the differences at a speed of rotation (rad/s)."""
    import ross  # type: ignore[import-not-found,unused-ignore]

    peer: Any = ross.rotor_example()
    n = peer.ndof
    dofs = [f"{node + 1}:{direction}" for node in range(n // 6) for direction in _DIRECTIONS]
    G, N = np.asarray(peer.G()), np.zeros((n, n))
    plain = StructuralModel(peer.M(), peer.C(speed), peer.K(speed), dofs=tuple(dofs))
    poles = whirl_modes(plain.rotating(Rotor(G, N, speed))).poles
    elastic = np.asarray(peer.run_modal(speed, num_modes=12).wn)
    nearest = np.array([np.min(np.abs(np.abs(poles) / omega - 1)) for omega in elastic])
    lines = np.linspace(10.0, 600.0, 30)
    exact = peer.run_freq_response(speed_range=lines).freq_resp[[dofs.index(dof) for dof in _OUTPUTS]]
    outputs = [Channel(dof, "displacement") for dof in _OUTPUTS]
    responses = np.array(
        [
            frequency_response(plain.rotating(Rotor(G, N, w)), ["3:x"], outputs, [w])[_RESPONSE].data[0, :, 0]
            for w in lines.tolist()
        ]
    )
    difference = np.abs(responses - exact[:, dofs.index("3:x")].T).max() / np.abs(exact).max()
    print(
        f"{len(elastic)} frequencies: {nearest.max():.1e}; responses at {len(lines)} lines: {difference:.1e}"
    )


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 300.0)
