"""Short programs to read and to change: what derivatives of pictures are good for."""

from __future__ import annotations
