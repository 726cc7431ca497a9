"""The serial lines of a robot under noise: the base's and the radio board's, and what the latter carries."""

from dataclasses import asdict
from typing import Final

from rich.table import Table

from benchmarks.hardware import beeclick, kobuki
from benchmarks.measured import Measured

_LEAST_SHARE: Final = 0.95
"""Of what line or air can carry."""


def check(size: int, seed: int = 1) -> Measured:
    """Soak both drivers in so many bytes of noise and talk.

    It holds where next to nothing intact is missed or wrongly believed, and the link carries what it can.
    """
    base, board = kobuki.soak(size, seed), beeclick.soak(size, seed)
    carried = [beeclick.throughput(octets) for octets in beeclick.SIZES]
    holds = base.borne and board.borne and all(one.share >= _LEAST_SHARE for one in carried)
    figures = {
        "kobuki": asdict(base), "beeclick": asdict(board), "throughput": [asdict(one) for one in carried],
    }  # fmt: skip
    speed = Table("data bytes", "packets per s", "share of line or medium", title="a board, in virtual time")
    for one in carried:
        speed.add_row(str(one.data_bytes), f"{one.packets_per_s:.1f}", f"{one.share:.3f}")
    tables = (
        _soaked("a Kobuki's wire under noise", asdict(base)),
        _soaked("a board over a line that is noisy at times", asdict(board)),
        speed,
    )
    return Measured(figures, tables, holds)


def _soaked(title: str, figures: dict[str, object]) -> Table:
    table = Table("", "", title=title, show_header=False)
    for name, value in figures.items():
        if isinstance(value, dict):
            for cause, count in value.items():
                table.add_row(cause.replace("_", " "), str(count))
        else:
            table.add_row(name.replace("_", " "), f"{value:.1f}" if isinstance(value, float) else f"{value}")
    return table
