"""The command `rig predict`: what a rig's images must look like, and whether its optics work."""

import sys

import click

from haptigraph.commands.help import examples

__all__ = ["rig_predict"]


@click.command("predict", epilog=examples("haptigraph rig predict rig/d405.toml"))
@click.argument("rig_file", metavar="RIG.TOML")
def rig_predict(rig_file: str) -> None:
    """Predict the registration of a rig from its design, with standard deviations, and check its optics.

    The deviations are those of rigs drawn from the tolerances. The exit code is 1 if the optics do not work:
    the camera is too near, the eye may be cut off, blurred or too small, or the mirror is.
    """
    from haptigraph.rig.description import load_rig
    from haptigraph.rig.optics import optical_checks
    from haptigraph.rig.prediction import predict
    from haptigraph.rig.report import prediction_lines

    prediction = predict(load_rig(rig_file))
    checks = optical_checks(prediction)
    for line in prediction_lines(prediction, checks):
        click.echo(line)
    if not all(check.is_met for check in checks):
        sys.exit(1)
