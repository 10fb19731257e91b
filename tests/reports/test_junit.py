from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from reports.junit import Verdict, junit_xml, write_junit

PASSED = Verdict(
    gate="relmse_e2",
    scene="cornell",
    kind="noninferior",
    passed=True,
    value=0.0213,
    limit="at most 0.0220",
    message="upper end 0.0219",
    seconds=0.25,
)
FAILED = replace(
    PASSED, scene="rooms", passed=False, value=0.031, message="rose by 45 %", seconds=1
)


def test_counts_and_times_add_up() -> None:
    suite = ElementTree.fromstring(junit_xml([PASSED, FAILED])).find("testsuite")
    assert suite is not None
    assert suite.attrib == {
        "name": "vctgi gate",
        "tests": "2",
        "failures": "1",
        "errors": "0",
        "skipped": "0",
        "time": "1.250",
    }


def test_a_failure_says_why_and_a_pass_has_none() -> None:
    passed, failed = ElementTree.fromstring(junit_xml([PASSED, FAILED])).iter("testcase")
    assert passed.find("failure") is None
    assert passed.findtext("system-out") == "upper end 0.0219"
    failure = failed.find("failure")
    assert failure is not None
    assert failure.attrib == {"type": "noninferior", "message": "rose by 45 %"}
    assert failure.text == "rose by 45 %\nvalue 0.031, limit at most 0.0220"
    assert failed.attrib["classname"] == "rooms"
    assert failed.attrib["name"] == "relmse_e2 [noninferior]"


def test_properties_hold_the_facts() -> None:
    root = ElementTree.fromstring(junit_xml([PASSED], properties={"commit": "abc"}))
    facts = {p.attrib["name"]: p.attrib["value"] for p in root.iter("property")}
    assert facts == {
        "commit": "abc",
        "gate": "relmse_e2",
        "scene": "cornell",
        "kind": "noninferior",
        "value": "0.0213",
        "limit": "at most 0.0220",
    }


def test_a_check_without_a_value_is_written() -> None:
    root = ElementTree.fromstring(junit_xml([replace(FAILED, value=None)]))
    assert root.findtext(".//failure") == "rose by 45 %\nvalue none, limit at most 0.0220"


def test_no_verdict_is_an_empty_suite(tmp_path: Path) -> None:
    path = write_junit([], tmp_path / "new" / "gate.xml", suite="empty")
    suite = ElementTree.parse(path).getroot().find("testsuite")
    assert suite is not None
    assert suite.attrib["tests"] == "0"


@given(text=st.text(st.characters(exclude_categories=[])))
def test_any_text_gives_well_formed_xml(text: str) -> None:
    verdict = replace(FAILED, gate=text, scene=text, limit=text, message=text)
    document = junit_xml([verdict], suite=text, properties={text: text})
    ElementTree.fromstring(document.encode("utf-8"))


def test_markup_in_text_stays_text() -> None:
    text = "<b>& \"x\" 'y' ]]>"
    root = ElementTree.fromstring(junit_xml([replace(FAILED, scene=text, message=text)]))
    case = next(root.iter("testcase"))
    assert case.attrib["classname"] == text
    assert case.find("failure").attrib["message"] == text  # type: ignore[union-attr]


def test_what_xml_cannot_hold_is_shown_as_a_code() -> None:
    root = ElementTree.fromstring(junit_xml([replace(PASSED, scene="a\x00b\x1b\ud800")]))
    assert next(root.iter("testcase")).attrib["classname"] == "a\\u0000b\\u001b\\ud800"


@pytest.mark.parametrize("seconds", [-1.0, float("nan"), float("inf")])
def test_a_time_is_a_time(seconds: float) -> None:
    with pytest.raises(ValueError, match=r"Verdict\.seconds must be finite and >= 0"):
        replace(PASSED, seconds=seconds)
