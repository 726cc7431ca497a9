"""`acrc bench radio`: speed of the medium, carrier sense of the firmware, cost of authentication, figures of
docs/radio.md.
"""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from timeit import repeat
from typing import Any, Final

import numpy as np
from msgspec.structs import replace
from numpy.typing import ArrayLike, NDArray
from PIL import Image

from acrc_testbed.benchmarks.benchmark_result import BenchmarkResult, make_table
from acrc_testbed.benchmarks.radio_trials import (
    NS3,
    SECOND,
    LossTable,
    OperatingPoint,
    read_points,
    run_contention,
    scene,
)
from acrc_testbed.picture import style
from acrc_testbed.picture.style import Axes
from actors.array_types import Floats
from actors.floor.grid import FREE, OCCUPIED, OccupancyGrid
from actors.floor.map_file import load_map
from actors.ieee802154 import airtime_ns
from actors.installation.repository import SHIPPED
from actors.installation.usage import OptionError
from actors.radio.frame import airtime_us
from actors.radio.medium.medium import Medium, PoissonTraffic, Request
from actors.radio.medium.reception import frame_error_rate
from actors.radio.medium.state import Outcome, Transceiver
from actors.radio.propagation import IndoorPropagation, ShadowingParameters
from actors.radio.radio_model import (
    RadioParameters,
    RadioSetup,
    WifiInterferer,
    WifiParameters,
    preset,
    radio_model,
    required_dbm,
)
from actors.radio.walls import build
from deeco.aes_ccm import TAG_SIZES, AesCcmAuthenticator
from deeco.fragments import Fragmenter
from deeco.packet import KnowledgePacket, Version, pack, verified_packet

PER_FLOOR: Final = 20
"""Robots per copy of the floor plan."""
_CROWD_OCTETS: Final = 100
_STEP_NS: Final = SECOND // 10


