"""Outcomes as JUnit XML, for CI."""

from __future__ import annotations

import re
from collections.abc import Iterable
from xml.etree import ElementTree

from dynid.checks.expectations import CheckOutcome

_NOT_XML = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\ud800-\udfff\ufffe\uffff]")


def junit_xml(outcomes: Iterable[CheckOutcome], name: str) -> str:
    """Write outcomes as a JUnit XML document, one test case each.

    Parameters
    ----------
    outcomes
        The outcomes.
    name
        The test suite's name, such as the scene's.
    """
    cases = list(outcomes)
    failures = sum(not case.passed for case in cases)
    totals = {
        "name": _xml(name),
        "tests": str(len(cases)),
        "failures": str(failures),
        "errors": "0",
        "time": "0",
    }
    root = ElementTree.Element("testsuites", totals)
    suite = ElementTree.SubElement(root, "testsuite", totals | {"skipped": "0"})
    for case in cases:
        label = f"{case.path} {case.expected}"
        item = {"classname": _xml(name), "name": _xml(label), "time": "0"}
        element = ElementTree.SubElement(suite, "testcase", item)
        if not case.passed:
            failure = {"message": _xml(case.message), "type": "expectation"}
            ElementTree.SubElement(element, "failure", failure).text = _xml(case.message)
    ElementTree.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ElementTree.tostring(root, encoding="unicode")}\n'


def _xml(text: str) -> str:
    return _NOT_XML.sub("�", text)
