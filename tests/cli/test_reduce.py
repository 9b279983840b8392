"""`acausal reduce` as a user types it."""

from __future__ import annotations

from tests.cli.running import run

MODEL = "ThickBlock"


def test_report() -> None:
    found = run("reduce", MODEL, "--outputs", "drill.s,drill.F_f", "--stop-time", "2s", "--repeat", "1")
    assert found.code == 0
    assert "spindle.phi: no output depends on it" in found.out
    assert "times as fast" in found.out


def test_json() -> None:
    found = run(
        *("reduce", MODEL, "--outputs", "drill.s", "--outputs", "drill.F_f", "--freeze", "zeros,drill.k"),
        *("--set", "m=6kg", "--no-compare", "--json"),
    )
    assert found.code == 0
    content = found.json
    assert content["states"]["after"] == ["slide.s", "slide.v", "drill.s_tar"]
    assert {"drill.k", "world.g"} <= {item["name"] for item in content["dropped"] if item["kind"] == "parameter"}
    assert content["after"]["states"] < content["before"]["states"]
    assert content["error"] is None


def test_outputs_may_stand_in_a_row() -> None:
    """`--outputs A B`, `--outputs A,B` and `--outputs A --outputs B` are one request."""
    found = run("reduce", MODEL, "--outputs", "drill.s", "drill.F_f", "--no-compare", "--json")
    assert found.code == 0
    assert found.json["outputs"] == ["drill.s", "drill.F_f"]
    assert run("reduce", MODEL, "drill.s").code == 2


def test_entries_of_arrays_hold_commas() -> None:
    found = run("reduce", MODEL, "--outputs", "body.frame_a.R[0,1],body.frame_a.r_0[2]", "--no-compare", "--json")
    assert found.code == 0
    assert found.json["outputs"] == ["body.frame_a.R[0,1]", "body.frame_a.r_0[2]"]


def test_what_is_wrong_with_names() -> None:
    wrong = run("reduce", MODEL, "--outputs", "drill.F_g")
    assert wrong.code == 2
    assert "drill.F_f" in wrong.err
    none = run("reduce", MODEL)
    assert none.code == 2
    assert "--outputs" in none.err
    frozen = run("reduce", MODEL, "--outputs", "drill.s", "--freeze", "drill.q")
    assert frozen.code == 2
    assert "AC020" in frozen.err


def test_contacts_that_leave_traces_are_not_reduced() -> None:
    # a drill that moves about may leave more holes than the equations of one structure have
    found = run("reduce", "HolesSideBySide", "--set", "n=3", "--outputs", "slide.s")
    assert found.code == 2
    assert "AC027" in found.err
    assert "drill - plate1 may leave several holes" in found.err


def test_messages_of_the_timed_runs_are_not_repeated() -> None:
    """Each model runs three times with --repeat 2; what a run says at its rest is said once for each model."""
    outcome = run("reduce", "BouncingBall", "--outputs", "h", "--repeat", "2")
    assert outcome.code == 0, outcome.err
    assert outcome.err.count("at rest from") <= 2


def test_a_wrong_time_is_an_error_and_no_failed_comparison() -> None:
    outcome = run("reduce", "Pendulum", "--outputs", "revolute.phi", "--stop-time", "-1")
    assert (outcome.code, "AC030" in outcome.err) == (2, True)
