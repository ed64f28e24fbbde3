"""What is fixed to a structure: links, joints, forces, sensors and masters, each at its DOFs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from dynid.report.numbers import short

Label = int | str


@dataclass(frozen=True)
class Fastening:
    """A spring, a damper, or both, between DOFs or from one to ground.

    Parameters
    ----------
    dofs
        The labels of its DOFs.
    texts
        What is written at it.
    stiff, damped
        Whether it has a spring, a damper.
    joint
        Whether it is a joint, which is highlighted.
    """

    dofs: tuple[Label, ...]
    texts: tuple[str, ...]
    stiff: bool
    damped: bool
    joint: bool


@dataclass(frozen=True)
class Mounted:
    """All that is fixed to a structure; forces, sensors and masters by the labels of their DOFs."""

    fastenings: tuple[Fastening, ...]
    forces: tuple[Label, ...]
    sensors: tuple[tuple[Label, str], ...]
    masters: tuple[Label, ...]


def mounted_on(model: Any) -> Mounted:
    """Read what a scene of a structure fixes to it."""
    labels = model.structure.labels()

    def named(dof: Label) -> Label:
        return labels[dof - 1] if isinstance(dof, int) and 0 < dof <= len(labels) else dof

    fastenings = [*_links(model.structure), *_joints(model.joints)]
    placed = tuple(
        Fastening(tuple(map(named, f.dofs)), f.texts, f.stiff, f.damped, f.joint) for f in fastenings
    )
    signals = getattr(model, "excitation", None) or []
    driven = [signal.dof for signal in signals if getattr(signal, "dof", None) is not None]
    driven += getattr(model, "inputs", None) or []
    masters: dict[Label, None] = {}
    reductions = getattr(model, "reduction", None) or []
    for reduction in reductions if isinstance(reductions, Sequence) else [reductions]:
        given = getattr(reduction, "masters", None)
        masters |= dict.fromkeys(map(named, given)) if isinstance(given, list) else {}
    return Mounted(
        placed,
        tuple(dict.fromkeys(map(named, driven))),
        tuple(dict.fromkeys((named(dof), letter) for dof, letter in _sensors(model))),
        tuple(masters),
    )


def _sensors(model: Any) -> Iterator[tuple[Label, str]]:
    measurement = getattr(model, "measurement", None)
    channels = measurement.sensors if measurement else []
    outputs = getattr(model, "outputs", None) or []
    for channel in [*channels, *outputs]:
        for dof in channel.ends:
            yield dof, channel.quantity


def _links(structure: Any) -> Iterator[Fastening]:
    for link in structure.lumped.links if structure.lumped else ():
        yield _fastening(link, "", False)
    for part in (structure.beam, structure.frame):
        for item in part.springs if part else ():
            dof = f"{item.direction}_{item.node}"
            yield Fastening((dof,), _texts(item), item.k is not None, item.c is not None, False)


def _joints(joints: Any) -> Iterator[Fastening]:
    for name, joint in joints.items():
        yield _fastening(joint, name, True)


def _fastening(link: Any, name: str, joint: bool) -> Fastening:
    texts = (name, *_texts(link)) if name else _texts(link)
    return Fastening(tuple(link.dofs), texts, link.k is not None, link.c is not None, joint)


def _texts(link: Any) -> tuple[str, ...]:
    texts = []
    for letter in "kc":
        given = getattr(link, letter)
        value = getattr(given, "value", given) if hasattr(given, "start") else given
        if given is not None:
            unknown = getattr(given, "start", None) is not None
            known = None if value is None or unknown else float(value)
            texts.append(
                f"{letter} = ?" if unknown else letter if known is None else f"{letter} = {short(known)}"
            )
    return tuple(texts)
