"""What is fixed to a structure: links, joints, forces, sensors and masters, each at its DOFs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from dynid.report.drawing.shape import Label
from dynid.report.numbers import short
from dynid.report.scenes import listed, readable

if TYPE_CHECKING:
    from dynid.report.scenes import PlainScene


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


def mounted_on(scene: PlainScene, labels: Sequence[Label]) -> Mounted:
    """Read what a scene fixes to its structure.

    Parameters
    ----------
    scene
        The scene.
    labels
        The labels of the structure's DOFs, in their order.

    Raises
    ------
    UsageError
        Where the scene cannot be read.
    """

    def named(dof: Label) -> Label:
        return labels[dof - 1] if isinstance(dof, int) and 0 < dof <= len(labels) else dof

    with readable():
        data = scene.data
        driven = [signal["dof"] for signal in listed(data.get("excitation")) if "dof" in signal]
        driven += listed(data.get("inputs"))
        given = [reduction.get("masters") for reduction in listed(data.get("reduction"))]
        masters = [dof for dofs in given if isinstance(dofs, list) for dof in dofs]
        return Mounted(
            tuple(replace(f, dofs=tuple(map(named, f.dofs))) for f in _fastenings(scene)),
            tuple(dict.fromkeys(map(named, driven))),
            tuple(dict.fromkeys((named(dof), quantity) for dof, quantity in _sensors(data))),
            tuple(dict.fromkeys(map(named, masters))),
        )


def _sensors(data: dict[str, Any]) -> Iterator[tuple[Label, str]]:
    """Yield where motion is measured or asked for, and which."""
    measurement = data.get("measurement") or {}
    shared = listed(measurement.get("channels"))
    for record in listed(measurement.get("records")) or [{}]:
        for channel in [*(listed(record.get("channels")) or shared), *listed(data.get("outputs"))]:
            for dof in channel.get("dofs") or [channel["dof"]]:
                yield dof, channel.get("quantity", "displacement")


def _fastenings(scene: PlainScene) -> Iterator[Fastening]:
    """Yield what is tied to DOFs: links, springs to ground, then joints."""
    structure = scene.data["structure"]
    for link in listed((structure.get("lumped") or {}).get("links")):
        yield _fastening(scene, link, link["dofs"])
    for kind in ("beam", "frame"):
        for item in listed((structure.get(kind) or {}).get("springs")):
            yield _fastening(scene, item, [f"{item['direction']}_{item['node']}"])
    for name, joint in (scene.data.get("joints") or {}).items():
        yield _fastening(scene, joint, joint["dofs"], str(name))


def _fastening(scene: PlainScene, tie: dict[str, Any], dofs: Sequence[Label], joint: str = "") -> Fastening:
    given = {letter: tie[letter] for letter in "kc" if tie.get(letter) is not None}
    texts = [f"{letter}{_worth(scene, value)}" for letter, value in given.items()]
    return Fastening(
        tuple(dofs), (joint, *texts) if joint else tuple(texts), "k" in given, "c" in given, bool(joint)
    )


def _worth(scene: PlainScene, given: Any) -> str:
    """Write a stiffness or damping: its value where it is one number and known."""
    if isinstance(given, dict):
        if given.get("start") is not None:
            return " = ?"
        given = given.get("value")
    return "" if given is None or isinstance(given, list) else f" = {short(scene.number(given))}"
