"""Where this project lies: it is installed as a link to its sources; maps and scenarios are beside them."""

from pathlib import Path
from typing import Final

REPOSITORY: Final = Path(__file__).resolve().parent.parent
