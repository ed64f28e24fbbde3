"""Ten structures of different kinds, each with its excitation and sensors, for statistics of verdicts."""

from typing import NamedTuple

import numpy as np

from dynid.identification.records.measurement import Measurement, Simulation
from dynid.lti.noise import WhiteNoise
from dynid.lti.signals import Chirp, Impact, Multisine, Sine, Step
from dynid.structure.assembly import Support
from dynid.structure.damping import ProportionalDamping
from dynid.structure.frame import Member, beam, frame
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.model import StructuralModel
from dynid.structure.ports import Channel, Load


class Rig(NamedTuple):
    """A structure under test: model, loads, channels, sampling and settling."""

    model: StructuralModel
    loads: list[Load]
    channels: tuple[Channel, ...]
    step: float
    samples: int
    settle: float = 0.0

    def simulated(self, noise_ratio, seed):
        """Return a record of it with noise."""
        return Measurement(self.step, self.samples, self.channels, Simulation(noise_ratio, seed, self.settle))

    def measured(self, values, noise=None):
        """Return a record of these values."""
        return Measurement(self.step, self.samples, self.channels, values, noise)

    def noise(self, seed):
        """Return a record of nothing but noise."""
        values = np.random.default_rng(seed).standard_normal((self.samples, len(self.channels)))
        return values


def unknown(true, factor=0.6):
    """Return a parameter that starts off its true value."""
    return JointParameter(start=factor * true, true=true)


def suspension(masses=(2, 2, 1.5, 1, 1), *, damped=True):
    """Return five masses in a row with two joints."""
    links = (Link((1,), 2e4, 20), Link((1, 2), 3e4, 30), Link((4, 5), 2e4, 20))
    joints = [
        Joint(name, dofs, unknown(2e4), unknown(20.0) if damped else None)
        for name, dofs in (("u", (2, 3)), ("l", (3, 4)))
    ]
    return lumped(masses, links, joints)


def pair(masses=(1.2, 0.8)):
    """Return two masses that a bolt joins."""
    return lumped(masses, [Link((1,), 1.5e4, 4)], [Joint("bolt", (1, 2), unknown(2e4), unknown(3.0))])


def chain(masses=(1.7, 1.8, 3.1, 0.9)):
    """Return four masses with an unknown foot and an unknown joint."""
    joints = [Joint("foot", (1,), unknown(8e3), 4.0), Joint("mid", (2, 3), unknown(3e3), unknown(4.0))]
    return lumped(masses, [Link((1, 2), 4e3, 8), Link((3, 4), 7e3, 8)], joints)


def single():
    """Return one mass."""
    return lumped([1.0], [], [Joint("foot", (1,), unknown(4e3), unknown(3.0))])


def supported_beam():
    """Return a beam that is pinned at one end, with an unknown support."""
    joints = [
        Joint("root", ("theta_1",), unknown(5e3), 5.0),
        Joint("foot", ("w_6",), unknown(1e4), unknown(20.0)),
    ]
    return beam(
        7,
        7.0,
        1723.3,
        0.1,
        supports=[Support(1, ("w",))],
        damping=ProportionalDamping(0.5, 2e-4),
        joints=joints,
    )


def portal():
    """Return a plane frame of three members with a soft corner."""
    corners = [(0, 0), (0, 2), (3, 2), (3, 0)]
    members = [Member(nodes, 1e6, 2e3, 2.0) for nodes in ((1, 2), (2, 3), (3, 4))]
    supports = [Support(1, ("u", "w", "theta")), Support(4, ("u", "w"))]
    joints = [Joint("corner", ("theta_4",), unknown(3e3), unknown(3.0))]
    return frame(corners, members, supports=supports, damping=ProportionalDamping(0.5, 2e-4), joints=joints)


def velocities(*dofs):
    """Return velocity channels."""
    return tuple(Channel(dof, "velocity") for dof in dofs)


def accelerations(*dofs):
    """Return acceleration channels."""
    return tuple(Channel(dof, "acceleration") for dof in dofs)


MULTISINE = Multisine([100] * 3, [70, 110, 250])


def rigs():
    """Return the ten by name."""
    random = WhiteNoise(50.0, 3, 0.002, 800)
    return {
        "suspension, sine": Rig(
            suspension(damped=False), [Load(5, Sine(100, 70))], velocities(2, 3), 0.002, 800, 10.0
        ),
        "suspension, multisine": Rig(suspension(), [Load(5, MULTISINE)], velocities(2, 3), 0.002, 800, 10.0),
        "suspension, random": Rig(suspension(), [Load(5, random)], accelerations(2, 3), 0.002, 800),
        "pair, sine": Rig(pair(), [Load(1, Sine(20, 150))], accelerations(1, 2), 0.002, 600),
        "pair, impact": Rig(pair(), [Load(1, Impact(80, 0.01))], accelerations(2), 0.002, 600),
        "chain, impact": Rig(chain(), [Load(3, Impact(150, 0.02))], velocities(1, 3), 0.005, 1000),
        "chain, random": Rig(
            chain(), [Load(4, WhiteNoise(30.0, 5, 0.005, 1000))], velocities(2), 0.005, 1000
        ),
        "single, chirp": Rig(
            single(), [Load(1, Chirp(10, 20, 150, 1.998))], (Channel(1, "displacement"),), 0.002, 1000
        ),
        "beam, sine": Rig(
            supported_beam(), [Load("w_4", Sine(50, 45))], velocities("w_4", "w_6"), 0.002, 700, 5.0
        ),
        "frame, step": Rig(portal(), [Load("u_2", Step(40))], velocities("u_2", "u_3"), 0.002, 700),
    }
