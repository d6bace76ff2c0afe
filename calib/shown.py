"""Results as people see them: short where they are printed, a table in a notebook."""

from __future__ import annotations

import html
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd


class Shown(ABC):
    """A result with a sentence and rows; a base class of results."""

    @property
    @abstractmethod
    def headline(self) -> str:
        """What it is, in a sentence."""

    @abstractmethod
    def rows(self) -> list[dict[str, object]]:
        """What it holds, as rows of a table, in units for people."""

    def to_frame(self) -> pd.DataFrame:
        """The rows as a table of pandas."""
        import pandas as pd

        return pd.DataFrame(self.rows())

    def __repr__(self) -> str:
        """Name and headline: arrays would fill the screen."""
        return f"<{type(self).__name__}: {self.headline}>"

    def _repr_html_(self) -> str:
        """What a notebook shows."""
        table = self.to_frame().to_html(index=False, na_rep="", max_rows=60)
        return f"<p>{html.escape(self.headline)}</p>\n{table}"
