"""Write plots, animations and tables of a linkage, a run or a motion.

All contents are made before the first file is written, so that an error leaves no file.
"""

from collections.abc import Mapping
from pathlib import Path

from gauss_bench.api.history import history, table
from gauss_bench.api.kinematics import Kinematics
from gauss_bench.api.kinematics import table as motion_table
from gauss_bench.api.simulate import Simulation
from gauss_bench.api.telling import Answer, tell
from gauss_bench.atomic import write_bytes
from gauss_bench.mechanism.coordinates import motion_of_links
from gauss_bench.report.drawings.animation import animate
from gauss_bench.report.drawings.curves import draw_curves
from gauss_bench.report.drawings.drawing import draw
from gauss_bench.report.drawings.pose import pose_links
from gauss_bench.report.drawings.shown import encode_curves, encode_film
from gauss_bench.runs.offers import ChoiceError
from gauss_bench.verbs.catalogue import Description

Files = Mapping[str, Path]


def write(contents: Mapping[Path, str | bytes]) -> None:
    """Write files, each atomically, and print their paths."""
    for path, content in contents.items():
        write_bytes(path, content if isinstance(content, bytes) else content.encode())
        tell(f"{path}")


def draw_linkage(answer: Answer[Description], files: Files) -> None:
    """Draw the linkage of a description, with the paths of its observed points, into each of the files."""
    write({path: draw(*pose_links(answer.data.source)) for path in files.values()})


def draw_run(result: Simulation, files: Files) -> None:
    """Write the plot, the animation and the table of a run: `files` has the paths of the options "plot", "animate" and "out"."""
    if result.trajectory is None:
        tell("the run has no samples: no file is written")
        return
    shown, caption = history(result), result.told()
    contents: dict[Path, str | bytes] = {}
    for name, path in files.items():
        if name == "out":
            contents[path] = table(shown)
        elif name == "plot":
            contents[path] = encode_curves(path.suffix, caption, shown)
        else:
            links = motion_of_links(result.model, result.trajectory)
            contents[path] = encode_film(path.suffix, caption, shown, result.model.whole, links)
    write(contents)


def draw_motion(result: Kinematics, files: Files) -> None:
    """Write the plot, the animation and the table of a motion; if `out` is "csv", print the table."""
    whole, x, points = result.model.whole, result.trajectory, result.shown
    contents: dict[Path, str | bytes] = {}
    if "out" in files:  # this notice is printed in one release only, after which it is removed
        tell("columns of the table now name their units, as in `crank.theta [rad]`, formerly `crank.theta`")
    if "plot" in files and not points:
        raise ChoiceError("--plot: the file observes no point; name some with --point link.point")
    for name, path in files.items():
        if name == "plot":
            contents[path] = draw_curves(whole, x.t, x.q, x.v, x.a, points)
        elif name == "animate":
            contents[path] = animate(whole, x.t, x.q, points)
        elif path.suffix:  # the option `out` with the path of a file; the last branch is `--out csv`, for stdout
            contents[path] = motion_table(result).to_csv(index=False, lineterminator="\n")
        else:
            print(motion_table(result).to_csv(index=False, lineterminator="\n"), end="")
    write(contents)
