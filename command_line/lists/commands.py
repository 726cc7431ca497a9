"""`acrc list`: what there is to choose from."""

import typer

from command_line.options import Json

app = typer.Typer(no_args_is_help=True, rich_markup_mode=None)


@app.command()
def strategies(json: Json = False) -> None:
    """What --strategy knows by name: shipped strategies, and those of installed packages."""
    from command_line.lists.strategies import print_strategies

    print_strategies(json=json)


@app.command()
def presets(json: Json = False) -> None:
    """What [radio], [localisation] and [navigation] of a scenario know as their preset."""
    from command_line.lists.presets import print_presets

    print_presets(json=json)


@app.command()
def models(json: Json = False) -> None:
    """The shipped robot models, with the range sensors that each can carry."""
    from command_line.lists.files import print_models

    print_models(json=json)


@app.command()
def scenarios(json: Json = False) -> None:
    """The shipped scenarios."""
    from command_line.lists.files import print_scenarios

    print_scenarios(json=json)


@app.command()
def maps(json: Json = False) -> None:
    """The shipped floor plans, and how large each is."""
    from command_line.lists.files import print_maps

    print_maps(json=json)
