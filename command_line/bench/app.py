"""All benchmarks under one command. What a benchmark needs is imported once it is known which one it is."""

import typer

from command_line.bench import foundations, hardware, localisation, navigation, radio, swarm, world

app = typer.Typer(
    help="Measure how fast and how true the parts are.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
)
for _command in (
    radio.radio_truth,
    radio.radio_speed,
    radio.radio_hardware,
    radio.radio_plots,
    world.scan,
    world.world,
    swarm.steps,
    swarm.swarm,
    swarm.growth,
    swarm.resume,
    swarm.recordings,
    swarm.relays,
    swarm.crowded_start,
    swarm.endings,
    swarm.branches,
    navigation.navigation,
    navigation.failures,
    navigation.causes,
    navigation.wedge,
    localisation.localisation,
    hardware.beeclick,
    hardware.kobuki,
    hardware.onboard,
    hardware.standstill,
    foundations.deeco,
    foundations.portable,
    foundations.processors,
    foundations.mutations,
    foundations.attacks,
):
    app.command(_command.__name__.replace("_", "-"))(_command)
app.command("map")(world.compare_map)
