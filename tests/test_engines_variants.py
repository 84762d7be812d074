"""Knobs and variants of engines are data: every knob names its documentation, every variant is a line of a file and runs."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gauss_bench.engines import DERIVED, FOREIGN, get
from gauss_bench.engines.base import Choice
from gauss_bench.engines.variants import OWN_SEARCH, VariantError, Variants, read_variants
from gauss_bench.linkage.load import load
from gauss_bench.runs.offers import offer
from tests.conftest import DATA, needs
from tests.engine_runs import by_gauss, ran, table_of_faults

GOOD = (DATA / "room" / "variants.toml").read_text(encoding="utf-8")


def made(folder: Path, text: str) -> Variants:
    (folder / "variants.toml").write_text(text)
    return read_variants(folder)


def test_a_line_is_a_variant_and_a_list_is_every_entry(tmp_path: Path) -> None:
    found = made(tmp_path, GOOD)
    assert found.settings["quick"] == {"mu": 1e-8, "rounds": 1, "pair": [1.0, 2.0], "remark": "for those in a hurry"}
    assert [*found.space] == [
        "plain",
        *("many/rk4/0.0001", "many/rk4/1e-06", "many/euler/0.0001", "many/euler/1e-06"),
        *("pairs/[1.0, 1.0]", "pairs/[2.0, 2.0]"),
    ]
    many = found.space["many/euler/1e-06"]
    assert (many.integrator, many.stabilization) == ("euler", "projection")
    assert (many.options["mu"], many.options["rounds"]) == (1e-6, 1)
    assert found.space["plain"].stabilization == "none"
    assert found.options("pairs/[2.0, 2.0]")["pair"] == [2.0, 2.0]
    assert found.options("default")["rounds"] == 20
    assert found.knobs["rounds"].source.startswith(OWN_SEARCH)
    with pytest.raises(KeyError, match="neither settings nor a variant"):
        found.options("many")


SOFT = GOOD.replace("rounds = 20,", 'soft = "the loops are springs of some stiffness", rounds = 20,')
SHORT = '[[unfinished]]\nrounds = 1\ncause = "one round is too few from a cold start"\n'


def test_what_is_inexact_is_declared_by_settings_and_found_in_their_variants(tmp_path: Path) -> None:
    found = made(tmp_path, SOFT + SHORT)
    soft = {"default", "plain", "pairs/[1.0, 1.0]", "pairs/[2.0, 2.0]"}
    assert dict(found.soft) == dict.fromkeys(soft, "the loops are springs of some stiffness")
    assert set(found.unfinished) == {name for name in found.space if name.startswith("many")}
    assert "soft" not in found.settings["default"]
    assert made(tmp_path, GOOD).soft == made(tmp_path, GOOD).unfinished == {}


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("the loops are springs of some stiffness", "so it is", r"settings\.default\.soft: gives no cause"),
        ("one round is too few from a cold start", "short", r"unfinished\.cause: gives no cause"),
    ],
)
def test_what_is_inexact_needs_a_cause(old: str, new: str, said: str, tmp_path: Path) -> None:
    assert old in SOFT + SHORT
    with pytest.raises(VariantError, match=said):
        made(tmp_path, (SOFT + SHORT).replace(old, new))


@pytest.mark.parametrize(("old", "new", "said"), table_of_faults("variants"))
def test_a_faulty_file_is_told_by_table_and_field(old: str, new: str, said: str, tmp_path: Path) -> None:
    assert old in GOOD
    with pytest.raises(VariantError, match=said) as error:
        made(tmp_path, GOOD.replace(old, new, 1))
    assert "variants.toml" in str(error.value)


def last_of_each_line(name: str) -> list[tuple[str, str]]:
    """The last variant of each line of an engine's file."""
    return [(name, x) for x in {variant.partition("/")[0]: variant for variant in offer(name).variants}.values()]


@pytest.mark.parametrize(("engine", "name"), [x for engine in (*DERIVED, *FOREIGN) for x in last_of_each_line(engine)])
def test_a_variant_can_be_chosen_by_name_and_moves_the_linkage_as_all_do(engine: str, name: str) -> None:
    needs("llvmlite" if engine in DERIVED else engine)
    mechanism, variant = load("four_bar", "torque"), offer(engine).variants[name]
    choice = offer(engine).choose(name, None, None, 1e-4)
    assert choice == Choice(name, variant.integrator, variant.stabilization, 1e-4)
    if variant.options.get("loop") == "compiled":
        pytest.skip("it takes minutes to build: tests/test_engines_pinocchio.py")
    assert get(engine).skip(mechanism, choice) is None
    end = ran(get(engine), mechanism, [0.0, 0.05], **vars(replace(choice, tolerance=1e-9))).q[-1]
    # the softest and least exact variants come this near; a wrong option moves nothing, or far
    assert np.abs(end - by_gauss(mechanism, [0.0, 0.05]).q[-1]).max() < 1e-3
