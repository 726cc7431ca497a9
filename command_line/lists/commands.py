"""`acrc list`: what there is to choose from."""

import typer

from command_line.options import Json

app = typer.Typer(no_args_is_help=True, rich_markup_mode=None)


@app.command()
def strategies(json: Json = False) -> None:
    """List strategies, also those of installed packages."""
    from command_line.lists.strategies import print_strategies

    print_strategies(json=json)


@app.command()
def presets(json: Json = False) -> None:
    """List presets of radio, localisation and navigation."""
    from command_line.lists.presets import print_presets

    print_presets(json=json)


@app.command()
def models(json: Json = False) -> None:
    """List shipped robot models and their range sensors."""
    from command_line.lists.files import print_models

    print_models(json=json)


@app.command()
def scenarios(json: Json = False) -> None:
    """List shipped scenarios."""
    from command_line.lists.files import print_scenarios

    print_scenarios(json=json)


@app.command()
def maps(json: Json = False) -> None:
    """List shipped floor plans and their sizes."""
    from command_line.lists.files import print_maps

    print_maps(json=json)
