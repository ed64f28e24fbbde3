"""Expectations of scenes, comparison of results, and JUnit reports for CI."""

from dynid.checks.comparison import Difference, compare
from dynid.checks.expectations import CheckOutcome, check_expectations, samples_meet
from dynid.checks.junit import junit_xml

__all__ = ["CheckOutcome", "Difference", "check_expectations", "compare", "junit_xml", "samples_meet"]
