"""Forces of nonlinear joints at the motion of a linear fit, and the linear responses of a record to them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from dynid.arrays import Array, finite
from dynid.lti.exponential import exponential
from dynid.lti.recurrence import recurrence
from dynid.parameters import named
from dynid.progress import report_progress

if TYPE_CHECKING:
    from dynid.identification.likelihood.record_likelihood import RecordFit
    from dynid.identification.likelihood.time_record import TimeRecord
    from dynid.identification.systems.parametric_model import ParametricModel
    from dynid.identification.systems.structure_system import JointPorts

#: The forces, of relative displacement d and velocity v.
TERMS = ("d|d|", "d2", "|d|v", "dv", "d3", "|v|v")
# Displacements at which sliders slip, as parts of the largest one: others share most of their response.
_SLIPS = (0.125, 0.5)
#: Number of forces of a joint.
FORCES = len(TERMS) + len(_SLIPS)
# Most numbers of the responses of a block of channels: 96 MB.
_MAX_HELD_NUMBERS = 12_000_000
# Numbers of the states of the responses after which these are carried on: they do not fill the memory.
_MAX_RESPONSE_NUMBERS = 400_000
# Most samples of which products are taken at once.
_MAX_BLOCK_SAMPLES = 256


def motions_of(model: ParametricModel, fit: RecordFit, joints: JointPorts) -> Array:
    """Return relative displacements and velocities of the joints (2 x times x joints)."""
    states = fit.predicted.states * model.scale
    n = joints.motions.shape[1]
    return np.stack([states[:, :n] @ joints.motions.T, states[:, n:] @ joints.motions.T])


def forces_of(motions: Array) -> Array:
    """Return the forces (times x joints x terms and sliders) at motions (2 x times x joints), over units."""
    d, v = motions
    terms = [d * np.abs(d), d * d, np.abs(d) * v, d * v, d**3, np.abs(v) * v]
    return np.stack([*terms, *(_slider(d, slip) for slip in _SLIPS)], axis=-1)


def _slider(d: Array, slip: float) -> Array:
    """Return the elastic part (times x joints), at most `slip`, of displacements from 0 on.

    A step adds to it and clips; so do two steps one after the other, and spans of steps that double.
    """
    added, low, high = np.diff(d, axis=0, prepend=0.0), np.full_like(d, -slip), np.full_like(d, slip)
    span = 1
    while span < len(d):
        limits = low[span:], high[span:]
        clipped = [np.clip(limit[:-span] + added[span:], *limits) for limit in (low, high)]
        low[span:], high[span:] = clipped
        added[span:] += added[:-span].copy()
        span *= 2
    return np.clip(added, low, high)


@dataclass(frozen=True, eq=False)
class JointResponses:
    """Linear responses of a record to forces at joints (times x joints x forces)."""

    record: TimeRecord
    fit: RecordFit
    joints: JointPorts
    forces: Array
    _held: dict[int, Array] = field(default_factory=dict)

    @property
    def count(self) -> int:
        """Number of responses of a channel."""
        return int(self.forces[0].size)

    def of_channel(self, channel: int) -> Array:
        """Return the responses of a channel (times x any); those of a block of channels are held."""
        count, held = len(self.record.data.rms), self._held
        blocks = min(count, -(-count * self.forces.size // _MAX_HELD_NUMBERS))
        width = -(-count // blocks)
        number = channel // width
        if number not in held:
            held.clear()  # first: two blocks would take twice the memory
            channels = slice(number * width, (number + 1) * width)
            responses = _responses(self.record, self.fit, self.joints, self.forces, channels)
            finite("the responses to forces at the joints", responses)  # of predictions that grow
            held[number] = responses.reshape(len(responses), len(self.forces), -1)
        return np.asarray(held[number][channel % width])

    def products(self, columns: Array) -> tuple[Array, Array]:
        """Return products of derivatives by parameters, responses and residuals (w), in blocks of samples.

        With each other (channels x w x w), and with columns that all channels share (times x any: any x
        channels x w). Channels record at the times of the model.
        """
        record, fit = self.record, self.fit
        by_parameter = record.prediction_from(
            fit.eta, fit.predicted.start, record.model, by_state=False
        ).by_parameter
        _, channels, p = by_parameter.shape
        own = np.empty((_MAX_BLOCK_SAMPLES, channels, p + self.count + 1))
        gram = np.zeros((channels, own.shape[2], own.shape[2]))
        across = np.zeros((columns.shape[1], own[0].size))

        def add(first: int, last: int) -> None:
            part = own[: last - first]
            finite("the responses to forces at the joints", part)  # of predictions that grow
            for c in range(channels):
                gram[c] += part[:, c].T @ part[:, c]
            across[:] += columns[first:last].T @ part.reshape(len(part), -1)

        begun = 0
        for rows, responses in _response_blocks(record, fit, self.joints, self.forces, slice(None)):
            if rows.stop - begun > _MAX_BLOCK_SAMPLES:
                report_progress(f"score test, {rows.start} of {len(self.forces)} samples")
                add(begun, rows.start)
                begun = rows.start
            part = own[rows.start - begun : rows.stop - begun]
            part[..., :p], part[..., -1] = by_parameter[rows], fit.residual[rows]
            part[..., p:-1] = responses.reshape(channels, len(part), -1).swapaxes(0, 1)
        add(begun, len(self.forces))
        return gram, across.reshape(len(across), channels, -1)


def _responses(
    record: TimeRecord, fit: RecordFit, joints: JointPorts, forces: Array, channels: slice
) -> Array:
    """Return the linear responses of channels from rest (channels x times x joints x forces)."""
    model, h = record.model.moved(fit.eta), record.sampling_step
    delays = model.instruments.numbers(model.instruments.delays, named(record.unknowns, fit.eta)).value[
        channels
    ]
    responses = np.empty((len(delays), *forces.shape))
    for rows, block in _response_blocks(record, fit, joints, forces, channels):
        responses[:, rows] = block
    for c in np.flatnonzero(delays):  # between samples
        times = h * np.arange(len(forces))
        late = [
            np.interp(times - delays[c], times, column) for column in responses[c].reshape(len(forces), -1).T
        ]
        responses[c] = np.transpose(late).reshape(responses[c].shape)
    return responses


def _response_blocks(
    record: TimeRecord, fit: RecordFit, joints: JointPorts, forces: Array, channels: slice
) -> Iterator[tuple[slice, Array]]:
    """Yield samples with the responses of channels there, without delays (channels x … x joints x forces)."""
    model = record.model.moved(fit.eta)
    matrices, n, count = model.at(fit.eta), model.states, len(joints.names)
    # Forces are linear between samples: x' = A x + B (f + g t), f and g being states.
    B = joints.B / model.scale[:, None]
    h = record.sampling_step
    joint = np.zeros((n + 2 * count, n + 2 * count))
    joint[:n, :n], joint[:n, n : n + count] = matrices.A, B
    joint[n : n + count, n + count :] = np.eye(count) / h
    step = exponential(joint, h)
    Phi, held, ramp = step[:n, :n], step[:n, n : n + count], step[:n, n + count :]
    gains = model.instruments.numbers(model.instruments.gains, named(record.unknowns, fit.eta)).value
    # The state less what the last ramp gave to it: Phi y + (held - ramp + Phi ramp) f.
    C, forced = matrices.C[channels], held - ramp + Phi @ ramp
    direct = (gains[:, None] * joints.direct)[channels] + C @ ramp

    def outputs(states: Array, first: int, last: int) -> tuple[slice, Array]:
        responses = direct[:, None, :, None] * forces[first:last]
        responses += (C @ states.reshape(-1, n).T).reshape(responses.shape)
        return slice(first, last), responses

    state = -(forces[0, ..., None] * ramp.T[:, None]).reshape(-1, n)
    yield outputs(state, 0, 1)
    longest = min(_MAX_BLOCK_SAMPLES, max(1, _MAX_RESPONSE_NUMBERS // (n * count * FORCES)))
    for first in range(0, len(forces) - 1, longest):
        last = min(first + longest, len(forces) - 1)
        forcing = forces[first:last, ..., None] * forced.T[:, None]
        states = recurrence(Phi, forcing.reshape(last - first, -1, n), state)
        yield outputs(states, first + 1, last + 1)
        state = states[-1]
