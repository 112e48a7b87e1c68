"""`omni-mj completion`: what makes a shell complete commands, options and names."""

import click

from omni_control.errors import OmniError

SHELLS = ("bash", "zsh", "fish")


@click.command("completion")
@click.argument("shell", type=click.Choice(SHELLS))
def command(shell: str) -> None:
    r"""Print the script that makes a shell complete commands, options and names.

    \b
    omni-mj completion bash >> ~/.bashrc
    omni-mj completion zsh >> ~/.zshrc
    omni-mj completion fish > ~/.config/fish/completions/omni-mj.fish
    """
    from click.shell_completion import get_completion_class

    from omni_mj.cli.main import cli

    kind = get_completion_class(shell)
    assert kind is not None, "click has all of them"
    try:
        script = kind(cli, {}, "omni-mj", "_OMNI_MJ_COMPLETE").source()
    except RuntimeError as error:  # bash is too old, or is not here
        raise OmniError(str(error)) from None
    print(script)
