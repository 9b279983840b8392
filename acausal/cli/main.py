"""The command `acausal`: one verb per file of the folders beside this one.

Heavy packages are not imported here or at the top of a verb, so that help and errors appear at once.
"""

from __future__ import annotations

import sys
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from acausal.cli.doctor import doctor
from acausal.cli.models.check import check
from acausal.cli.models.diagram import diagram
from acausal.cli.models.equations import equations
from acausal.cli.models.info import info
from acausal.cli.models.list import list_models
from acausal.cli.models.new import new
from acausal.cli.output.failure import as_error, exit_code, heed_termination, interrupted_code, interruption
from acausal.cli.output.report import record_error, say, show_error
from acausal.cli.results.animate import animate
from acausal.cli.results.compare import compare
from acausal.cli.results.explore import explore
from acausal.cli.results.plot import plot
from acausal.cli.run import progress as _progress  # noqa: F401  (the clock starts when it is loaded)
from acausal.cli.run.simulate import simulate
from acausal.cli.study.bench import bench
from acausal.cli.study.export import export
from acausal.cli.study.fit import fit
from acausal.cli.study.linearize import linearize
from acausal.cli.study.reduce import reduce
from acausal.cli.study.stability import stability
from acausal.cli.study.sweep import sweep
from acausal.errors import UsageError
from acausal.simulate.interrupt import Interruptible


class _Verbs(TyperGroup):
    """The group of verbs: it turns every exception into a message and an exit code."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        # accept --debug anywhere: after `acausal check M` has failed, people type `acausal check M --debug`
        options = args[: args.index("--")] if "--" in args else args
        ctx.meta["json"] = "--json" in options
        if "--debug" in options[1:]:
            args = ["--debug", *[a for a in options if a != "--debug"], *args[len(options) :]]
        return super().parse_args(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        """Run a verb."""
        heed_termination()
        try:
            with Interruptible():
                return super().invoke(ctx)
        except KeyboardInterrupt as stop:
            show_error(interruption(stop))
            raise typer.Exit(interrupted_code(stop)) from None
        except (RuntimeError, OSError) as error:
            # pass these on: typer's Exit and Abort are RuntimeErrors, and a closed pipe is not a defect
            if isinstance(error, typer.Exit | typer.Abort | BrokenPipeError):
                raise
            raise _ended(error, ctx) from error
        except Exception as error:
            # an error of the option parser, whichever package provides typer's
            message = getattr(error, "format_message", None)
            if message is not None and hasattr(error, "exit_code"):
                if ctx.meta.get("json"):
                    path = getattr(getattr(error, "ctx", None), "command_path", "acausal")
                    record_error(UsageError("AC019", message().rstrip("."), help=f"{path} --help"))
                raise
            raise _ended(error, ctx) from error


def _ended(error: Exception, ctx: Any) -> typer.Exit:
    shown = as_error(error)
    if ctx.params["debug"]:
        import traceback

        traceback.print_exception(error, file=sys.stderr)
    if ctx.meta.get("json"):
        record_error(shown)
    show_error(shown)
    return typer.Exit(exit_code(shown))


app = typer.Typer(
    name="acausal",
    cls=_Verbs,
    epilog="MODEL is a shipped model (acausal list), path/file.py:Class, path/file.py, or package.module:Class.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=True,
)


def _version(wanted: bool) -> None:
    if not wanted:
        return
    from importlib.metadata import PackageNotFoundError, version

    try:
        say(f"acausal {version('acausal')}")
    except PackageNotFoundError:
        say("acausal, not installed")
    raise typer.Exit()


@app.callback()
def main(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and exit.")
    ] = False,
    debug: Annotated[
        bool, typer.Option("--debug", envvar="ACAUSAL_DEBUG", help="Print the traceback of an error, too.")
    ] = False,
) -> None:
    """Equation-based modelling of physical systems: inspect, simulate, fit, optimise and export models."""


app.command(name="list")(list_models)
app.command()(info)
app.command()(new)
app.command()(check)
app.command()(simulate)
app.command()(plot)
app.command()(animate)
app.command()(diagram)
app.command()(explore)
app.command()(equations)
app.command()(bench)
app.command()(sweep)
app.command()(reduce)
app.command()(fit)
app.command()(linearize)
app.command()(stability)
app.add_typer(export, name="export")
app.command()(compare)
app.command()(doctor)
