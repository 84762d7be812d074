"""What the process of an engine sends back is data: it is judged on this side, by code that the engine cannot reach."""

import pickle
import struct

import numpy as np
import pytest

import gauss_bench
from gauss_bench.bench.measure import acceleration_errors
from gauss_bench.runs.apart import outcome_of
from gauss_bench.runs.one_run import receive, sampling
from gauss_bench.runs.worker import NoAnswer, pack_answer, unpack_answer
from gauss_bench.trajectory import Samples, Status
from tests.conftest import needs

FAULTY = "tests.faulty_engines"
EXPECTED = {"Judges": "invalid", "Pickles": "crashed", "Floods": "crashed", "Fine": "error"}


@pytest.mark.slow
def test_rows_are_judged_on_this_side_and_others_keep_their_judge(tmp_path, monkeypatch):
    monkeypatch.setenv("MARK", str(tmp_path / "mark"))  # where code that came through the pipe would leave a file
    expected = {f"{FAULTY}:{name}": status for name, status in EXPECTED.items()} | {"lagrange": "ok"}
    rows = gauss_bench.compare("four_bar", [*expected], steps=(1e-2,), t_end=0.1, jobs=1).set_index("engine")
    assert rows["status"].to_dict() == expected
    assert "from where it should be" in rows.loc[f"{FAULTY}:Judges", "message"]
    assert rows.loc[f"{FAULTY}:Judges", "position_error"] > 1e-2  # of the truth, and not of what the engine made of it
    assert not rows["valid"].fillna(value=False).drop("lagrange").any()
    assert not (tmp_path / "mark").exists()


def test_plain_data_comes_back_as_it_went():
    arrays = {"a": np.arange(6.0).reshape(2, 3), "c": np.array([True, False]), "none": np.zeros((0, 5)), "one": np.array(np.nan)}
    found = unpack_answer(pack_answer(arrays | {"b": [None, "text", 1.5, True], "d": {}}))
    assert (found.pop("b"), found.pop("d")) == ([None, "text", 1.5, True], {})
    assert found.keys() == arrays.keys()
    for key, array in arrays.items():
        np.testing.assert_array_equal(found[key], array, strict=True)
    for item in ({"x": object()}, np.array([object()])):
        with pytest.raises(NoAnswer):
            pack_answer(item)


def answer(text, more=b""):
    return struct.pack("<Q", len(text)) + text + more


def test_bytes_that_are_no_answer_are_refused():
    shapes = (b"[2]", b"[1000000000, 1000000000]", b"[-1]", b"[true]")
    arrays = [b'{"array of numbers": ["f", ' + x + b"]}" for x in shapes]
    arrays += [b'{"array of numbers": ["O", [1]]}', b'{"array of numbers": 7}']
    contents = [b"", b"abc", pickle.dumps(("ok", 1)), struct.pack("<Q", 1 << 62) + b"{}"]
    contents += [answer(x) for x in (b"not json", b"\xff", b"[" * 100_000)] + [answer(x, bytes(8)) for x in arrays]
    for content in contents:
        with pytest.raises(NoAnswer):
            unpack_answer(content)


TIMES = sampling(1e-2, 0.05)


def sent(**fields):
    """A sound answer of six samples of nine coordinates, but for some fields."""
    arrays = {key: np.zeros((6, 9)) for key in ("q", "v", "a")}
    trajectory = {"t": TIMES.times, "steps": 5, "evaluations": None, "note": ""} | arrays
    trajectory |= {k: x for k, x in fields.items() if k in trajectory}
    told = {"status": "ok", "message": "", "trajectory": trajectory, "answer": None, "seconds": 1.0, "build_time": 1.0}
    return told | {k: x for k, x in fields.items() if k in told}


EMPTY = np.zeros((0, 9))
SENT = [
    ({}, Status.OK),
    ({"q": np.zeros((6, 8))}, Status.INCOMPLETE),
    ({"v": np.zeros(54)}, Status.INCOMPLETE),
    ({"a": [[0.0] * 9] * 6}, Status.INCOMPLETE),
    ({"t": np.zeros(0), "q": EMPTY, "v": EMPTY, "a": EMPTY}, Status.INCOMPLETE),
    ({"q": np.full((6, 9), np.nan)}, Status.NAN),
    ({"v": np.full((6, 9), 1e200)}, Status.NAN),
    ({"steps": "many"}, Status.INCOMPLETE),
    ({"steps": 10**400}, Status.INCOMPLETE),
    ({"trajectory": None}, Status.INCOMPLETE),
    ({"status": "splendid"}, Status.ERROR),
    ({"message": 7}, Status.ERROR),
    ({"status": "nan"}, Status.NAN),
]


def test_an_answer_is_taken_for_no_more_than_it_is():
    for fields, status in SENT:
        run = receive(outcome_of(unpack_answer(pack_answer(sent(**fields)))), TIMES, 9)
        assert run.status is status, fields
        assert (run.trajectory is not None) is (status is Status.OK)
    for item in (None, 7, "ok", [], {}, {"status": "ok"}):
        assert receive(outcome_of(item), TIMES, 9).status in (Status.ERROR, Status.INCOMPLETE)


def test_accelerations_of_other_states_are_no_numbers():
    states = Samples(np.zeros(3), np.ones((3, 9)), np.ones((3, 9)), np.ones((3, 9)))
    assert acceleration_errors(states.a, states)["acceleration_error_median"] == 0.0
    for wrong in (None, np.ones((2, 9)), np.ones(27), "none", np.array(1.0)):
        assert np.isnan(acceleration_errors(wrong, states)["acceleration_error_median"])


@pytest.mark.parametrize("engine", ["gauss", "pinocchio", "exudyn"])
def test_simulate_shows_how_far_a_run_came(engine):
    """The squeezer, by steps that are far too long for it, at times that it reaches and at times that it does not."""
    needs({"gauss": "numpy"}.get(engine, engine))
    found = gauss_bench.simulate("squeezer", engine, step=2e-3, at=[0.01, 0.02, 0.03])
    assert found.status in (Status.NAN, Status.NOT_CONVERGED, Status.RANK_LOST)
    assert found.message
    assert found.metrics["until"] == found.t[-1] < 0.03
    assert all(len(x) == len(found.t) for state in found.links.values() for x in state.values())
