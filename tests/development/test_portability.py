"""The check of cores' arithmetic: every kind of call that other processors answer otherwise, no other."""

from pathlib import Path

import pytest

from command_line.development.portability import findings, in_source

HEAD = "import math\nimport numpy as np\nfrom numba import njit\n"


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        (
            "x = math.cos(y)",
            "math.cos differs in its last bits between C libraries; "
            "use actors.portable.cos (in a kernel actors.portable.compiled.cos)",
        ),
        (
            "from math import hypot",
            "math.hypot differs in its last bits between C libraries; "
            "use actors.portable.hypot (in a kernel actors.portable.compiled.hypot)",
        ),
        (
            "x = math.gamma(y)",
            "math.gamma differs in its last bits between C libraries; use what actors.portable offers",
        ),
        (
            "x = np.arctan(y)",
            "numpy.arctan differs in its last bits between processors; use actors.portable.arrays.atan",
        ),
        (
            "x = np.sum(y)",
            "numpy.sum adds in an order that depends on the processor; "
            "use actors.portable.arrays.total, a loop, or dtype=np.int64 for whole numbers",
        ),
        (
            "x = (a * b).mean()",
            ".mean() adds in an order that depends on the processor; "
            "use actors.portable.arrays.total, a loop, or dtype=np.int64 for whole numbers",
        ),
        (
            "x = np.linalg.norm(y)",
            "numpy.linalg adds in an order that depends on the processor; "
            "use actors.portable.arrays.total, a loop, or dtype=np.int64 for whole numbers",
        ),
        (
            "x = a @ b",
            "@ adds in an order that depends on the processor; "
            "use actors.portable.arrays.total, a loop, or dtype=np.int64 for whole numbers",
        ),
        (
            "x = y**0.5",
            "** is the C library's power function; "
            "write the products out, or use exp10, or exp and log, of actors.portable",
        ),
        (
            "x **= 2",
            "** is the C library's power function; "
            "write the products out, or use exp10, or exp and log, of actors.portable",
        ),
        (
            "x = sum(a * b for a, b in c)",
            "sum() of floats compensates from Python 3.12 on, not before; "
            "use math.fsum; for whole numbers sum(int(…) for …)",
        ),
        (
            "x = rng.standard_normal(3)",
            ".standard_normal() takes its draws through the C library's functions; use actors.portable.draws",
        ),
        (
            "x = np.random.rand()",
            "numpy.random.rand is no stream of one actor; use actors.randomness.generator",
        ),
        (
            "x = np.argsort(y)",
            'argsort puts equals in an order that depends on the processor; say kind="stable"',
        ),
        ("import statistics", "statistics is not for cores; use actors.portable and actors.randomness"),
        (
            "from numpy import linalg",
            "numpy.linalg is not for cores; use actors.portable and actors.randomness",
        ),
        (
            "@njit(fastmath=True)\ndef f(x): return x",
            "fastmath lets the compiler reorder or fuse arithmetic; leave it out",
        ),
    ],
    ids=lambda word: word.splitlines()[0][:24],
)
def test_what_another_processor_answers_otherwise(line: str, sentence: str) -> None:
    found = [str(one) for one in in_source(HEAD + line + "\n", "actors/world/x.py")]
    assert f"actors/world/x.py:4: {sentence}" in found


@pytest.mark.parametrize(
    "line",
    [
        "x = math.sqrt(y) + math.floor(z) + math.remainder(a, math.tau) + math.fsum(b) + math.radians(3)",
        "x = np.sqrt(y) * np.square(z) + np.cumsum(a) - np.maximum(b, 0)",
        "x = counts.sum(dtype=np.int64)",
        "x = sum(len(row) for row in rows) + sum(int(a) for a in b) + sum(a == b for a in c)",
        "x = 2**64 - 1",
        "x = generator.random(3) + generator.integers(5)",
        'x = np.argsort(y, kind="stable")',
        "from deeco.statistics import Counters",
        'entry, _, rest = "a:b".partition(":")',
        "from actors.portable import cos",
    ],
)
def test_what_every_processor_answers_alike(line: str) -> None:
    assert in_source(HEAD + line + "\n", "actors/world/x.py") == []


def test_only_rooms_with_cores_are_looked_at(tmp_path: Path) -> None:
    for name in ("actors/world/a.py", "actors/observer/b.py", "deploy/c.py", "cleaning/d.py"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("import math\nx = math.exp(1)\n")
    assert [(one.path, one.line) for one in findings(tmp_path)] == [
        ("actors/world/a.py", 2),
        ("cleaning/d.py", 2),
    ]


def test_no_core_of_ours_has_any() -> None:
    assert findings() == []
