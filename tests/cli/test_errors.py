"""What every verb has in common: errors as JSON, help with an example."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import pytest

from tests.cli.running import run


def test_errors_are_json_where_results_are() -> None:
    found = run("simulate", "Oscilator", "--json")
    assert found.code == 2
    error = found.json["error"]
    assert error["code"] == "AC001"
    assert "Oscillator" in " ".join(error["evidence"])
    assert "AC001" in found.err  # for who looks on


def test_every_verb_shows_an_example_that_it_understands() -> None:
    """What stands behind `Example:` in a help names a verb, and options it has."""
    from typer.main import get_command

    from acausal.cli.main import app

    def verbs(name: str, command: Any) -> Iterator[tuple[str, Any]]:
        inner = getattr(command, "commands", None)
        if inner is None:
            yield name, command
        for word, below in (inner or {}).items():
            yield from verbs(f"{name} {word}", below)

    for name, command in verbs("acausal", get_command(app)):
        examples = re.findall(r"Examples?: (.*)", command.help)
        assert examples, name
        options = {o for p in command.params for o in (*p.opts, *p.secondary_opts)}
        for text in examples[0].split("; "):
            assert text.startswith(name), text
            assert {w for w in text.split() if re.match(r"--?[a-z]", w)} <= options, text


@pytest.mark.parametrize(
    ("arguments", "fact"),
    [
        (("doctor", "surplus"), "unexpected extra argument"),
        (("fit", "Oscillator"), "Missing argument"),
        (("simulate", "Oscillator", "--outptu", "x.mat"), "No such option: --outptu"),
        (("simulat", "Oscillator"), "No such command"),
    ],
)
def test_what_the_option_parser_refuses_is_data_too(arguments: tuple[str, ...], fact: str) -> None:
    """It was a frame of lines on stderr, and nothing on stdout."""
    found = run(*arguments, "--json")
    assert found.code == 2
    error = found.json["error"]
    assert error["code"] == "AC019"
    assert fact in error["fact"]
    assert error["help"].endswith("--help")
