"""Mitsuba's messages as one line that says what, where and what to do about it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import mitsuba as mi

from experiments.errors import InputError

_Rule = tuple[re.Pattern[str], str, str]

_RULES: Final[tuple[_Rule, ...]] = tuple(
    (re.compile(pattern), what, remedy)
    for pattern, what, remedy in (
        (
            r'texture plugin of type "[^"]*": \[FileStream\] "([^"]*)": I/O error',
            'the texture file "{0}" is missing or cannot be read',
            "put the file there or correct the filename in the scene",
        ),
        (
            r'\[FileStream\] "([^"]*)": I/O error',
            'the file "{0}" is missing or cannot be read',
            "put the file there or correct the filename in the scene",
        ),
        (
            r'Error while loading \w+ file "([^"]*)": file not found',
            'the mesh file "{0}" is missing',
            "put the file there or correct the filename in the scene",
        ),
        (
            r'Error while loading \w+ file "([^"]*)": mesh contains invalid vertex position',
            'the mesh "{0}" has vertices that are NaN or infinite',
            "export the mesh again or remove those vertices",
        ),
        (
            r"Storing new normals in a Mesh that didn't have normals",
            "a mesh file of the scene holds no triangles (no geometry)",
            "export the mesh again with its faces",
        ),
        (
            r'Parsing of XML file "[^"]*" failed: (.*)',
            "the XML cannot be parsed: {0}",
            "mend the XML syntax",
        ),
        (
            r"missing version attribute in root element <(\w+)>",
            "not a Mitsuba scene: the root element <{0}> has no version attribute",
            'begin the file with <scene version="3.0.0">',
        ),
        (
            r'failed to instantiate (\w+) plugin of type "[^"]*": .*Plugin "([^"]*)" not found',
            'there is no {0} plugin "{1}"',
            "correct its type; Mitsuba's documentation lists the plugins",
        ),
        (
            r"[Uu]ndefined parameter: (\$\w+)",
            "the scene needs the parameter {0}",
            "pass a value for it or give it a <default>",
        ),
        (
            r"Found unused parameters?: (.*)",
            "the scene has no use for the parameters {0}",
            "leave them out or correct their names",
        ),
    )
)
_SOURCE_LINE: Final = re.compile(r"^\[[\w./-]+:\d+\]\s*")
_LOCATION: Final = re.compile(r"\((?:line (\d+), col \d+)\)")
_LOG_LINE: Final = re.compile(r"^\d{4}-\d\d-\d\d \d\d:\d\d:\d\d +(?:WARN|ERROR) +", re.MULTILINE)


def input_error(error: Exception, where: str) -> InputError:
    """Turn an exception that Mitsuba raised over a scene into one line.

    Parameters
    ----------
    error
        What Mitsuba raised; keep it as the cause of the new error.
    where
        The scene's file or name; the line of an XML file is added where Mitsuba tells it.
    """
    message = _SOURCE_LINE.sub("", " ".join(str(error).split()))
    location = _LOCATION.search(message)
    if location is not None:
        where = f"{where}, line {location.group(1)}"
    for pattern, what, remedy in _RULES:
        found = pattern.search(message)
        if found is not None:
            return InputError(what=what.format(*found.groups()), where=where, remedy=remedy)
    return InputError(
        what=f"Mitsuba cannot load the scene ({message})",
        where=where,
        remedy="correct the scene; it must load with mi.load_file or mi.load_dict",
    )


@contextmanager
def captured_warnings() -> Iterator[list[str]]:
    """Collect what Mitsuba's logger says inside the block instead of printing it.

    Yields a list that is filled when the block ends: one entry a message, each on one line.
    Mitsuba writes to a file here, because its loader logs from several threads and a Python
    object among the appenders could block them.
    """
    logger = mi.logger()  # type: ignore[operator]
    outputs = [logger.appender(index) for index in range(logger.appender_count())]
    messages: list[str] = []
    with TemporaryDirectory() as folder:
        log_file = Path(folder) / "log.txt"
        capture = mi.StreamAppender(str(log_file))
        logger.clear_appenders()
        logger.add_appender(capture)
        try:
            yield messages
        finally:
            logger.clear_appenders()
            for output in outputs:
                logger.add_appender(output)
            del capture
            text = log_file.read_text(encoding="utf-8", errors="replace").replace("\0", "")
            messages += [" ".join(part.split()) for part in _LOG_LINE.split(text) if part.strip()]
