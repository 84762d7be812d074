"""The verb `check-settings`: a file of settings by an engine's authors, checked before it is sent or raced."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gauss_bench.api.telling import Answer
from gauss_bench.engines.authors import read_settings


@dataclass(frozen=True)
class CheckedSetting:
    """A setting by an engine's authors.

    Attributes:
        settings: its text, as `simulate --settings` takes it.
        integrator, stabilization: names as the engine offers them.
        options: knob -> value, for every knob of the engine.
    """

    settings: str
    integrator: str
    stabilization: str
    options: dict[str, Any]


@dataclass(frozen=True)
class CheckedSettings:
    """A file of settings that has passed all checks.

    Attributes:
        engine: name; authors, contact, date: who owns the settings, how to reach them, and when they were written.
        most: the largest number of settings, which is that of the variants of the suite's own search.
        knobs: name -> address of its documentation.
        settings: name in the file -> setting.
    """

    engine: str
    authors: str
    contact: str
    date: str
    most: int
    knobs: dict[str, str]
    settings: dict[str, CheckedSetting]


def check_settings(file: Path) -> Answer[CheckedSettings]:
    """Check a file of settings by an engine's authors."""
    read = read_settings(file)
    settings = {name: CheckedSetting(x.name, x.integrator, x.stabilization, dict(x.options)) for name, x in read.candidates.items()}
    knobs = {name: x.source for name, x in read.knobs.items()}
    return Answer(CheckedSettings(read.engine, read.authors, read.contact, read.date, read.most, knobs, settings))
