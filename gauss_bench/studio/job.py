"""Run a long job in its own process, and send results to the studio as lines of JSON on standard output.

The request arrives as a line of JSON on standard input, which the studio keeps open as long as it runs. When standard input is
closed, this process kills itself and all processes that it has started.
"""

import contextlib
import json
import os
import signal
import sys
import threading
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

Send = Callable[[dict[str, Any]], None]  # sends an event to the studio

FRAMES = 60  # number of poses that are sent for a second of motion
MOST = 3000  # largest number of poses of a motion that are sent


def release(request: Mapping[str, Any], send: Send) -> None:
    """Simulate a scenario of a file in one engine after the other.

    Send an event "release" with the poses for each engine, and an event "compared" for each motion after the first.
    """
    # imported here, because these modules take long to load
    from gauss_bench.api.simulate import simulate
    from gauss_bench.mechanism.coordinates import motion_of_links
    from gauss_bench.studio.motion import pose_motion

    first = None  # times, positions of the links and mechanism of the first motion
    for engine in request["engines"]:
        send({"event": "progress", "text": f"{engine} runs"})
        event: dict[str, Any] = {"event": "release", "engine": engine, "times": [], "poses": {}}
        at, step = [0.0, float(request["until"])], float(request["step"])
        try:
            result = simulate(request["path"], engine, request["scenario"], step=step, at=at, limit=request["limit"])
        except Exception as error:
            send(event | {"verdict": "error", "reason": str(error)})
            continue
        event |= {"verdict": str(result.status), "reason": result.message, "advice": result.advice, "step": result.step}
        event |= {"trusted_until": result.trusted_until}
        trajectory = result.trajectory
        if trajectory is None or not len(trajectory.t):
            send(event)
            continue
        frames = choose_frames(trajectory.t)
        send(event | {"times": trajectory.t[frames], "poses": pose_motion(result.model, trajectory.q[frames])})
        links = motion_of_links(result.model, trajectory)
        if first is None:
            first = links.t, links.q, result.model.whole
        else:
            send({"event": "compared", "compare": compare(engine, *first, links.t, links.q)})


def choose_frames(t: Any) -> Any:
    """Return the indices of the samples to send: about FRAMES samples per second of motion, at most about MOST, and the last one.

    Args:
        t: (k,) times of all samples [s].
    """
    interval = float(np.median(np.diff(t))) if len(t) > 1 else 1.0  # [s] between two samples
    every = max(1, round(1 / FRAMES / max(interval, 1e-9)), len(t) // MOST + 1)
    return np.unique(np.append(np.arange(0, len(t), every), len(t) - 1))


def compare(engine: str, t: Any, q: Any, whole: Any, other_t: Any, other_q: Any) -> dict[str, Any]:
    """Return the largest distance [m] of a link's centre of mass between two motions, over time; also its maximum with the link.

    Args:
        t, q: times (k,) and positions (k, n) of the links in the first motion.
        whole: the mechanism in which every link of the file is a body of its own.
        other_t, other_q: times (j,) and positions (j, n) of the links in the second motion.
    """
    times = t[t <= other_t[-1] + 1e-12]  # of the first motion, until the second motion ends
    rows = np.clip(np.searchsorted(other_t, times - 1e-9), 0, len(other_t) - 1)  # samples of the second motion at these times
    gaps = (q[: len(times)] - other_q[rows]).reshape(len(times), -1, 3)[..., :2]  # (times, links, x and y)
    distances = np.hypot(gaps[..., 0], gaps[..., 1])  # (times, links) [m]
    apart = distances.max(axis=1)
    k, every = int(apart.argmax()), max(1, len(times) // 500)  # the curve has about 500 points
    return {
        "engine": engine,
        "worst_apart": float(apart[k]),
        "at": float(times[k]),
        "point": f"centre of {whole.links[int(distances[k].argmax())].name}",
        "curve": {"times": times[::every], "apart": apart[::every]},
    }


def recommend(request: Mapping[str, Any], send: Send) -> None:
    """Search for each engine's cheapest setting that reaches an accuracy; send each answer when it is found, and all at the end."""
    from dataclasses import asdict

    from gauss_bench.advice.answer import Answer
    from gauss_bench.advice.truth import NoTruth
    from gauss_bench.api.recommend import recommend as find_setting
    from gauss_bench.api.recommend import setting_of

    def as_shown(x: Answer) -> dict[str, Any]:
        """Return the answer for one engine as the page shows it: with the setting in words, and with the answer's first error."""
        setting = setting_of(x) if x.step is not None or x.tolerance is not None else ""
        return asdict(x) | {"setting": setting, "error": next(iter(x.errors.values()), None)}

    try:
        recommendation = find_setting(
            request["path"],
            request.get("position"),
            request.get("angle"),
            request.get("force"),
            request.get("until"),
            request.get("engines") or None,
            scenario=request["scenario"],
            budget=request["budget"],
            told=lambda sentence: send({"event": "progress", "text": sentence}),
            better=lambda answer: send({"event": "recommend", "answer": as_shown(answer)}),
        )
    except NoTruth as error:
        send({"event": "failed", "text": f"nothing can be recommended: {error}"})
        return
    send({"event": "recommend", "answers": [as_shown(x) for x in recommendation.answers], "advice": recommendation.advice})


# key "work" of a request -> function that carries it out
WORK: dict[str, Callable[[Mapping[str, Any], Send], None]] = {"release": release, "recommend": recommend}


def _end_with_the_studio() -> None:
    """Wait for standard input to close, then kill this process and all processes that it has started."""
    with contextlib.suppress(OSError, ValueError):
        while os.read(0, 1):
            pass
    with contextlib.suppress(OSError):
        os.killpg(0, signal.SIGKILL)


def main() -> None:
    """Read one request, carry it out, and send an event "done", or "failed" with the reason."""
    from gauss_bench.api.telling import plain

    out = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # libraries then print to standard error, and do not disturb the lines of JSON

    def send(event: dict[str, Any]) -> None:
        """Write an event as a line of JSON."""
        out.write(json.dumps(plain(event), allow_nan=False) + "\n")
        out.flush()

    line = open(0, "rb", buffering=0, closefd=False).readline()  # without a buffer, because a thread reads the rest by os.read
    if not line.endswith(b"\n"):  # the studio has ended
        return
    threading.Thread(target=_end_with_the_studio, daemon=True).start()
    request = json.loads(line)
    try:
        WORK[request["work"]](request, send)
        send({"event": "done"})
    except Exception as error:
        send({"event": "failed", "text": str(error) or type(error).__name__})


if __name__ == "__main__":
    main()
    sys.stdout.flush()
    os._exit(0)
