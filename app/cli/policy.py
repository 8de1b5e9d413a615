"""Options of `layflat policy`."""

from __future__ import annotations

from typing import Annotated

import typer

from layflat.app.cli.call import call
from layflat.app.cli.options import Debug, list_commands

policy_cli = typer.Typer(name="policy", help="Serve a policy to other programs.", rich_markup_mode=None)
policy_cli.callback(invoke_without_command=True)(list_commands)


@policy_cli.command()
def serve(
    policy: Annotated[str, typer.Argument(metavar="POLICY", show_default=False, help="As in `layflat evaluate`.")],
    host: Annotated[
        str | None, typer.Option(show_default="127.0.0.1", help="Address to listen on; 0.0.0.0: from other machines.")
    ] = None,
    port: Annotated[int | None, typer.Option(min=0, max=65535, show_default="8000", help="0 takes a free one.")] = None,
    debug: Debug = False,
) -> None:
    """Serve a policy by websocket, in the protocol of openpi's policy servers.

    `layflat evaluate ws://127.0.0.1:8000` grades it, as it does a server of another program.
    """
    call("commands.policy_server:serve_policy", locals(), simulator=False)
