"""Charts as SVG text: lines and dots over two axes, with what stands for what beside them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final
from xml.sax.saxutils import escape

WIDTH, HEIGHT = 760, 380
_LEFT, _RIGHT, _TOP, _BOTTOM = 64, 180, 40, 56
COLOURS: Final = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
"""Told apart by the colour-blind, too (Okabe and Ito, "Color Universal Design", 2008)."""


@dataclass(frozen=True)
class Series:
    """Points that belong together: joined by a line, or as dots."""

    name: str
    """Empty: not in the legend."""
    x: Sequence[float]
    y: Sequence[float]
    colour: int
    """Index into COLOURS."""
    dots: bool = False


@dataclass(frozen=True)
class Axis:
    """From where to where, and what it shows."""

    label: str
    low: float
    high: float
    ticks: Sequence[float]
    logarithmic: bool = False

    def share(self, value: float) -> float:
        """How far along the axis a value lies, 0 to 1 within it."""
        if self.logarithmic:
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)


def chart(title: str, x: Axis, y: Axis, series: Sequence[Series]) -> str:
    """The file's text. What lies outside of the axes is left out."""
    body = [*_frame(title, x, y), *(line for one in series for line in _drawn(one, x, y))]
    named = [one for one in series if one.name]
    body += [line for row, one in enumerate(named) for line in _legend(one, row)]
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}"'
        f' height="{HEIGHT}" font-family="sans-serif" font-size="13">\n'
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="white"/>\n' + "\n".join(body) + "\n</svg>\n"
    )


def _across(x: Axis, value: float) -> float:
    return _LEFT + x.share(value) * (WIDTH - _LEFT - _RIGHT)


def _up(y: Axis, value: float) -> float:
    return HEIGHT - _BOTTOM - y.share(value) * (HEIGHT - _TOP - _BOTTOM)


def _frame(title: str, x: Axis, y: Axis) -> list[str]:
    bottom, right = HEIGHT - _BOTTOM, WIDTH - _RIGHT
    lines = [_text((_LEFT + right) / 2, 22, title, "middle", ' font-size="15"')]
    for tick in x.ticks:
        at = _across(x, tick)
        lines += [_line(at, _TOP, at, bottom), _text(at, bottom + 18, f"{tick:g}", "middle")]
    for tick in y.ticks:
        at = _up(y, tick)
        lines += [_line(_LEFT, at, right, at), _text(_LEFT - 8, at + 4, f"{tick:g}", "end")]
    middle = (_TOP + bottom) / 2
    turned = f' transform="rotate(-90 16 {middle:.1f})"'
    lines += [_text((_LEFT + right) / 2, HEIGHT - 14, x.label, "middle")]
    return [*lines, _text(16, middle, y.label, "middle", turned)]


def _drawn(one: Series, x: Axis, y: Axis) -> list[str]:
    points = [
        (_across(x, a), _up(y, b))
        for a, b in zip(one.x, one.y, strict=True)
        if x.low <= a <= x.high and y.low <= b <= y.high
    ]
    colour = COLOURS[one.colour]
    if one.dots:
        return [f'<circle cx="{a:.1f}" cy="{b:.1f}" r="3.2" fill="{colour}"/>' for a, b in points]
    path = " ".join(f"{a:.1f},{b:.1f}" for a, b in points)
    return [f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="1.8"/>']


def _legend(one: Series, row: int) -> list[str]:
    x, y = WIDTH - _RIGHT + 16, _TOP + 12 + 20 * row
    colour = COLOURS[one.colour]
    mark = (
        f'<circle cx="{x + 12}" cy="{y - 4}" r="3.2" fill="{colour}"/>'
        if one.dots
        else f'<line x1="{x}" y1="{y - 4}" x2="{x + 24}" y2="{y - 4}" stroke="{colour}" stroke-width="1.8"/>'
    )
    return [mark, _text(x + 30, y, one.name, "start")]


def _line(x0: float, y0: float, x1: float, y1: float) -> str:
    return f'<line x1="{x0:.1f}" y1="{y0:.1f}" x2="{x1:.1f}" y2="{y1:.1f}" stroke="#dddddd"/>'


def _text(x: float, y: float, words: str, anchor: str, more: str = "") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}"{more}>{escape(words)}</text>'
