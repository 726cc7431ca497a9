"""The testbed as a library: run scenarios, open runs, read their tables, draw them, compare campaigns.

`import acrc_testbed as acrc` is all that a notebook needs; docs/library.md shows it. Whatever is wrong raises
`AcrcError`, with one sentence.
"""

from acrc_testbed.campaigns import Campaign, campaign, open_campaign
from acrc_testbed.runs import Run, beside, open_run, run
from actors.runtime.errors import AcrcError

__all__ = ["AcrcError", "Campaign", "Run", "beside", "campaign", "open_campaign", "open_run", "run"]
