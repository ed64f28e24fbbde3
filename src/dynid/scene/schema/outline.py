"""What a scene's names stand for, and the faults that only the whole of it shows.

These checks work on the plain data, as far as they make sense, so that they find their faults in a
scene that has others as well.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from dynid.errors import Fault
from dynid.scene.arithmetic.expression import resolve_parameters
from dynid.scene.schema.accuracy import accuracy_faults
from dynid.scene.schema.graph_outline import (
    bond_graph_faults,
    domain_faults,
    driving_faults,
    engine_faults,
    initial_faults,
    node_types,
    port_faults,
    unseen_energy_faults,
)
from dynid.scene.schema.plain import mapping, written_key
from dynid.scene.schema.quantities import Names
from dynid.scene.schema.structure_outline import structure_faults, unknown_joint_faults
from dynid.scene.yaml.source import Source
from dynid.words import did_you_mean


def read_names(source: Source) -> tuple[Names, list[Fault]]:
    """Resolve the parameters and list the nodes of a scene.

    Returns
    -------
    Names, list of Fault
        The names, and what is wrong with the parameters.
    """
    raw = mapping(source.data, "parameters")
    complete = isinstance(source.data.get("parameters", {}), dict)
    values, problems = resolve_parameters({str(name): value for name, value in raw.items()})
    faults = [source.fault(("parameters", written_key(raw, name)), text) for name, text in problems.items()]
    return Names(values, frozenset(problems), node_types(source), complete), faults


def whole_faults(source: Source, names: Names) -> list[Fault]:
    """Find the faults that concern several parts of a scene at once."""
    kind = source.data.get("kind")
    if kind == "bond-graph":
        faults = [*bond_graph_faults(source), *initial_faults(source), *driving_faults(source)]
        faults += [*port_faults(source), *engine_faults(source), *domain_faults(source)]
    else:
        faults = structure_faults(source, names) if kind in ("identification", "reduction") else []
        faults += unknown_joint_faults(source) if kind == "reduction" else []
    return [*faults, *_motionless_faults(source), *accuracy_faults(source)]


def _motionless_faults(source: Source) -> list[Fault]:
    """Check that a motion from an initial state is asked for: nothing else shows it."""
    analysis = source.data.get("analysis", {})
    if not mapping(source.data, "initial") or not isinstance(analysis, dict):
        return []
    if source.data.get("kind") == "bond-graph":
        return unseen_energy_faults(source, analysis)
    if _simulates(mapping(source.data, "measurement")) or any(
        did_you_mean(str(key), ["time"]) for key in analysis
    ):
        return []
    message = "the initial state shows in a time response or a simulated record only; "
    return [source.fault(("initial",), f"{message}it needs the block 'analysis.time'", key=True)]


def _simulates(measurement: Mapping[Any, Any]) -> bool:
    """Tell whether a record is simulated: it starts with the initial motion."""
    records = measurement.get("records")
    each = [one for one in records if isinstance(one, dict)] if isinstance(records, list) else []
    return any("simulate" in record for record in (measurement, *each))
