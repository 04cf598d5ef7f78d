"""Lines of an acceptance table and the rows they give."""

from dataclasses import dataclass
from typing import Callable


@dataclass
class Row:
    """`met` is None where the line could not be judged: not met, but no defect either."""

    asked: str
    measured: str
    met: bool | None
    notes: str = ""

    def verdict(self):
        return {True: "yes", False: "**no**", None: "not judged"}[self.met]

    def text(self):
        notes = f"\n    {self.notes}" if self.notes else ""
        return f"{self.asked} | {self.measured} | {self.verdict()}{notes}"


@dataclass
class Line:
    """What `scripts/accept TOPIC --only NAME` runs."""

    name: str
    about: str
    run: Callable[[], list[Row]]
    long: bool = False
