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
