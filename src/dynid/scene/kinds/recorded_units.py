"""Factors by which what a scene gives or a file holds in other units becomes SI."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from dynid.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from dynid.scene.schema.units import SensitivityModel
    from dynid.tables.table import Heading


class Sensor(Protocol):
    """The unit and sensitivity of a recorded column, as far as the scene has them."""

    @property
    def unit(self) -> str | None:
        """The unit of the recorded values."""

    @property
    def sensitivity(self) -> SensitivityModel | None:
        """The sensitivity of the sensor."""


class DrivenSource(NamedTuple):
    """A source of a graph that a signal drives, and its SI unit; empty where its domain is unknown."""

    name: str
    unit: str


def units_of(measured: Any) -> tuple[str, ...]:
    """Return the SI units that a channel, load or frequency response function may have; none: any.

    A DOF whose label has no direction may be a translation or a rotation; the domain of a graph's variable
    may be unknown.
    """
    from dynid.structure.ports import Channel, Load
    from dynid.units import as_factor

    force = getattr(measured, "force", None)
    if force is not None:
        above, below = units_of(measured.channel), units_of(measured.load)
        return tuple(f"{as_factor(a)}/{as_factor(b)}" for a in above for b in below)
    if isinstance(measured, Load) and measured.motion is None:
        return _either(measured.dof, "N", "N.m")
    if isinstance(measured, Channel | Load):
        quantity = measured.quantity if isinstance(measured, Channel) else measured.motion
        unit = Channel(0, str(quantity)).unit
        return _either(measured.dof, unit, unit.replace("m", "rad", 1))
    return (measured.unit,) if measured.unit else ()


def _either(dof: Any, of_translation: str, of_rotation: str) -> tuple[str, ...]:
    from dynid.structure import labels

    if dof is None:  # the ground
        return (of_translation,)
    known = {"translation": (of_translation,), "rotation": (of_rotation,)}
    return known.get(labels.kind(dof), (of_translation, of_rotation))


def recorded_factor(given: Sensor, heading: Heading | None, measured: Any, place: str) -> float:
    """Return the factor by which recorded values are multiplied to be SI.

    Parameters
    ----------
    given
        The channel or the signal in a file.
    heading
        The heading of its column; absent: the record is simulated.
    measured
        The channel, load or function that it records.
    place
        Its dotted path in the scene, for errors.

    Raises
    ------
    UsageError
        Where the unit does not fit what is measured, or scene and heading contradict each other.
    """
    from dynid.units import si_factor

    expected, stated = units_of(measured), "" if heading is None else heading.unit
    if not (given.unit or stated or given.sensitivity or (heading and heading.doubt)):
        return 1.0
    sensitivity = given.sensitivity
    if heading is not None and heading.doubt and not (given.unit or sensitivity):
        raise UsageError(
            f"the unit of the column '{heading.name}' is in doubt: {heading.doubt}",
            remedy="State the 'unit' of the channel.",
            names=(place,),
        )
    unit = given.unit or stated or (sensitivity.recorded if sensitivity else "")
    key = f"{place}.{'unit' if given.unit else 'sensitivity' if sensitivity else ''}".rstrip(".")
    try:
        factor = si_factor(
            unit, expected, over=sensitivity.unit if sensitivity else "", what=_named(measured)
        )
        if heading is not None and given.unit and stated and not _same(given.unit, stated):
            raise UsageError(
                f"'unit' is {given.unit}, but the file has '{heading.name}' in {stated}",
                remedy="Leave 'unit' out, or correct the heading.",
            )
    except UsageError as error:
        source = f"the column '{heading.name}' [{stated}]: " if heading and not given.unit and stated else ""
        raise UsageError(f"{source}{error.problem}", remedy=error.remedy, names=(key, place)) from error
    return factor / float(sensitivity.value) if sensitivity else factor


def amplitude_factor(unit: str, measured: Any, place: str, *, impulse: bool) -> float:
    """Return the factor by which an amplitude is multiplied to be SI; that of an impulse is an area.

    Raises
    ------
    UsageError
        Where the unit does not fit.
    """
    from dynid.units import as_factor, si_factor

    expected = [f"{as_factor(one)}.s" if impulse else one for one in units_of(measured)]
    try:
        return si_factor(
            unit, expected, what=f"the area of {_named(measured)}" if impulse else _named(measured)
        )
    except UsageError as error:
        raise UsageError(
            error.problem, remedy=error.remedy, names=(f"{place}.amplitude_unit", place)
        ) from error


def _same(one: str, other: str) -> bool:
    """Return True if two units are the same: of one dimension, with one factor."""
    from dynid.units import readings

    pairs = ((a, b) for a in readings(one) for b in readings(other))
    return any(a.dimension == b.dimension and abs(a.factor / b.factor - 1) < 1e-9 for a, b in pairs)


def _named(measured: Any) -> str:
    """Return what is measured, in words."""
    from dynid.structure.ports import Channel, Load

    if getattr(measured, "force", None) is not None:
        return f"the frequency response {measured.name}"
    if isinstance(measured, Channel | Load):
        quantity = measured.quantity if isinstance(measured, Channel) else measured.motion or "force"
        return f"{'an' if quantity[0] == 'a' else 'a'} {quantity}"
    return str(measured.name)


def products(factors: Sequence[float], levels: float | Sequence[float] | None) -> Any:
    """Return numbers, one or one a channel, each times its channel's factor."""
    if levels is None or all(factor == 1 for factor in factors):
        return levels
    each = [levels] * len(factors) if isinstance(levels, int | float) else levels
    return [abs(factor) * level for factor, level in zip(factors, each, strict=True)]
