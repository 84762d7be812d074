"""Build `loop.cpp`, the compiled loop over time steps, against the headers and the library of Pinocchio's wheel, once per user.

The compilation takes about 75 s of processor time and 2.2 GB of memory. It is started by a search for settings, or by a user who
names settings that need the compiled loop, but never by a timed run. The compiled library is stored in the user's cache, under a
name that depends on its sources, flags, compiler and libraries.
"""

import fcntl
import hashlib
import platform
import resource
import shutil
import subprocess
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

from gauss_bench.compiler import user_cache
from gauss_bench.trajectory import RunFailure, Status, in_a_sentence

SOURCE = Path(__file__).parent / "loop.cpp"
# No -march: it changes the alignment of Eigen's objects, which are passed to a library that was built without it. The definitions
# are those of Pinocchio's own build targets.
DEFINED = "PINOCCHIO_ENABLE_TEMPLATE_INSTANTIATION BOOST_MPL_LIMIT_LIST_SIZE=30 BOOST_MPL_LIMIT_VECTOR_SIZE=30"
DEFINED += " BOOST_MPL_CFG_NO_PREPROCESSED_HEADERS BOOST_FUSION_INVOKE_MAX_ARITY=12 NDEBUG"
FLAGS = ("-std=c++17", "-O2", *(f"-D{x}" for x in DEFINED.split()), "-shared", "-fPIC", "-w")
COMPILERS = ("c++", "g++", "clang++")
LIBRARIES = ("pin", "libpinocchio", "cmeel-eigen", "cmeel-boost")
MEMORY = 3 << 30  # [bytes] memory limit of the compiler
LONGEST = 1800.0  # [s] time limit of the build, enough on a busy machine
NEEDED = {  # file that the compilation needs -> the message if it is missing
    "include/pinocchio/multibody.hpp": "the headers of Pinocchio's wheel are missing",
    "include/eigen3/Eigen/Core": "Eigen's headers are missing; pip install 'gauss-bench[pinocchio-compiled]'",
}
NOT_INSTALLED = "Pinocchio's compiled loop is not installed"
HOW = "gauss-bench simulate four_bar --engine pinocchio --settings 'compiled/rk4/least depth'"


def find_prefix() -> Path | None:
    """Return the folder with `include` and `lib` of the Pinocchio that Python imports; None if there is none."""
    module = find_spec("pinocchio")
    if module is None or not module.origin:
        return None
    return next((folder for folder in Path(module.origin).parents if (folder / "include").is_dir()), None)


def find_compiler() -> str | None:
    """Return the path of the first of COMPILERS that is installed; None if none is."""
    return next(filter(None, map(shutil.which, COMPILERS)), None)


def find_tools() -> tuple[str, Path]:
    """Return the path of a C++ compiler, and the folder with Pinocchio's `include` and `lib`; RunFailure if one is missing."""
    root, program = find_prefix(), find_compiler()
    if root is None:
        reason = "Pinocchio or its headers are missing; pip install 'gauss-bench[pinocchio]'"
        raise RunFailure(Status.SKIP, f"{NOT_INSTALLED}: {reason}")
    if program is None:
        raise RunFailure(Status.SKIP, f"{NOT_INSTALLED}: there is no C++ compiler ({', '.join(COMPILERS)})")
    for path, reason in NEEDED.items():
        if not (root / path).is_file():
            raise RunFailure(Status.SKIP, f"{NOT_INSTALLED}: {reason}")
    return program, root


def explain_missing() -> str | None:
    """Return the reason why `loop.cpp` cannot be built on this machine, or None if it can be."""
    try:
        find_tools()
    except RunFailure as failure:
        return str(failure)
    return None


def explain_absence() -> str | None:
    """Return a sentence which says that the compiled loop is not built yet and how to build it, or None if it is built."""
    if (user_cache.folder() / _cache_name()).is_file():
        return None
    return f"{NOT_INSTALLED}: it is not built yet; building it takes about 2 minutes: {HOW}"


def write_command(program: str, root: Path, source: Path, target: Path) -> list[str]:
    """Return the compiler's command line; `root` is the folder with Pinocchio's `include` and `lib`."""
    include, library = root / "include", root / "lib"
    paths = [f"-I{include}", f"-I{include / 'eigen3'}", f"-L{library}", "-lpinocchio_default", f"-Wl,-rpath,{library}"]
    return [program, *FLAGS, str(source), "-o", str(target), *paths]


def load_loop() -> bytes:
    """Return the content of the library that was built from `loop.cpp`, from the user's cache.

    Raises:
        RunFailure: the compiled loop cannot be built on this machine, or was not built yet.
    """
    content = user_cache.load(_cache_name())
    if content is None:
        raise RunFailure(Status.SKIP, explain_absence() or f"{NOT_INSTALLED}: its file in the cache is broken")
    return content


def build_loop() -> None:
    """Build the compiled loop and store it in the user's cache, unless it is there already."""
    name, folder = _cache_name(), user_cache.trusted_folder()
    if folder is None:
        raise RunFailure(Status.ERROR, f"{user_cache.folder()} is not this user's own: Pinocchio's compiled loop is not kept there")
    with (folder / "pinocchio-loop.lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)  # only one process at a time compiles; the system releases the lock when the process ends
        if user_cache.load(name) is None and not user_cache.store(name, _compile()):
            raise RunFailure(Status.ERROR, f"{folder}: Pinocchio's compiled loop cannot be kept there")


def _compile() -> bytes:
    """Compile `loop.cpp`, and return the content of the library.

    Raises:
        RunFailure: a tool is missing, or the compiler fails or takes too long.
    """
    program, root = find_tools()
    with TemporaryDirectory() as folder:
        target = Path(folder) / "loop.so"
        try:
            process = subprocess.run(
                write_command(program, root, SOURCE, target),
                capture_output=True,
                text=True,
                timeout=LONGEST,
                check=False,
                preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY)),
                cwd=folder,
                stdin=subprocess.DEVNULL,
            )
        except subprocess.TimeoutExpired as error:
            raise RunFailure(Status.ERROR, f"{program} did not finish Pinocchio's compiled loop in {LONGEST:.0f} s") from error
        if process.returncode:
            raise RunFailure(Status.ERROR, f"{program} refuses Pinocchio's compiled loop: {in_a_sentence(process.stderr)}")
        return target.read_bytes()


def _cache_name() -> str:
    """Return the name of the library in the cache, with a hash of its sources, flags, compiler and libraries."""
    program, root = find_tools()
    parts = [
        SOURCE.read_text(encoding="utf-8"),
        *write_command(program, root, Path(SOURCE.name), Path("loop.so")),  # the same wherever this package is installed
        platform.machine(),
        _describe_compiler(program),
        *map(_describe_package, LIBRARIES),
    ]
    return f"pinocchio-loop-{hashlib.sha256(chr(0).join(parts).encode()).hexdigest()[:32]}.so"


def _describe_package(package: str) -> str:
    """Return the name of a package, and its version if it is installed."""
    try:
        return f"{package} {version(package)}"
    except PackageNotFoundError:
        return package


@lru_cache
def _describe_compiler(program: str) -> str:
    """Return the name and version that a compiler prints."""
    return subprocess.run([program, "--version"], capture_output=True, text=True, timeout=60.0, check=False).stdout
