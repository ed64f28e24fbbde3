"""Characteristics of channels that engineers ask for: of the step response, and bandwidth and resonance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields

from dynid.bondgraph.exact_engine import exact_channels
from dynid.bondgraph.reduced_graph import Channel, ReducedGraph
from dynid.lti.margins import Bandwidth, bandwidth
from dynid.lti.step_info import StepInfo, step_info
from dynid.progress import tracked
from dynid.result import Result

#: Units of what has not that of the channel's gain.
_UNITS = (
    dict.fromkeys(("bandwidth", "peak_frequency", "half_power_low", "half_power_high"), "rad/s")
    | dict.fromkeys(("rise_time", "settling_time", "transient_time", "peak_time"), "s")
    | dict.fromkeys(("overshoot", "undershoot"), "%")
)

#: The name of the status of each of them, which says why one is not defined.
STATUSES = {
    field.name: status
    for kind, status in ((StepInfo, "step_status"), (Bandwidth, "bandwidth_status"))
    for field in fields(kind)
    if field.name != "status"
}
#: The names of all of them, and of their statuses.
CHARACTERISTICS = frozenset({*STATUSES, *STATUSES.values()})


def add_characteristics(
    result: Result,
    reduced: ReducedGraph,
    asked: frozenset[str],
    steps: Mapping[Channel, StepInfo] | None = None,
    bandwidths: Mapping[Channel, Bandwidth] | None = None,
) -> None:
    """Add `step_info` and `bandwidth`, as requested, of every channel from its exact transfer function.

    `steps`, `bandwidths`: the characteristics where the channels have delays, or loops are sampled.

    What is not defined is left out, and `step_status` or `bandwidth_status` names the reason; the names of
    which it is the status are its attribute `status_of`.
    """
    transfers = exact_channels(reduced) if steps is None and bandwidths is None else {}
    for channel in tracked(list(reduced.channels()), "characteristics of channel"):
        group = f"bond_graph/properties/{channel[0]}/{channel[1]}"
        characteristics: list[tuple[str, StepInfo | Bandwidth]] = []
        if "step_info" in asked:
            if steps is None:
                exact = transfers[channel]
                characteristics.append(("step_status", step_info(exact.numerator, exact.denominator)))
            else:
                characteristics.append(("step_status", steps[channel]))
        if "bandwidth" in asked:
            if bandwidths is None:
                exact = transfers[channel]
                characteristics.append(("bandwidth_status", bandwidth(exact.numerator, exact.denominator)))
            else:
                characteristics.append(("bandwidth_status", bandwidths[channel]))
        for status, values in characteristics:
            names = [name for name, its_status in STATUSES.items() if its_status == status]
            result.add(f"{group}/{status}", values.status, status_of=" ".join(names))
            for name in names:
                value = getattr(values, name)
                if value is not None:
                    gain = reduced.units.of_channel(*channel)
                    result.add(f"{group}/{name}", value, units=_UNITS.get(name, gain))