def frame_cost(plan: OccupancyGrid, robots: int, seconds: int, seed: int) -> float:
    """Return the CPU time per frame, µs: preset `chapter`, each robot sends a frame per second, all listen.

    Copies of the plan with 20 robots each form a rectangle. Robots start at random free cells and oscillate
    by up to 0.3 m, so that losses are not cached.
    """
    parameters = preset("chapter")
    copies = max(1, round(robots / PER_FLOOR))
    wide = math.ceil(math.sqrt(copies))
    floor = OccupancyGrid(np.tile(plan.cells, (-(-copies // wide), wide)), plan.resolution, plan.origin)
    medium = Medium(
        [parameters.transceiver.numbered(1 + number) for number in range(robots)],
        IndoorPropagation(parameters.propagation, build(floor, parameters.propagation.walls)),
        parameters.phy,
        seed=seed,
    )
    rng = np.random.default_rng(seed)
    free = np.argwhere(floor.free)
    places = (free[rng.integers(0, len(free), robots)][:, ::-1] + 0.5) * plan.resolution + plan.origin
    swing = rng.uniform(-0.3, 0.3, (robots, 2))

    def positions(instant_ns: int) -> Floats:
        return places + swing * math.sin(instant_ns / 1e9)

    medium.follow(positions)
    for number in range(robots):
        medium.offer(number, PoissonTraffic(_CROWD_OCTETS, 1.0))
    return 1e6 * _frame_s(medium, (1 + seconds) * SECOND, _STEP_NS)


_SPACING_NS: Final = 45_000_000
"""Interval between frames without contention; longer than the longest channel access."""
_RECEIVED: Final = "share of frames received"
_WIDTH, _HEIGHT = 7.6, 3.8
"""Inches."""
_BLACK: Final = 3
_COLOURS: Final = ("#0072b2", "#d55e00", "#009e73", "#000000")
"""Colour-blind safe palette (Okabe and Ito, "Color Universal Design", 2008); black: reference data."""
_LENGTHS: Final = (20, 60, 127)
_PLOTTED_LOADS: Final = ("0.200", "0.800", "sat")
MEASURED_LINKS: Final = {
    -96: 0.1494, -95: 0.2340, -94: 0.4071, -93: 0.6359, -92: 0.6866, -91: 0.7476, -90: 0.8603, -89: 0.8702,
    -88: 0.9324, -87: 0.9427, -86: 0.9562, -85: 0.9611, -84: 0.9739, -83: 0.9745, -82: 0.9844, -81: 0.9854,
    -80: 0.9903,
}  # fmt: skip
"""Packet delivery ratio by signal strength, dBm, measured by motes in a building: connectivity data "dust" of
wsn.eecs.berkeley.edu, from the 6TiSCH simulator (SimEngine/Connectivity.py)."""


@dataclass(frozen=True)
class PlotTask:
    """Size of the figures."""

    frames: int = 1000
    """Frames per measured point."""
    places: int = 4000
    """Pairs of positions over which shadowing is averaged."""
    seeds: int = 2
    """Runs per point of contention."""
    senders: tuple[int, ...] = (2, 5, 10, 20, 50)
    transmitter: tuple[float, float] = (12.0, 5.0)
    """Position on the map of the corridor, m: the first robot's start."""


def draw(
    folder: Path, map_file: Path, data: Path | None = None, task: PlotTask | None = None
) -> BenchmarkResult:
    """Write the figures into the folder, with results of ns-3 as dots if `data` is given."""
    task = task or PlotTask()
    folder.mkdir(parents=True, exist_ok=True)
    for name, plot in _FIGURES.items():
        with style.context(style.LOOK):
            figure = style.new_figure(_WIDTH, _HEIGHT)
            axes = figure.subplots()
            plot(axes, task, data)
            axes.set_ylim(0.0, 1.02)
            axes.grid(color="#dddddd")
            axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
            style.save(figure, folder / name)
    _draw_corridor(folder / "corridor.png", map_file, task)
    written = [str(folder / name) for name in (*_FIGURES, "corridor.png")]
    dots = [] if data else ["Results of ns-3 not drawn: --data is missing."]
    return BenchmarkResult({"written": written, "reference": data is not None}, [*written, *dots])


def _label(
    axes: Axes, title: str, label: str, ticks: Sequence[float], *, y: str = _RECEIVED, scale: str = "linear"
) -> None:
    """Label the axes; x goes from the first tick to the last."""
    axes.set_xscale(scale)
    axes.set(title=title, xlabel=label, ylabel=y, xlim=(ticks[0], ticks[-1]))
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.minorticks_off()


def _line(axes: Axes, name: str, x: ArrayLike, y: ArrayLike, colour: int) -> None:
    axes.plot(x, y, color=_COLOURS[colour], label=name, linewidth=1.5)


def _dots(axes: Axes, name: str, x: ArrayLike = (), y: ArrayLike = (), colour: int = _BLACK) -> None:
    """Plot dots; without points, add a legend entry only. Names that begin with _ have no entry."""
    axes.plot(x, y, color=_COLOURS[colour], label=name, linestyle="none", marker="o", markersize=4)


def _reference_points(axes: Axes, data: Path | None, family: str) -> list[OperatingPoint]:
    """Return the points of a family of ns-3; add a legend entry if there are any."""
    found = [] if data is None else read_points(data, family)
    if found:
        _dots(axes, "dots: ns-3.44")
    return found


def _received_share(
    parameters: RadioParameters, distance: float, task: PlotTask, wifi: WifiParameters | None = None
) -> float:
    """Simulate the share of 127-octet frames received over a distance in line of sight."""
    propagation = IndoorPropagation(parameters.propagation)
    stations = (
        [WifiInterferer(wifi, parameters.channel, propagation, lambda: np.random.default_rng(5))]
        if wifi
        else []
    )
    pair = [replace(parameters.transceiver, address=address) for address in (1, 2)]
    medium = Medium(pair, propagation, parameters.phy, seed=1, interferers=stations)
    medium.place(np.array([[0.0, 0.0], [distance, 0.0]]))
    medium.submit(Request(k * _SPACING_NS, 0, 127, tag=k) for k in range(task.frames))
    medium.run(task.frames * _SPACING_NS)
    return float(medium.outcomes()[1, Outcome.HEARD]) / task.frames


def _formula_share(parameters: RadioParameters, loss_db: Floats) -> Floats:
    """Return the share of 127-octet frames received for each loss, by formula."""
    snr_db = parameters.transceiver.tx_power_dbm - loss_db - parameters.phy.noise_dbm
    return 1.0 - frame_error_rate(snr_db, 127)


def _plot_range(axes: Axes, task: PlotTask, data: Path | None) -> None:
    ticks = (4, 6, 8, 10, 15, 20, 30, 40, 60, 80)
    _label(axes, "Range of 127-octet frames", "distance in line of sight, m", ticks, scale="log")
    distances = np.geomspace(4.0, 80.0, 300)
    away = np.stack([distances, np.zeros(300)], axis=1)
    _dots(axes, "dots: simulated")
    for colour, name in enumerate(("chapter", "rosomnet", "beeclick")):
        parameters = preset(name)
        propagation = IndoorPropagation(parameters.propagation)
        shares = _formula_share(parameters, propagation.loss_db(np.zeros((1, 2)), away)[0])
        _line(axes, name, distances, shares, colour)
        grey = distances[(shares > 0.005) & (shares < 0.995)]
        counted = np.linspace(grey[0] - 0.2, grey[-1] + 0.2, 9)
        _dots(axes, "_", counted, [_received_share(parameters, d, task) for d in counted.tolist()], colour)


def _plot_errors(axes: Axes, task: PlotTask, data: Path | None) -> None:
    label, ticks = "signal to noise, dB", (-3, -2, -1, 0, 1, 2, 3, 4)
    _label(axes, "Frames lost in white noise", label, ticks, y="share of frames lost")
    ratios = np.linspace(-3.0, 4.0, 200).astype(np.float64)
    reference = _reference_points(axes, data, "a_per")
    for colour, octets in enumerate(_LENGTHS):
        _line(axes, f"{octets} octets", ratios, frame_error_rate(ratios, octets), colour)
        found = [p for p in reference if p.settings["psdu"] == str(octets)]
        at = [float(p.settings["rx_dbm"]) - float(p.settings["noise_dbm"]) for p in found]
        _dots(axes, "_", at, [p.figures["per"].value for p in found], colour)


def _plot_grey(axes: Axes, task: PlotTask, data: Path | None) -> None:
    label, ticks = "mean received power, dBm", (-100, -96, -92, -88, -84, -80)
    _label(axes, "The grey zone of 127-octet frames", label, ticks)
    for colour, sigma_db in enumerate((0.0, 3.0, 6.0)):
        _line(axes, f"shadowing {sigma_db:g} dB", *grey_zone(sigma_db, task.places), colour)
    _dots(axes, "dots: measured", list(MEASURED_LINKS), list(MEASURED_LINKS.values()))


def grey_zone(sigma_db: float, places: int = PlotTask.places) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return mean received powers, dBm, and the share of frames received over links with shadowing."""
    parameters, powers = preset("beeclick"), np.arange(-100.0, -78.0, 0.25)
    ends = np.random.default_rng(1).uniform(0.0, 2000.0, (2, places, 2))
    shadows: Floats = np.zeros(places)
    if sigma_db:
        flat = replace(
            parameters.propagation.path_loss, near_loss_db=200.0, near_exponent=0.0, breakpoint=np.inf
        )
        shadowed = replace(parameters.propagation, path_loss=flat, shadowing=ShadowingParameters(sigma_db))
        propagation = IndoorPropagation(shadowed, None, np.random.default_rng(2))
        losses = [propagation.loss_db(one[None], other[None])[0, 0] for one, other in zip(*ends, strict=True)]
        shadows = np.array(losses) - 200.0
    losses_db = parameters.transceiver.tx_power_dbm - powers[:, None] + shadows
    return powers, _formula_share(parameters, losses_db).mean(axis=1)


def _plot_wifi(axes: Axes, task: PlotTask, data: Path | None) -> None:
    title = "127-octet frames over 3 m with Wi-Fi on the same channel"
    label = "distance of the Wi-Fi station from the receiver, m"
    _label(axes, title, label, (1, 2, 3, 5, 8, 12, 20, 40), scale="log")
    distances = np.geomspace(1.0, 40.0, 12).tolist()
    for colour, duty in enumerate((0.1, 0.3, 0.6)):
        stations = [WifiParameters((3.0, distance), 1, duty) for distance in distances]
        shares = [_received_share(preset("chapter"), 3.0, task, station) for station in stations]
        _dots(axes, f"on {duty:.0%} of the time", distances, shares, colour)
        _line(axes, "_", distances, shares, colour)


def _plot_senders(axes: Axes, task: PlotTask, data: Path | None) -> None:
    label = "senders, all in range of each other"
    _label(axes, "60-octet broadcasts received, share of those sent", label, (2, 5, 10, 20, 50), scale="log")
    reference = _reference_points(axes, data, "c_contention")
    for colour, load in enumerate(_PLOTTED_LOADS):
        scenes = [
            scene("c_contention", {"n": str(senders), "psdu": "60", "load": load}) for senders in task.senders
        ]
        seeds = range(1, task.seeds + 1)
        shares = [np.mean([run_contention(stage, seed)["pdr_tx"] for seed in seeds]) for stage in scenes]
        _line(axes, "backlogged" if load == "sat" else f"G = {float(load):g}", task.senders, shares, colour)
        found = [p for p in reference if (p.settings["psdu"], p.settings["load"]) == ("60", load)]
        heard = [p.figures["pdr_tx"].value for p in found]
        _dots(axes, "_", [float(p.settings["n"]) for p in found], heard, colour)


_FIGURES: Final = {
    "reach.svg": _plot_range, "error_rate.svg": _plot_errors, "grey_zone.svg": _plot_grey,
    "wifi.svg": _plot_wifi, "contention.svg": _plot_senders,
}  # fmt: skip


def _draw_corridor(file: Path, map_file: Path, task: PlotTask) -> None:
    """Draw received power on the free floor: darker is stronger; red: fewer than half of frames received."""
    setup = RadioSetup(seed=1, step_us=100_000, robots=(), preset="chapter", map=str(map_file))
    found, grid = radio_model(setup), load_map(map_file)
    x, y = (axis[1::4] for axis in grid.centres())
    spots = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    loss = found.propagation.loss_db(np.array([task.transmitter]), spots)[0].reshape(len(y), len(x))
    power = found.parameters.transceiver.tx_power_dbm - loss
    weakest = required_dbm(found.parameters)
    light = np.clip((-40.0 - power) / (-40.0 - weakest), 0.0, 1.0)
    colours = np.stack([60 + 160 * light, 90 + 140 * light, 160 + 70 * light], axis=-1)
    colours[power < weakest] = (230, 150, 130)
    cells = grid.cells[1::4, 1::4]
    colours[cells != FREE] = (255, 255, 255)
    for shift in np.ndindex(4, 4):  # a wall is thinner than a pixel
        walls = np.argwhere(grid.cells[shift[0] :: 4, shift[1] :: 4][: len(y), : len(x)] == OCCUPIED)
        colours[*walls.T] = (0, 0, 0)
    image = Image.fromarray(np.flipud(colours).astype(np.uint8))
    image.resize((image.width * 3, image.height * 3), Image.Resampling.NEAREST).save(file, optimize=True)


_CORRIDOR: Final = SHIPPED / "maps" / "corridor.yaml"
_SENDERS: Final = (1, 10, 50, 200)
_CROWDS: Final = (20, 50, 100, 200, 500)
_FRAMES_EACH: Final = 2000
"""Approximate number of frames of a crowd in one measurement."""
_LOADS: Final = (0.2, 0.8)
"""G, of all senders together; arrivals are Poisson."""
_OCTETS: Final = 60
_FRAMES: Final = 50_000
"""Approximate number of frames offered in one measurement of speed."""
_REPEATS: Final = 5
"""Number of measurements, of which the median is reported."""
_ROBOTS: Final = 10
"""Robots in the comparison of channel assessments: random in a square, exponent 3, all at -10 dBm."""
_SIDES: Final = (3.0, 10.0, 20.0, 30.0)
"""Sides of the square, m."""
_PAIR_LOADS: Final = (0.1, 0.4)
_SECONDS: Final = 60
_DRAWS: Final = 10
"""Number of random sets of positions."""


_TEXT_BYTES: Final = (40, 90, 190, 390)
"""Bytes of knowledge in the packets of `authentication_cost`."""


def authentication_cost(text: int, tag: int) -> dict[str, float]:
    """Return sizes of a packet with this many bytes of knowledge and of tag, and its air time and CPU."""
    packet = KnowledgePacket("r1", Version(1, 1000), 0, ((0, (bytes(text),)),))
    authenticator = AesCcmAuthenticator(bytes(16), tag) if tag else None
    data = pack(packet, authenticator=authenticator)
    frames = Fragmenter(1).frames([data])
    checked = 0.0 if authenticator is None else _least_us(lambda: verified_packet(data, authenticator))
    return {
        "tag": tag,
        "packet": len(data),
        "frames": len(frames),
        "air time, ms": sum(airtime_us(len(frame)) for frame in frames) / 1000,
        "packing, µs": _least_us(lambda: pack(packet, authenticator=authenticator)),
        "verification, µs": checked,
    }


def _least_us(run: Callable[[], object]) -> float:
    return min(repeat(run, timer=time.process_time, number=500, repeat=20)) / 500 * 1e6


def measure(out: Path | None = None, data: Path | None = None, map_file: Path = _CORRIDOR) -> BenchmarkResult:
    """Measure the medium; with `out`, only draw the figures of docs/radio.md into that folder.

    `data`: results of ns-3, drawn as dots. `map_file`: floor of the crowds and of the last figure.
    """
    if out is not None:
        return draw(out, map_file, data)
    if data is not None:
        raise OptionError("--data: requires --out")
    plan, seeds = load_map(map_file), range(1, _REPEATS + 1)
    speeds = [
        {
            "senders": senders,
            "load": load,
            "medium": round(median(medium_speed(senders, load, seed) for seed in seeds)),
        }
        for senders in _SENDERS
        for load in _LOADS
    ]
    crowds = [
        {
            "robots": robots,
            "us": median(frame_cost(plan, robots, -(-_FRAMES_EACH // robots), seed) for seed in seeds),
        }
        for robots in _CROWDS
    ]
    costs = [_compare_assessments(side, load) for side in _SIDES for load in _PAIR_LOADS]
    tags = [authentication_cost(text, tag) for text in _TEXT_BYTES for tag in (0, *TAG_SIZES)]
    shown = (
        make_table(speeds, "medium only: frames on the air per CPU second"),
        make_table(
            [{"robots": one["robots"], "µs": f"{one['us']:.0f}"} for one in crowds],
            f"medium only, {PER_FLOOR} driving robots per copy of the floor: CPU time per frame",
        ),
        make_table(costs, "mean pair delivery, robots in a square", ".3g"),
        make_table(tags, "packets with tags of AES-CCM: bytes, frames of IEEE 802.15.4 and CPU", ".4g"),
    )
    figures = {"speeds": speeds, "crowds": crowds, "assessment": costs, "authentication": tags}
    return BenchmarkResult(figures, shown)


def medium_speed(senders: int, load: float, seed: int) -> float:
    """Return frames on the air per CPU second of the medium, all transceivers in range of one another."""
    losses = LossTable(np.full((senders + 1, senders + 1), 60.0))
    transceivers = [NS3.transceiver.numbered(address) for address in range(senders + 1)]
    medium = Medium(transceivers, losses, NS3.phy, seed=seed, watched=[senders])
    medium.place(losses.places)
    per_second = load * SECOND / airtime_ns(_OCTETS)
    for sender in range(senders):
        medium.offer(sender, PoissonTraffic(_OCTETS, per_second / senders))
    return 1.0 / _frame_s(medium, SECOND + round(_FRAMES / per_second * SECOND))


def _frame_s(medium: Medium, end_ns: int, step_ns: int | None = None) -> float:
    """Return the CPU time per frame from the first second to `end_ns`, s."""
    medium.run(SECOND)  # loads kernels and rows of losses, fills queues
    before = int(medium.counters()["sent"].sum())
    began = time.process_time()
    for until_ns in range(SECOND + step_ns, end_ns + 1, step_ns) if step_ns else [end_ns]:
        medium.run(until_ns)
    spent = time.process_time() - began
    return spent / (int(medium.counters()["sent"].sum()) - before)


def _compare_assessments(side: float, load: float) -> dict[str, float]:
    """Return the delivery ratios of pairs with textbook and with BEE-click clear channel assessment.

    Textbook: energy from 10 dB above the sensitivity, or while receiving. Firmware: energy from -69 dBm only
    (d3scomp/beeclickarm, MRF24J40.cpp, CCAEDTH and BBREG2). Everything else equals preset `ns3`, including
    positions and arrivals.
    """
    textbook = replace(NS3.transceiver, tx_power_dbm=-10.0)
    hardware = preset("beeclick").transceiver
    firmware = replace(textbook, cca=hardware.cca, cca_threshold_dbm=hardware.cca_threshold_dbm)
    means = [
        float(np.mean([_delivery(settings, side, load, draw) for draw in range(_DRAWS)]))
        for settings in (textbook, firmware)
    ]
    loss = (1 - means[1]) / (1 - means[0])
    return {"side": side, "load": load, "textbook": means[0], "firmware": means[1], "times_the_loss": loss}


def _delivery(settings: Transceiver, side: float, load: float, draw: int) -> float:
    """Return the share of sent frames that are received, mean over all pairs."""
    transceivers = [settings.numbered(address) for address in range(_ROBOTS)]
    medium = Medium(transceivers, IndoorPropagation(NS3.propagation), NS3.phy, seed=draw, watched=())
    medium.place(np.random.default_rng(draw).uniform(0.0, side, (_ROBOTS, 2)))
    for robot in range(_ROBOTS):
        medium.offer(robot, PoissonTraffic(_OCTETS, load * SECOND / airtime_ns(_OCTETS) / _ROBOTS))
    medium.run(_SECONDS * SECOND)
    heard, sent = medium.outcomes()[:, Outcome.HEARD].sum(), medium.counters()["sent"].sum()
    return float(heard / (sent * (_ROBOTS - 1)))
