"""Expectations of scenes, comparison of results, and JUnit reports for CI."""

from dynid.checks.comparison import Difference, compare
from dynid.checks.expectations import CheckOutcome, check_expectations, junit_xml, samples_meet

__all__ = ["CheckOutcome", "Difference", "check_expectations", "compare", "junit_xml", "samples_meet"]
