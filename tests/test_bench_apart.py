"""What the process of an engine sends back is data: it is judged on this side, by code that the engine cannot reach."""

import pickle
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gauss_bench
from gauss_bench.bench.measure import acceleration_errors
from gauss_bench.runs.apart import outcome_of
from gauss_bench.runs.one_run import receive, sampling
from gauss_bench.runs.worker import NoAnswer, pack_answer, unpack_answer
from gauss_bench.trajectory import Samples, Status
from tests.conftest import needs
from tests.plugin import installed

PLUGIN = '''
import __main__ as answers  # the worker, which writes them
import pathlib
import pickle
import numpy as np
from gauss_bench import judge, metrics
from gauss_bench.bench import measure
from gauss_bench.runs import apart, one_run
from gauss_bench.engines.interpreted import Interpreted
from gauss_bench.trajectory import RunFailure, Trajectory


class Engine(Interpreted):
    """Stands still where it should move."""

    integrators = ("rk4",)
    stabilizations = ("none",)

    def __init__(self):
        super().__init__("gauss")
        self.name = type(self).__name__.lower()

    def build(self, mechanism, choice):
        model = Interpreted("gauss").build(mechanism, choice)
        read = model.read
        model.read = lambda: self.told(read())
        return model

    def told(self, x):
        return Trajectory(x.t, 0 * x.q + x.q[0], 0 * x.v, 0 * x.a, x.steps)


class Judges(Engine):
    """Makes all that it can reach say that the run is good."""

    def build(self, mechanism, choice):
        good = judge.Judgement()
        for room in (judge, measure):
            room.judge = lambda evidence: good
            room.examine = lambda *arguments: None
        judge.completeness = lambda *arguments: good
        metrics.state_errors = metrics.drift = lambda *arguments: None
        metrics.energy_error = lambda evaluator, x: (0 * x.t, 0.0)
        judge.OFF_DRIFT = judge.OFF_ENERGY = judge.OFF_MOTION = float("inf")
        return super().build(mechanism, choice)


class Sender:
    """In the place of what writes answers: it sends these bytes instead."""

    def __init__(self, content):
        self.content = content
        answers.json = answers.LENGTH = self

    def dumps(self, item, default):
        return self

    def encode(self):
        return self.content

    def pack(self, length):
        return b""


class Harms:
    def __reduce__(self):
        return pathlib.Path.touch, (pathlib.Path(MARK),)


class Pickles(Engine):
    def told(self, x):
        Sender(pickle.dumps(("ok", Harms())))
        return x


class Floods(Engine):
    def told(self, x):
        Sender(bytes(1 << 27))
        return x


class Fine(Engine):
    """Says that it failed well, and has nothing to show."""

    def told(self, x):
        raise RunFailure("ok", "all is well")

'''
NAMES = ("judges", "pickles", "floods", "fine")
EXPECTED = {"judges": "invalid", "pickles": "crashed", "floods": "crashed", "fine": "error", "lagrange": "ok"}


@pytest.fixture(scope="module")
def mark(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Where code that came through the pipe would leave a file; the engines above are installed meanwhile."""
    folder = tmp_path_factory.mktemp("plugin")
    environment = installed(folder, PLUGIN.replace("MARK", repr(str(folder / "mark"))), NAMES)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(folder))
        patch.setenv("PYTHONPATH", environment["PYTHONPATH"])
        yield folder / "mark"


@pytest.mark.slow
def test_rows_are_judged_on_this_side_and_others_keep_their_judge(mark: Path) -> None:
    rows = gauss_bench.compare("four_bar", [*NAMES, "lagrange"], steps=(1e-2,), t_end=0.1, jobs=1).set_index("engine")
    assert rows["status"].to_dict() == EXPECTED
    assert "from where it should be" in rows.loc["judges", "message"]
    assert rows.loc["judges", "position_error"] > 1e-2  # of the truth, and not of what the engine made of it
    assert not rows["valid"].fillna(value=False).drop("lagrange").any()
    assert not mark.exists()


def test_plain_data_comes_back_as_it_went() -> None:
    arrays = {"a": np.arange(6.0).reshape(2, 3), "c": np.array([True, False]), "none": np.zeros((0, 5)), "one": np.array(np.nan)}
    found = unpack_answer(pack_answer(arrays | {"b": [None, "text", 1.5, True], "d": {}}))
    assert (found.pop("b"), found.pop("d")) == ([None, "text", 1.5, True], {})
    assert found.keys() == arrays.keys()
    for key, array in arrays.items():
        np.testing.assert_array_equal(found[key], array, strict=True)
    for item in ({"x": object()}, np.array([object()])):
        with pytest.raises(NoAnswer):
            pack_answer(item)


def answer(text: bytes, more: bytes = b"") -> bytes:
    return struct.pack("<Q", len(text)) + text + more


def test_bytes_that_are_no_answer_are_refused() -> None:
    shapes = (b"[2]", b"[1000000000, 1000000000]", b"[-1]", b"[true]")
    arrays = [b'{"array of numbers": ["f", ' + x + b"]}" for x in shapes]
    arrays += [b'{"array of numbers": ["O", [1]]}', b'{"array of numbers": 7}']
    contents = [b"", b"abc", pickle.dumps(("ok", 1)), struct.pack("<Q", 1 << 62) + b"{}"]
    contents += [answer(x) for x in (b"not json", b"\xff", b"[" * 100_000)] + [answer(x, bytes(8)) for x in arrays]
    for content in contents:
        with pytest.raises(NoAnswer):
            unpack_answer(content)


TIMES = sampling(1e-2, 0.05)


def sent(**fields: Any) -> dict[str, Any]:
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


def test_an_answer_is_taken_for_no_more_than_it_is() -> None:
    for fields, status in SENT:
        run = receive(outcome_of(unpack_answer(pack_answer(sent(**fields)))), TIMES, 9)
        assert run.status is status, fields
        assert (run.trajectory is not None) is (status is Status.OK)
    for item in (None, 7, "ok", [], {}, {"status": "ok"}):
        assert receive(outcome_of(item), TIMES, 9).status in (Status.ERROR, Status.INCOMPLETE)


def test_accelerations_of_other_states_are_no_numbers() -> None:
    states = Samples(np.zeros(3), np.ones((3, 9)), np.ones((3, 9)), np.ones((3, 9)))
    assert acceleration_errors(states.a, states)["acceleration_error_median"] == 0.0
    for wrong in (None, np.ones((2, 9)), np.ones(27), "none", np.array(1.0)):
        assert np.isnan(acceleration_errors(wrong, states)["acceleration_error_median"])


@pytest.mark.parametrize("engine", ["gauss", "pinocchio", "exudyn"])
def test_simulate_shows_how_far_a_run_came(engine: str) -> None:
    """The squeezer, by steps that are far too long for it, at times that it reaches and at times that it does not."""
    needs({"gauss": "numpy"}.get(engine, engine))
    found = gauss_bench.simulate("squeezer", engine, step=2e-3, at=[0.01, 0.02, 0.03])
    assert found.status in (Status.NAN, Status.NOT_CONVERGED, Status.RANK_LOST)
    assert found.message
    assert found.metrics["until"] == found.t[-1] < 0.03
    assert all(len(x) == len(found.t) for state in found.links.values() for x in state.values())
