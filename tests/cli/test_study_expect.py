"""Expectations of a study's statistics, for CI."""

from xml.etree import ElementTree

import pytest

pytestmark = pytest.mark.thorough

STUDY = """\
dynid: 1
kind: study
title: Masses
scene: small.yaml
vary: {parameters.m: {values: [1, 2, 4, -1]}}
collect: [bond_graph/properties, bond_graph/transfer_function/m.f/F/poles]
expect:
  - {path: study/statistics/bond_graph/properties/m.f/F/stable/mean, min: 0.5}
  - {path: study/statistics/bond_graph/transfer_function/m.f/F/poles/median, at: {pole: 1}, max: LIMIT}
"""


@pytest.fixture
def study(folder):
    def write(limit):
        (folder / "masses.yaml").write_text(STUDY.replace("LIMIT", limit))
        return "masses.yaml"

    return write


def test_statistics_that_meet_their_expectations(dynid, study):
    # stable where m > 0; |poles| 1, 1/2, 1/4 and 1
    files = ("--junit", "out.xml", "--report", "out.html")
    code, out, err = dynid("study", study("0.75"), "--executor", "serial", *files)
    assert (code, err.count("expectation failed")) == (0, 0)
    assert "\n  wrote masses.h5, out.html\n" in out
    assert "2 of 2 expectations met" in out
    root = ElementTree.parse("out.xml").getroot()
    assert (root.get("tests"), root.get("failures")) == ("2", "0")
    assert root.find("testsuite").get("name") == "masses"


def test_statistics_that_miss_them_are_exit_1_at_their_line(dynid, study):
    code, _, err = dynid("study", study("0.7"), "--executor", "serial", "--junit", "out.xml", "-q")
    assert code == 1
    assert "masses.yaml:9:5: expectation failed: study/statistics/" in err
    assert "median is 0.75 rad/s, expected at most 0.7 rad/s" in err
    assert ElementTree.parse("out.xml").getroot().get("failures") == "1"
    # the same again, without a sample run
    code, _, _ = dynid("study", "masses.yaml", "-q")
    assert code == 1


def test_an_error_replaces_the_junit_file_of_an_earlier_study(dynid, study, folder):
    assert dynid("study", study("0.75"), "--executor", "serial", "--junit", "out.xml", "-q")[0] == 0
    (folder / "small.yaml").write_text("dynid: 1\n")
    code, _, err = dynid("study", "masses.yaml", "--executor", "serial", "--junit", "out.xml", "-q")
    assert code == 2
    root = ElementTree.parse("out.xml").getroot()
    assert (root.get("errors"), root.get("failures")) == ("1", "0")
    assert root.find(".//error").text in err


def test_a_study_warns_of_what_its_scene_does_not_use(dynid, study, folder):
    text = (folder / "small.yaml").read_text().replace("  time:", "  results: [properties, poles]\n  time:")
    (folder / "small.yaml").write_text(text)
    code, _, err = dynid("study", study("0.75"), "--executor", "serial", "--dry-run")
    assert (code, err) == (0, "")
    code, _, err = dynid("check", "masses.yaml")
    assert code == 0
    assert err.count("small.yaml:") == err.count(": warning: nothing is computed with the block") == 2
    _, _, err = dynid("study", "masses.yaml", "--executor", "serial", "-q")
    assert err.count(": warning: nothing is computed with the block") == 2


def test_expectations_of_the_scene_change_no_exit_code(dynid, study, folder):
    text = (folder / "small.yaml").read_text()
    (folder / "small.yaml").write_text(text.replace("dc_gain, value: 1", "dc_gain, value: 7"))
    code, out, _ = dynid("study", study("1"), "--executor", "serial")
    assert code == 0
    assert "bond_graph/properties/m.f/F/dc_gain = 7 0 %" in " ".join(out.split())


def test_a_shard_is_not_judged(dynid, study):
    code, _, err = dynid("study", study("0.1"), "--executor", "serial", "-q", "--shard", "1/2")
    assert (code, err) == (0, "")
    code, _, err = dynid("study", "masses.yaml", "--shard", "2/2", "--junit", "out.xml")
    assert code == 2
    assert "not of a shard" in err


def test_the_junit_file_overwrites_nothing(dynid, study):
    code, _, err = dynid("study", study("1"), "--junit", "masses.h5")
    assert code == 2
    assert "would overwrite" in err
