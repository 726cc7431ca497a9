import re
import subprocess
import sys

from examples.contention import contend


def test_more_load_delivers_a_smaller_share() -> None:
    light, heavy = contend(0.05), contend(0.8)
    assert light[0] > 0.9 and 0.5 > heavy[0] > 0.1
    assert light[1] == 0.0 and 3.0 < light[2] < heavy[2]


def test_the_example_prints_a_line_for_each_load() -> None:
    command = [sys.executable, "-m", "examples.contention"]
    lines = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    form = r"load 0\.\d\d: +\d+\.\d% delivered, +\d+\.\d% no access, +\d+\.\d\d ms"
    assert len(lines) == 5 and all(re.fullmatch(form, line) for line in lines)
