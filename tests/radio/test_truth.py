"""How the radio's check reads its reference and what it makes of differences; its own side is short."""

import math
from pathlib import Path

import pytest

from actors.runtime.errors import AcrcError
from benchmarks.radio.comparison import check, combined, compare, normal_score
from benchmarks.radio.trials import OperatingPoint, ReferenceEstimate, over_runs, points, share

HEAD = (
    "n,psdu,run,fixed,load,generated,queue_drop,transmitted,csma_fail,sink_ok,pdr_gen,pdr_tx,allpairs_pdr_tx,"
    "csma_fail_ratio,chan_busy,goodput_kbps,lat_mean_ms,lat_p95_ms,overlap_tx_ratio"
)
RUNS = [
    "1,127,1,1,sat,4732,0,4732,0,4732,1.00000,1.00000,1.00000,0.00000,0.67131,146.3765,6.3400,7.4560,0.00000",
    "1,127,2,1,sat,4733,0,4733,0,4733,1.00000,1.00000,1.00000,0.00000,0.67145,146.4075,6.3385,7.4560,0.00000",
    "1,127,3,0,sat,9999,0,9999,0,9999,0.50000,0.50000,0.50000,0.50000,0.50000,100.0000,9.0000,9.0000,0.50000",
]
"""Two of ns-3.44's runs of one backlogged sender, and one of an uncorrected PHY, which does not count."""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "b_single_saturated.csv").write_text("\n".join([HEAD, *RUNS]) + "\n")
    (tmp_path / "e_capture.csv").write_text(
        "psdu0,psdu1,run,fixed,delta_db,offset_us,frames,pdr_first,pdr_second\n"
        "60,60,1,1,0.000,500.000,2000,0.93500,0.00000\n"
    )
    return tmp_path


def test_runs_of_one_setting_are_one_point(folder: Path) -> None:
    (point,) = points(folder, "b_single_saturated")
    assert (point.settings, point.runs, point.frames) == ({"n": "1", "psdu": "127", "load": "sat"}, 2, 9465)
    assert point.figures["chan_busy"] == over_runs([0.67131, 0.67145])
    assert points(folder, "c_contention") == []


def test_a_small_reference_is_met(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = check(folder, runs=10)
    figures = found.figures
    assert found.holds and set(figures) == {"task", "families", "all", "throughput_error", "outside", "met"}
    assert figures["all"]["points"] == 2 and figures["all"]["comparisons"] == 4
    assert figures["met"] == dict.fromkeys(("inside", "excess", "z", "throughput"), True)
    assert "c_contention: no file c_contention.csv with rows" in capsys.readouterr().err


def test_a_folder_without_rows_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(AcrcError, match="there is none of the files a_per, b_single_saturated,"):
        check(tmp_path)


def test_a_row_without_a_number_is_an_error(folder: Path) -> None:
    (folder / "e_capture.csv").write_text("psdu0,frames\n60,many\n")
    with pytest.raises(AcrcError, match=r"e_capture\.csv: a row lacks .*many"):
        points(folder, "e_capture")


def test_both_sides_runs_make_one_error() -> None:
    one, other = over_runs([1.0, 3.0]), over_runs([2.0, 2.0, 2.0, 2.0])
    error, freedom = combined(one, other)
    assert freedom == 4 and error == pytest.approx(math.sqrt(2 / 4 * (1 / 2 + 1 / 4)))
    error, freedom = combined(share(50, 100), share(500, 1000))
    assert freedom == math.inf and error == pytest.approx(math.sqrt(0.25 / 100 + 0.25 / 1000))


def test_a_difference_is_outside_where_it_is_too_great() -> None:
    point = OperatingPoint("c_contention", {}, 5, 1, {})
    near = compare(point, "pdr_tx", ReferenceEstimate(0.5, 0.01, 4), ReferenceEstimate(0.51, 0.003, 49))
    far = compare(point, "pdr_tx", ReferenceEstimate(0.5, 0.01, 4), ReferenceEstimate(0.6, 0.003, 49))
    assert near.inside and not far.inside
    assert far.excess == pytest.approx(0.1 - 3 * far.error) and near.excess < 0
    assert (
        compare(point, "pdr_tx", ReferenceEstimate(1.0, 0, 4), ReferenceEstimate(1.0, 0, 49)).informative
        is False
    )


@pytest.mark.parametrize(("t", "freedom", "z"), [(2.776, 4, 1.96), (4.604, 4, 2.576), (2.009, 50, 1.96)])
def test_the_normal_score_is_exceeded_as_rarely(t: float, freedom: float, z: float) -> None:
    assert normal_score(t, freedom) == pytest.approx(z, rel=0.01)
