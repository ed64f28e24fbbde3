"""Times at which a driven system is propagated: requested times, breakpoints and substeps, merged."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array
from dynid.errors import UsageError
from dynid.lti.generator import Signal

Indices = NDArray[np.int64]

# Most substeps of a signal: seconds for a response, minutes for a filter.
_MAX_SUBSTEPS = 1_000_000
# Most numbers in the table of generator states (800 MB with temporaries).
_MAX_GENERATOR_NUMBERS = 50_000_000


@dataclass(frozen=True, eq=False)
class Timeline:
    """Intervals between nodes, in each of which all signals follow one joint generator."""

    nodes: Array  # times (intervals + 1), s, ascending
    lengths: Array  # the distinct interval lengths, s
    which: Indices  # for each interval the index of its length
    wanted: Indices  # nodes of the requested times
    #: Joint generator ``w' = G w``, ``u = H w`` (states x states, inputs x states).
    G: Array
    H: Array
    W: Array  # generator states at the beginning of each interval and at the end (nodes x states)
    jumps: Array  # Dirac strengths (inputs) at t = 0
    jump_node: int  # the node at t = 0 if an impulse acts there, else -1

    def sample_of(self) -> Indices:
        """Return the index of every node among the requested times, or -1 (nodes)."""
        out = np.full(len(self.nodes), -1, dtype=np.int64)
        out[self.wanted] = np.arange(len(self.wanted))
        return out

    def inputs(self, order: int = 0) -> Array:
        """Return the `order`-th derivative of the inputs at the requested times (times x inputs)."""
        readout = self.H @ np.linalg.matrix_power(self.G, order)
        return np.asarray(self.W[self.wanted] @ readout.T)


def timeline(signals: Sequence[Signal], times: Array, start: float) -> Timeline:
    """Merge the requested times with the breakpoints and substeps of the signals, one per input.

    Propagation begins at `start`, s, at or before the first requested time. `UsageError` if the times do not
    increase, or a signal is too fast for their span.
    """
    if times.ndim != 1 or len(times) == 0 or not np.all(np.isfinite(times)):
        raise UsageError("the times of a response must be a list of finite numbers")
    if np.any(np.diff(times) <= 0):
        raise UsageError("the times of a response must increase")
    if not start <= times[0]:
        raise UsageError(f"a response cannot start at {start:g} s, after its first time {times[0]:g} s")
    jumps = np.array([signal.jump for signal in signals], dtype=float)
    nodes = _nodes(signals, times, start, bool(np.any(jumps)))
    gaps = np.diff(nodes)
    lengths, which = np.empty(0), np.empty(len(gaps), dtype=np.int64)
    if len(gaps):  # lengths that are equal to rounding are one, their mean
        order = np.argsort(gaps)
        new_group = np.diff(gaps[order]) > 8 * np.finfo(float).eps * float(np.max(np.abs(nodes)))
        which[order] = np.concatenate([[0], np.cumsum(new_group)])
        lengths = np.bincount(which, weights=gaps) / np.bincount(which)
    generators = [signal.generator() for signal in signals]
    size = sum(len(block) for block, _ in generators)
    G, H = np.zeros((size, size)), np.zeros((len(generators), size))
    first = 0
    for row, (block, readout) in enumerate(generators):
        here = slice(first, first + len(block))
        G[here, here] = block
        H[row, here] = readout
        first += len(block)
    if len(nodes) * len(G) > _MAX_GENERATOR_NUMBERS:
        largest = max(signals, key=lambda signal: len(signal.generator()[1]))
        raise UsageError(
            f"{len(nodes):,} times are too many for signals of {len(G)} generator states",
            remedy="Ask for fewer times, or for a signal of fewer sines.",
            names=[largest.kind, largest.pace],
        )
    middles = np.append((nodes[:-1] + nodes[1:]) / 2, nodes[-1])
    W = np.concatenate([np.empty((len(nodes), 0)), *(s.states(nodes, middles) for s in signals)], axis=1)
    zero = np.flatnonzero(nodes == 0.0) if np.any(jumps) else np.empty(0, dtype=np.int64)
    jump_node = int(zero[0]) if len(zero) else -1
    return Timeline(nodes, lengths, which, np.searchsorted(nodes, times), G, H, W, jumps, jump_node)


def _nodes(signals: Sequence[Signal], times: Array, start: float, impulse: bool) -> Array:
    """Return requested times, start, breakpoints (snapped to requested times within rounding), substeps."""
    base = times if start == times[0] else np.concatenate([[start], times])
    breaks = [signal.breakpoints(float(base[0]), float(base[-1])) for signal in signals]
    extra = np.unique(np.concatenate([np.empty(0), *breaks, *([[0.0]] if impulse else [])]))
    extra = extra[(extra > base[0]) & (extra < base[-1])]
    spacing = float(np.min(np.diff(base), initial=math.inf))
    right = np.clip(np.searchsorted(base, extra), 1, max(1, len(base) - 1))
    right = np.minimum(right, len(base) - 1)
    left = np.maximum(right - 1, 0)
    nearest = base[np.where(np.abs(extra - base[left]) <= np.abs(base[right] - extra), left, right)]
    tolerance = 1e-9 * spacing if math.isfinite(spacing) else 0.0
    nodes = np.union1d(base, extra[np.abs(extra - nearest) > tolerance])
    if not signals:
        return nodes
    fastest = min(signals, key=lambda signal: signal.longest_step)
    return _subdivided(nodes, fastest)


def _subdivided(nodes: Array, fastest: Signal) -> Array:
    """Return the nodes with every interval longer than the fastest signal allows cut into equal parts."""
    gaps, longest = np.diff(nodes), fastest.longest_step
    if not len(gaps) or gaps.max() <= longest:
        return nodes
    with np.errstate(over="ignore", divide="ignore"):
        parts = np.maximum(1.0, np.ceil(gaps / longest * (1 - 1e-12)))
    if not parts.sum() - len(parts) <= _MAX_SUBSTEPS:
        raise UsageError(
            f"the {fastest.kind} is too fast for its duration: it takes {parts.sum():.2g} substeps of "
            f"{longest:.2g} s; at most {_MAX_SUBSTEPS:,} are allowed",
            remedy="Shorten the time, or lower the frequencies.",
            names=(fastest.kind, fastest.pace),
        )
    repeats = parts.astype(int)
    first = np.repeat(np.cumsum(repeats) - repeats, repeats)
    fraction = (np.arange(repeats.sum()) - first) / np.repeat(repeats, repeats)
    inner = np.repeat(nodes[:-1], repeats) + fraction * np.repeat(gaps, repeats)
    return np.append(inner, nodes[-1])
