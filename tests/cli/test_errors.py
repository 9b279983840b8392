"""What every verb has in common: errors as JSON, --quiet, help with an example."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
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


def _verbs() -> dict[str, Any]:
    """All verbs, those of `export` too, with what typer made of them."""
    from typer.main import get_command

    from acausal.cli.main import app

    def below(name: str, command: Any) -> Iterator[tuple[str, Any]]:
        inner = getattr(command, "commands", None)
        if inner is None:
            yield name, command
        for word, more in (inner or {}).items():
            yield from below(f"{name} {word}".strip(), more)

    return dict(below("", get_command(app)))


# Wrong in the way that each verb can be: mostly the name of a model, or of a file.
WRONG = {
    "list": ("list", "library", "electrcal"),
    "info": ("info", "Oscilator"),
    "new": ("new", "model.txt"),
    "check": ("check", "Oscilator"),
    "simulate": ("simulate", "Oscilator"),
    "plot": ("plot", "Oscilator.mat", "mass.s"),
    "animate": ("animate", "Oscilator"),
    "diagram": ("diagram", "Oscilator"),
    "explore": ("explore", "Oscilator.mat"),
    "equations": ("equations", "Oscilator"),
    "bench": ("bench", "Oscilator"),
    "sweep": ("sweep", "Oscilator", "--vary", "c=1,2"),
    "reduce": ("reduce", "Oscilator", "--outputs", "mass.s"),
    "fit": ("fit", "Oscilator", "measured.csv", "--free", "c"),
    "linearize": ("linearize", "Oscilator"),
    "stability": ("stability", "Oscilator"),
    "export casadi": ("export", "casadi", "Oscilator"),
    "export c": ("export", "c", "Oscilator"),
    "export step": ("export", "step", "Oscilator"),
    "compare": ("compare", "Oscilator.mat", "other.mat"),
    "doctor": ("doctor", "Oscilator"),
}


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (("diagram", "Oscilator"), "AC001"),
        (("diagram", "Oscillator", "-o", "o.png"), "AC013"),
        (("diagram", "Oscillator", "--open", "mass"), "AC020"),
        (("explore", "none.mat"), "AC014"),
        (("explore", "x.txt"), "AC013"),
        (("explore", "x.mat", "-o", "x.png"), "AC013"),
        (("animate", "Oscillator"), "AC083"),
        (("animate", "Pendulum", "-o", "p.png"), "AC013"),
        (("animate", "Pendulm"), "AC001"),
        (("animate", "missing.mat"), "AC014"),
    ],
)
def test_what_cannot_be_shown_is_refused(arguments: tuple[str, ...], code: str) -> None:
    outcome = run(*arguments)
    assert outcome.code == 2
    assert f"error[{code}]" in outcome.err


def test_every_verb_takes_json_and_quiet() -> None:
    """The same two options, from one definition; there are no exceptions."""
    found = {}
    for name, command in _verbs().items():
        options = {p.opts[0]: (tuple(p.opts), p.help) for p in command.params if p.param_type_name == "option"}
        found[name] = (options.get("--json"), options.get("--quiet"))
    assert all(all(pair) for pair in found.values()), found
    assert len(set(found.values())) == 1
    assert set(found) == set(WRONG)


@pytest.mark.parametrize("verb", WRONG)
def test_what_is_wrong_is_one_object_with_a_code(verb: str, folder: Path) -> None:
    done = run(*WRONG[verb], "--json", "--quiet")
    assert done.code == 2
    assert list(done.json) == ["error"]
    assert re.fullmatch(r"AC\d{3}", done.json["error"]["code"])
    assert done.json["error"]["code"] in done.err or verb == "doctor"  # the option parser has its own words
    assert list(folder.iterdir()) == []


# What prints a report, and what writes a file.
REPORTS = [
    ("list", "--search", "clutch"),
    ("info", "Resistor"),
    ("equations", "Oscillator"),
    ("reduce", "Oscillator", "--outputs", "mass.s", "--no-compare"),
    ("linearize", "Oscillator"),
    ("stability", "Oscillator", "--points", "2", "--no-check"),
    ("plot", "o.mat"),
]
PICTURES = [
    ("info", "Oscillator", "--spy", "spy.svg"),
    ("stability", "Oscillator", "--points", "2", "--no-check", "-o", "s.svg"),
]
SILENT = [
    ("check", "Oscillator"),
    ("doctor",),
    ("new", "mine.py"),
    ("export", "casadi", "Oscillator"),
    ("export", "c", "Oscillator"),
    ("export", "c", "Oscillator", "-o", "build"),
    ("export", "step", "Oscillator"),
    ("plot", "o.mat", "mass.s"),
    ("explore", "o.mat"),
    ("compare", "o.mat", "o.mat"),
]


@pytest.mark.parametrize(
    "arguments", [*REPORTS, *SILENT, *(pytest.param(p, marks=pytest.mark.slow) for p in PICTURES)], ids=" ".join
)
def test_quiet_leaves_what_was_asked_for_and_json_is_one_object(arguments: tuple[str, ...], folder: Path) -> None:
    if "o.mat" in arguments:
        assert run("simulate", "Oscillator", "-o", "o.mat", "--stop-time", "1s", "--quiet").err == ""
    quiet = run(*arguments, "--quiet")
    assert (quiet.code, quiet.err) == (0, "")
    assert bool(quiet.out) == (arguments not in SILENT)
    (folder / "mine.py").unlink(missing_ok=True)
    told = run(*arguments, "--json")
    assert (told.code, told.err) == (0, "")
    assert all((folder / file).exists() for file in told.json.get("files", ()))
    written = {str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file()} - {"o.mat"}
    assert written == set(told.json.get("files", ()))


def test_every_verb_shows_an_example_that_it_understands() -> None:
    """What stands behind `Example:` in a help names a verb, and options it has."""
    for verb, command in _verbs().items():
        name = f"acausal {verb}"
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
