"""Verdicts -> JUnit XML (the xunit1 form), which every CI system reads."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

# Characters that XML 1.0 cannot hold, not even as a character reference.
NOT_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """Pass or fail of one check of one gate, with its reason."""

    gate: str
    """Name of the gate, such as a metric's."""
    scene: str
    kind: str
    """Kind of check, such as `finite`, `absolute`, `noninferior`, `order`, `exact`, `budget`."""
    passed: bool
    value: float | None
    """What was measured; None when there was nothing to measure."""
    limit: str
    """What was allowed, in words."""
    message: str
    """Why it passed or failed; for a failure also the remedy."""
    seconds: float
    """Time of the check, seconds, >= 0."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.seconds) and self.seconds >= 0.0):
            raise ValueError(
                f"Verdict.seconds must be finite and >= 0, got {self.seconds} "
                f"({self.gate} on {self.scene})"
            )


def junit_xml(
    verdicts: Sequence[Verdict],
    *,
    suite: str = "vctgi gate",
    properties: Mapping[str, str] | None = None,
) -> str:
    r"""JUnit XML of a list of verdicts, one test case each, in the order given.

    Parameters
    ----------
    verdicts
        Test cases: `classname` is the scene, `name` the gate and its kind.
    suite
        Name of the test suite.
    properties
        Facts about the whole run, such as the commit.

    Returns
    -------
    str
        An XML document; characters that XML cannot hold are shown as `\uXXXX`.
    """
    failures = sum(not verdict.passed for verdict in verdicts)
    seconds = sum(verdict.seconds for verdict in verdicts)
    counts = {
        "name": _xml_text(suite),
        "tests": str(len(verdicts)),
        "failures": str(failures),
        "errors": "0",
        "skipped": "0",
        "time": f"{seconds:.3f}",
    }
    root = ElementTree.Element("testsuites")
    element = ElementTree.SubElement(root, "testsuite", counts)
    if properties:
        _add_properties(element, properties)
    for verdict in verdicts:
        _add_case(element, verdict)
    ElementTree.indent(root)
    body = ElementTree.tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="utf-8"?>\n{body}\n'


def write_junit(
    verdicts: Sequence[Verdict],
    output: Path,
    *,
    suite: str = "vctgi gate",
    properties: Mapping[str, str] | None = None,
) -> Path:
    """Write `junit_xml` to a file, whose folder is made when missing, and return its path."""
    output.parent.mkdir(parents=True, exist_ok=True)
    output.write_text(junit_xml(verdicts, suite=suite, properties=properties), encoding="utf-8")
    return output


def _add_case(suite: ElementTree.Element, verdict: Verdict) -> None:
    case = ElementTree.SubElement(
        suite,
        "testcase",
        {
            "classname": _xml_text(verdict.scene),
            "name": _xml_text(f"{verdict.gate} [{verdict.kind}]"),
            "time": f"{verdict.seconds:.3f}",
        },
    )
    value = "" if verdict.value is None else repr(float(verdict.value))
    facts = {
        "gate": verdict.gate,
        "scene": verdict.scene,
        "kind": verdict.kind,
        "value": value,
        "limit": verdict.limit,
    }
    _add_properties(case, facts)
    if verdict.passed:
        if verdict.message:
            ElementTree.SubElement(case, "system-out").text = _xml_text(verdict.message)
        return
    failure = ElementTree.SubElement(
        case, "failure", {"type": _xml_text(verdict.kind), "message": _xml_text(verdict.message)}
    )
    failure.text = _xml_text(f"{verdict.message}\nvalue {value or 'none'}, limit {verdict.limit}")


def _add_properties(parent: ElementTree.Element, properties: Mapping[str, str]) -> None:
    element = ElementTree.SubElement(parent, "properties")
    for name, value in properties.items():
        ElementTree.SubElement(
            element, "property", {"name": _xml_text(name), "value": _xml_text(value)}
        )


def _xml_text(text: str) -> str:
    return NOT_XML.sub(lambda match: f"\\u{ord(match.group()):04x}", text)
