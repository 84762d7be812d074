"""`gauss-bench engines` installs and removes environments, and leaves nothing if that fails or is interrupted.

Nothing is downloaded: pip gets a folder with one small wheel, or an index that never answers.
"""

import fcntl
import hashlib
import io
import os
import signal
import socket
import subprocess
import sys
import time
import zipfile

import pytest

from gauss_bench.cli import main
from gauss_bench.engines import ELSEWHERE, FILE, environment_of, home, installation, interpreter_in, read_environments
from tests.plugin import link_numpy
from tests.test_environments import STAND_IN

OWN = '# engines of mine\n[heun]  # a trial\nclass = "my_engine:Heun"\npython = "/home/me/heun/bin/python"\n'


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def engines(tmp_path, monkeypatch):
    """The user's file of engines; the folder for environments lies beside it."""
    path = tmp_path / "settings" / "engines.toml"
    path.parent.mkdir()
    path.write_text(OWN)
    monkeypatch.setenv(FILE, str(path))
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    monkeypatch.setattr("gauss_bench.runs.offers._known", {})
    return path


@pytest.fixture
def twin(tmp_path, monkeypatch):
    """The room of an engine that can be installed: `stand_in:Twin`, whose wheel pip finds in a folder.

    It has the name of DART, because worker processes have the engines of ELSEWHERE as they are.
    """
    links, room = tmp_path / "wheels", tmp_path / "rooms" / "dart"
    for folder in (links, room):
        folder.mkdir(parents=True)
    wheel = write_wheel(links, tmp_path)
    digest = hashlib.sha256(wheel.read_bytes()).hexdigest()
    (room / "requirements.txt").write_text(f"twin==1.0 --hash=sha256:{digest}\n")
    (room / "environment.toml").write_text(
        'library = "Twin 1.0"\nlicence = "none of anybody"\ndownload = 0.1\ninstalled = 0.2\npythons = "every Python"\n'
    )
    for name in ELSEWHERE.copy():
        monkeypatch.delitem(ELSEWHERE, name)
    monkeypatch.setitem(ELSEWHERE, "dart", "stand_in:Twin")
    monkeypatch.setattr(installation, "ROOMS", room.parent)
    for variable, value in {"PIP_NO_INDEX": "1", "PIP_FIND_LINKS": str(links), "PIP_CONFIG_FILE": os.devnull}.items():
        monkeypatch.setenv(variable, value)
    return room


def write_wheel(folder, tmp_path):
    """Write a wheel of the stand-in, which also makes the numpy of this environment importable, and that alone."""
    there = tmp_path / "numpy alone"
    there.mkdir()
    link_numpy(there)
    about = "twin-1.0.dist-info"
    files = {
        "stand_in.py": STAND_IN,
        "numpy_alone.pth": f"{there}\n",
        f"{about}/METADATA": "Metadata-Version: 2.1\nName: twin\nVersion: 1.0\n",
        f"{about}/WHEEL": "Wheel-Version: 1.0\nGenerator: a test\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
        f"{about}/RECORD": f"{about}/RECORD,,\n",
    }
    path = folder / "twin-1.0-py3-none-any.whl"
    with zipfile.ZipFile(path, "w") as wheel:
        for name, text in files.items():
            wheel.writestr(name, text)
    return path


def left():
    """Names of all that lies in the folder of environments."""
    return sorted(x.name for x in home().iterdir()) if home().exists() else []


@pytest.mark.slow
def test_an_engine_is_installed_used_and_removed_and_the_users_file_stays(engines, twin, capsys):
    text = OWN + '[dart]\nclass = "stand_in:Twin"\n'
    engines.write_text(text)
    assert main(["engines", "install", "dart", "--yes"]) == 0
    said = capsys.readouterr()
    assert "with numpy alone" in said.out
    for words in ("none of anybody", "0.1 MB to download", "Successfully installed twin-1.0"):
        assert words in said.err
    assert [*read_environments()] == ["heun", "dart"]
    assert left() == ["dart"]
    assert main(["engines", "install", "dart", "--yes"]) == 2
    assert "dart is installed" in capsys.readouterr().err
    assert main(["engines", "remove", "dart"]) == 0
    assert (engines.read_text(), left()) == (text, [])


@pytest.mark.slow
def test_an_installation_that_fails_leaves_nothing_and_says_why(engines, twin, capsys):
    requirements = twin / "requirements.txt"
    sound = requirements.read_text()
    for pins, said in (
        (sound, "dart was installed and cannot be used, so it was removed: not installed: No module named 'dartpy'"),
        (f"twin==1.0 --hash=sha256:{'0' * 64}\n", "Twin 1.0 cannot be installed (there are wheels for every"),
    ):
        requirements.write_text(pins)
        assert main(["engines", "install", "dart", "--yes"]) == 2
        assert capsys.readouterr().err.rpartition("error: ")[2].startswith(said)
        assert (engines.read_text(), left()) == (OWN, [])


@pytest.mark.long
@pytest.mark.parametrize(("end", "code"), [(signal.SIGINT, 130), (signal.SIGKILL, -signal.SIGKILL)])
def test_an_interrupted_installation_ends_pip_and_leaves_nothing_and_a_killed_one_nothing_after_the_next_call(
    end, code, engines, monkeypatch
):
    with socket.create_server(("127.0.0.1", 0)) as index:  # which accepts connections and never answers
        monkeypatch.setenv("PIP_INDEX_URL", f"http://127.0.0.1:{index.getsockname()[1]}/simple")
        monkeypatch.setenv("PIP_CONFIG_FILE", os.devnull)
        monkeypatch.delenv("PIP_FIND_LINKS", raising=False)
        index.settimeout(60.0)
        command = [sys.executable, "-m", "gauss_bench", "engines", "install", next(iter(ELSEWHERE)), "--yes"]
        with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
            connection, _ = index.accept()  # pip asks for the library
            with connection:
                assert connection.recv(1 << 16)
                assert left() != []
                process.send_signal(end)
                assert process.wait(30) == code
                if end is signal.SIGINT:
                    assert connection.recv(1) == b""  # pip has ended
    if end is signal.SIGKILL:
        assert left() != []
        time.sleep(1.0)  # until pip, whose connection is closed, has ended
        assert main(["engines"]) == 0
    assert (engines.read_text(), left()) == (OWN, [])


