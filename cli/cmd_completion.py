"""``geomphys completion``: prints the shell completion script."""

from __future__ import annotations

import click
from click.shell_completion import get_completion_class

from .command import command


@command(
    "completion",
    examples="""
    geomphys completion bash >> ~/.bashrc
    geomphys completion zsh >> ~/.zshrc
    geomphys completion fish > ~/.config/fish/completions/geomphys.fish
    """,
)
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def completion(shell: str) -> None:
    """Print the completion script of SHELL; add it to the shell's start-up file."""
    from .main import cli

    maker = get_completion_class(shell)
    assert maker is not None
    click.echo(maker(cli, {}, "geomphys", "_GEOMPHYS_COMPLETE").source())
