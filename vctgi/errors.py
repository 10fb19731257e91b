"""What the renderer refuses."""

from __future__ import annotations


class SceneError(ValueError):
    """A scene that cannot be rendered.

    Attributes
    ----------
    what
        What is wrong.
    where
        The object that it is wrong with.
    remedy
        What to do about it.
    """

    def __init__(self, what: str, where: str, remedy: str) -> None:
        """Keep the three parts of the message."""
        super().__init__(f"{what}: {where}; {remedy}")
        self.what, self.where, self.remedy = what, where, remedy


class PresetFileError(ValueError):
    """A preset file that cannot be used.

    Attributes
    ----------
    what
        What is wrong.
    where
        The file.
    remedy
        What to do about it.
    """

    def __init__(self, what: str, where: str, remedy: str) -> None:
        """Keep the three parts of the message, each on one line."""
        self.what, self.where, self.remedy = (
            " ".join(part.split()) for part in (what, where, remedy)
        )
        super().__init__(f"{self.what}: {self.where}; {self.remedy}")
