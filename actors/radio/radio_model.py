"""From a set-up to what a medium is made of: the preset as amended, the propagation, the Wi-Fi."""

from dataclasses import dataclass, replace
from functools import partial

from actors.bounds import check_range
from actors.floor.map_file import load_map
from actors.radio.medium.channel import Interferer
from actors.radio.presets import RadioParameters, preset
from actors.radio.propagation.indoor import IndoorPropagation, PropagationParameters
from actors.radio.propagation.interferers import Wifi
from actors.radio.propagation.materials import material
from actors.radio.propagation.walls import build
from actors.radio.radio_setup import RadioSetup
from actors.randomness import generator


@dataclass(frozen=True)
class RadioModel:
    """All that the medium of one run is made of, but for its transceivers' addresses."""

    parameters: RadioParameters
    """The preset, with what the set-up says instead."""
    propagation: IndoorPropagation
    interferers: tuple[Interferer, ...]


def radio_model(setup: RadioSetup) -> RadioModel:
    """What the set-up describes; AcrcError if a preset or material is unknown, or the map cannot be read."""
    parameters = _amended(setup)
    walls = parameters.propagation.walls
    material(walls)
    floor = build(load_map(setup.map), walls, setup.patches) if setup.map else None

    def propagation() -> IndoorPropagation:  # each keeps what it last saw
        return IndoorPropagation(parameters.propagation, floor, generator(setup.seed, "radio shadowing", ""))

    stations = tuple(
        Wifi(station, parameters.channel, propagation(), partial(generator, setup.seed, "Wi-Fi", str(number)))
        for number, station in enumerate(setup.wifi)
    )
    return RadioModel(parameters, propagation(), stations)


def _amended(setup: RadioSetup) -> RadioParameters:
    named = preset(setup.preset)
    channel = named.channel if setup.channel is None else setup.channel
    check_range("radio.channel", channel, 11, 26)
    return replace(named, channel=channel, propagation=_propagation(setup, named.propagation))


def _propagation(setup: RadioSetup, named: PropagationParameters) -> PropagationParameters:
    shadowing = named.shadowing
    if setup.shadowing_db is not None:
        shadowing = replace(shadowing, sigma_db=setup.shadowing_db)
    if setup.correlation_distance is not None:
        shadowing = replace(shadowing, correlation_distance=setup.correlation_distance)
    return replace(named, walls=setup.walls or named.walls, shadowing=shadowing)
