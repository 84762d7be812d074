"""The command `check-settings`, which checks a file of settings that the authors of an engine contributed."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gauss_bench.api.telling import Answer
from gauss_bench.engines.authors import read_settings


@dataclass(frozen=True)
class CheckedSetting:
    """A setting that an engine's authors contributed.

    Attributes:
        settings: text of the setting, in the form that `simulate --settings` accepts.
        integrator, stabilization: names as the engine offers them.
        options: name of a knob (an option of the engine) -> value, for every knob of the engine.
    """

    settings: str
    integrator: str
    stabilization: str
    options: dict[str, Any]


@dataclass(frozen=True)
class CheckedSettings:
    """A file of settings that has passed all checks.

    Attributes:
        engine: name of the engine; authors, contact: owners of the settings, and their address; date: date of the file.
        most: largest number of settings, equal to the number of variants in the suite's own search.
        knobs: name of a knob (an option of the engine) -> address of the knob's documentation.
        settings: name of a setting in the file -> setting.
    """

    engine: str
    authors: str
    contact: str
    date: str
    most: int
    knobs: dict[str, str]
    settings: dict[str, CheckedSetting]


def check_settings(file: Path) -> Answer[CheckedSettings]:
    """Check a file of settings that the authors of an engine contributed; return the settings that it lists."""
    read = read_settings(file)  # read.most: the largest number of settings that the file may list
    settings = {name: CheckedSetting(x.name, x.integrator, x.stabilization, dict(x.options)) for name, x in read.candidates.items()}
    knobs = {name: x.source for name, x in read.knobs.items()}
    return Answer(CheckedSettings(read.engine, read.authors, read.contact, read.date, read.most, knobs, settings))
