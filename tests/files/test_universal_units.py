"""Units of functions in Universal Files: record 164 against labels of axes, and what contradicts itself."""

import numpy as np
import pytest

from dynid.errors import FileError
from dynid.files.read_measured import read_columns
from dynid.files.universal_file import FileUnits, function_units
from dynid.units import si_factor
from tests.files.universal_files import function, units, written

MM, INCH, SI = FileUnits(1e3, 1.0, True), FileUnits(39.3701, 0.224809, True), FileUnits(1.0, 1.0, True)


@pytest.mark.parametrize(
    ("arguments", "si", "factor"),
    [
        (("acceleration", "x", "", ""), "m/s2", 1e-3),
        (("velocity", "-z", "", ""), "m/s", 1e-3),
        (("displacement", "y", "", ""), "m", 1e-3),
        (("acceleration", "rx", "", ""), "rad/s2", 1.0),
        (("force", "x", "", ""), "N", 1.0),
        (("force", "-rz", "", ""), "N.m", 1e-3),
        (("acceleration", "x", "force", "z"), "(m/s2)/N", 1e-3),
        (("displacement", "x", "force", "ry"), "m/(N.m)", 1.0),
        (("velocity", "rz", "force", "x"), "(rad/s)/N", 1.0),
    ],
)
def test_records_of_units_have_their_dimensions(arguments, si, factor):
    found = function_units(*arguments, ("", ""), MM)
    assert found.doubt == ""
    assert si_factor(found.stated, [si]) == pytest.approx(factor, rel=1e-15)


def test_factors_of_six_digits_are_those_of_their_units():
    found = function_units("velocity", "x", "force", "x", ("", ""), INCH)
    assert si_factor(found.stated, ["(m/s)/N"]) == pytest.approx(0.0254 / 4.4482216152605, rel=1e-15)


@pytest.mark.parametrize(
    ("labels", "over", "factor"),
    [
        (("g", ""), "", 9.80665),
        (("mm/s^2", ""), "", 1e-3),
        (("(mm/s²)/N", ""), "force", 1e-3),
        (("g", "N"), "force", 9.80665),
        (("g", ""), "force", 9.80665),  # the denominator has no label
        (("g", "kN"), "force", 9.80665e-3),
    ],
)
def test_without_a_record_the_labels_state_the_unit(labels, over, factor):
    found = function_units("acceleration", "x", over, "z" if over else "", labels, FileUnits())
    si = "(m/s2)/N" if over else "m/s2"
    assert si_factor(found.stated, [si]) == pytest.approx(factor, rel=1e-14)


def test_labels_that_are_no_units_state_nothing():
    assert function_units("acceleration", "x", "", "", ("m/s\ufffd", ""), FileUnits()).stated == ""
    assert function_units("acceleration", "x", "", "", ("EU", ""), SI).stated == "m/s2"


@pytest.mark.parametrize(
    ("quantity", "labels", "of", "said"),
    [
        ("acceleration", ("g", ""), SI, "its label says g, the record of units (164) m/s2"),
        ("acceleration", ("m/s2", ""), MM, "its label says m/s2, the record of units (164) mm/s2"),
        ("acceleration", ("V", ""), SI, "its type says acceleration, its label V"),
        ("", ("", ""), MM, "its type does not say what it is, and its file is not in SI units"),
        ("force", ("", ""), FileUnits(3.0, 1.0, True), "of its units 3 are one metre, and 1 one newton"),
    ],
)
def test_contradictions_are_doubts(quantity, labels, of, said):
    found = function_units(quantity, "x", "", "", labels, of)
    assert found.doubt == said
    assert found.stated == ""


def test_agreement_is_no_doubt():
    assert function_units("acceleration", "x", "", "", ("mm/s2", ""), MM).stated == "mm/s2"
    assert function_units("force", "x", "", "", ("lbf", ""), INCH).stated == "lbf"


def test_columns_have_the_units_of_their_file(tmp_path):
    path = written(
        tmp_path / "x.uff",
        units(1e3, 1.0, code=10),
        function(np.arange(5.0), response=(1, 3)),
        function(np.arange(5.0), response=(1, 3), ordinate_axis_units_lab="g"),
    )
    first, second = read_columns(path, None).headings
    assert (first.unit, first.doubt) == ("mm/s2", "")
    assert "its label says g" in second.doubt


@pytest.mark.parametrize(("code", "refused"), [(1, True), (2, False), (9, False)])
def test_a_record_that_contradicts_its_code_is_refused(tmp_path, code, refused):
    path = written(tmp_path / "x.uff", units(3.28084, 0.224809, code=code), function(np.arange(5.0)))
    if refused:
        with pytest.raises(
            FileError, match=r"says m and N \(code 1\), but has the factors 3.28084, 0.224809"
        ):
            read_columns(path, None)
    else:
        assert read_columns(path, None).headings[0].unit == "ft/s2"
