"""The suspension of five masses, and shorthand for identifying it."""

import numpy as np

from dynid.identification.identify import identify
from dynid.identification.records.measurement import Experiment, Measurement, Simulation
from dynid.identification.systems.record_values import data
from dynid.lti.signals import Multisine
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.ports import Channel, Load

LOADS = (Load(5, Multisine([100] * 3, [70, 110, 250])),)
VELOCITIES = (Channel(2, "velocity"), Channel(3, "velocity"))
LINKS = (Link((1,), 2e4, 20), Link((1, 2), 3e4, 30), Link((4, 5), 2e4, 20))
MASSES = (2, 2, 1.5, 1, 1)


def unknown(true, factor=0.5):
    return JointParameter(start=factor * true, true=true)


def suspension(factor=0.5, links=LINKS):
    """Five masses; joints 2–3 and 3–4 unknown, started at `factor` times their true values."""
    joints = [
        Joint(name, dofs, unknown(2e4, factor), unknown(20.0, factor))
        for name, dofs in (("j2", (2, 3)), ("j3", (3, 4)))
    ]
    return lumped(MASSES, links, joints)


def simulated(noise_ratio=0.0, seed=1, settle=10.0, samples=800, channels=VELOCITIES):
    return Measurement(0.002, samples, channels, Simulation(noise_ratio, seed, settle))


def recorded(noise_ratio=0.0, seed=1, **options):
    """Return the values of a simulated record of the suspension (times x channels)."""
    return data(suspension(), LOADS, simulated(noise_ratio, seed, **options)).values


def run(model=None, measurement=None, loads=LOADS, **options):
    return identify(model or suspension(), Experiment(loads, measurement or simulated()), **options)


def parameter(result, name):
    return np.asarray(result.value(f"identification/parameters/{name}"))


def diagnostic(result, name):
    return result.value(f"identification/diagnostics/{name}")


def in_bounds(result):
    """Errors in units of the Cramér–Rao bound."""
    return (parameter(result, "estimate") - parameter(result, "true")) / parameter(result, "cramer_rao")