@pytest.mark.parametrize("step", ["run_program", "after"])
def test_an_interrupt_at_any_step_leaves_nothing(step, engines, twin, monkeypatch, capsys):
    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(installation, "run_program", lambda *_: None)
    if step != "after":
        monkeypatch.setattr(installation, step, interrupt)
    with pytest.raises(KeyboardInterrupt):
        installation.install("dart", interrupt, lambda _: None)
    assert (engines.read_text(), left()) == (OWN, [])


def test_what_killed_installations_left_is_removed(engines, twin, monkeypatch):
    hidden = home() / ".dart.part-x"
    hidden.mkdir(parents=True)  # of an installation that was killed before
    install_without_packages(monkeypatch)
    assert installation.is_installed_here("dart")
    assert left() == ["dart"]
    hidden.mkdir()
    assert main(["engines"]) == 0
    assert left() == ["dart"]


def test_an_environment_that_is_there_is_replaced(tmp_path, monkeypatch):
    monkeypatch.setattr(installation, "run_program", lambda *_: None)
    place = tmp_path / "dart"
    place.mkdir()
    (place / "half").touch()
    installation.make_environment(place, lambda folder: None, lambda _: None)
    assert ([x.name for x in tmp_path.iterdir()], (place / "half").exists()) == (["dart"], False)


def test_without_a_terminal_nothing_is_installed_unless_yes_is_given(engines, twin, monkeypatch, capsys):
    monkeypatch.setattr(sys, "stdin", io.StringIO("y\n"))
    assert main(["engines", "install", "dart"]) == 2
    assert "--yes installs without" in capsys.readouterr().err
    monkeypatch.setattr(sys, "stdin", Terminal("\n"))
    assert main(["engines", "install", "dart"]) == 1
    assert "none of anybody" in capsys.readouterr().err
    assert (engines.read_text(), left()) == (OWN, [])


def test_what_was_not_installed_here_is_neither_removed_nor_replaced(engines, twin, capsys):
    folder = home() / "dart"
    folder.mkdir(parents=True)
    (folder / "of mine").touch()
    assert main(["engines", "remove", "dart"]) == 2
    assert main(["engines", "install", "dart", "--yes"]) == 2
    assert "was not made by gauss-bench" in capsys.readouterr().err
    assert (folder / "of mine").exists()
    folder.rename(folder.with_name("elsewhere"))
    entry = OWN + '[dart]\npython = "/home/me/twin/bin/python"\n'
    engines.write_text(entry)
    assert main(["engines", "remove", "dart"]) == 2
    assert main(["engines", "install", "dart", "--yes"]) == 2
    assert str(engines) in capsys.readouterr().err
    assert (engines.read_text(), left()) == (entry, ["elsewhere"])


def test_an_installation_is_refused_beside_another_and_with_a_faulty_file_of_engines(engines, twin, monkeypatch, capsys):
    monkeypatch.setattr(installation, "run_program", lambda *_: pytest.fail("it began"))
    home().mkdir(parents=True)
    other = os.open(home(), os.O_RDONLY)
    try:
        fcntl.flock(other, fcntl.LOCK_EX)
        assert main(["engines", "install", "dart", "--yes"]) == 2
        assert "another process is installing" in capsys.readouterr().err
        assert main(["engines"]) == 0
    finally:
        os.close(other)


def install_without_packages(monkeypatch):
    """Make an environment of the engine without packages, and return its interpreter."""
    monkeypatch.setattr(installation, "run_program", lambda *_: None)
    installation.install("dart", lambda _: "", lambda _: None)
    return str(interpreter_in(home() / "dart"))


@pytest.mark.parametrize("before", ["", OWN, OWN + "[dart]\nmemory = 3\n", '[dart]\npython = "/p"\n' + OWN])
def test_an_installed_engine_is_found_by_its_folder_and_the_users_file_stays(before, engines, twin, monkeypatch):
    python = install_without_packages(monkeypatch)
    engines.write_text(before) if before else engines.unlink()
    found = environment_of("dart")
    own, limit = "/p" if '"/p"' in before else python, 3 << 30 if "memory" in before else 0
    assert (found.python, found.class_name, found.memory) == (own, "stand_in:Twin", limit)
    assert sorted(read_environments()) == (["dart", "heun"] if before else ["dart"])
    installation.remove("dart")
    assert (environment_of("dart") is not None, left()) == (own == "/p", [])
    assert (engines.read_text() if engines.exists() else "") == before


def test_a_table_that_an_earlier_version_entered_is_of_no_consequence(engines, twin, monkeypatch):
    for _ in range(2):
        python = install_without_packages(monkeypatch)
        engines.write_text(OWN + f'[dart]\nclass = "stand_in:Twin"\npython = "{python}"\n')
        assert installation.is_installed_here("dart")
        installation.remove("dart")
        assert [*read_environments()] == ["heun"]


def test_only_what_was_removed_is_left_out(engines, twin):
    """An environment of the user in the place where `install` would make one."""
    (home() / "dart").mkdir(parents=True)
    engines.write_text(f'[dart]\npython = "{interpreter_in(home() / "dart")}"\n')
    assert [*read_environments()] == ["dart"]
    assert not installation.is_installed_here("dart")
