"""Knobs and variants of engines are data: every knob names its documentation, every variant is a line of a file and runs.

An engine's own options are typed, known, and refused by name otherwise.
"""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gauss_bench
from gauss_bench.engines import COMPILED, DERIVED, FOREIGN, OWN, get
from gauss_bench.engines.base import Choice
from gauss_bench.engines.own_options import OptionError, OptionTable
from gauss_bench.engines.shared import LibraryEngine
from gauss_bench.engines.variants import OWN_SEARCH, VariantError, read_variants
from gauss_bench.linkage.load import load
from gauss_bench.runs.offers import ChoiceError, offer
from tests.conftest import DATA, needs
from tests.engine_runs import by_gauss, ran, table_of_faults

GOOD = (DATA / "room" / "variants.toml").read_text(encoding="utf-8")


def made(folder, text):
    (folder / "variants.toml").write_text(text)
    return read_variants(folder)


def test_a_line_is_a_variant_and_a_list_is_every_entry(tmp_path):
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


def test_an_adapter_may_still_name_the_content_of_its_file_with_a_warning(tmp_path):
    found = made(tmp_path, GOOD)
    with pytest.warns(DeprecationWarning, match="beside"):
        adapter = type("Adapter", (LibraryEngine,), {}, file=found)
    assert adapter.settings is found.settings


SOFT = GOOD.replace("rounds = 20,", 'soft = "the loops are springs of some stiffness", rounds = 20,')
SHORT = '[[unfinished]]\nrounds = 1\ncause = "one round is too few from a cold start"\n'


def test_what_is_inexact_is_declared_by_settings_and_found_in_their_variants(tmp_path):
    found = made(tmp_path, SOFT + SHORT)
    soft = {"default", "plain", "pairs/[1.0, 1.0]", "pairs/[2.0, 2.0]"}
    assert dict(found.soft) == dict.fromkeys(soft, "the loops are springs of some stiffness")
    assert set(found.unfinished) == {name for name in found.space if name.startswith("many")}
    assert "soft" not in found.settings["default"]
    assert made(tmp_path, GOOD).soft == made(tmp_path, GOOD).unfinished == {}


@pytest.mark.parametrize(("old", "new", "said"), table_of_faults("variants"))
def test_a_faulty_file_is_told_by_table_and_field(old, new, said, tmp_path):
    assert old in GOOD
    with pytest.raises(VariantError, match=said) as error:
        made(tmp_path, GOOD.replace(old, new, 1))
    assert "variants.toml" in str(error.value)


def last_of_each_line(name):
    """The last variant of each line of an engine's file."""
    return [(name, x) for x in {variant.partition("/")[0]: variant for variant in offer(name).variants}.values()]


@pytest.mark.parametrize(("engine", "name"), [x for engine in (*DERIVED, *FOREIGN) for x in last_of_each_line(engine)])
def test_a_variant_can_be_chosen_by_name_and_moves_the_linkage_as_all_do(engine, name):
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


# Options, one by one

KNOWN = OptionTable(
    {
        "usual": {"rounds": 20, "mu": 1e-8, "shut": True, "pair": [0.02, 1.0], "method": "Newton", "remark": "as shipped"},
        "quick": {"rounds": 1, "mu": 1e-8, "shut": True, "pair": [0.02, 1.0], "method": "CG", "remark": ""},
    },
    {"rounds": (), "mu": (), "shut": (), "pair": (), "method": ("PGS",)},
)


def test_options_change_what_they_name_and_nothing_else():
    usual = KNOWN.resolve("usual")
    assert KNOWN.resolve("rounds=3") == usual | {"rounds": 3}
    named = {"pair": [3.0, 1.0], "method": "PGS", "shut": False}
    assert KNOWN.resolve("quick, pair=[3, 1], method=PGS , shut=false") == KNOWN.resolve("quick") | named
    mu = KNOWN.resolve("mu=0")["mu"]
    assert (mu, type(mu)) == (0.0, float)


@pytest.mark.parametrize(("text", "said"), table_of_faults("options"))
def test_what_an_engine_does_not_know_is_refused_with_what_it_knows(text, said):
    with pytest.raises(OptionError, match=said):
        KNOWN.resolve(text)


@given(st.text("roundsmuhpair =,.[]{}\"'\n\\#0123456789-+_é", max_size=40))
def test_whatever_is_written_is_options_or_refused(text):
    try:
        found = KNOWN.resolve(text)
    except (OptionError, KeyError):
        return
    assert found.keys() == KNOWN.labels["usual"].keys()


@pytest.mark.parametrize("engine", [OWN[0], COMPILED[0]])
def test_a_tolerance_given_as_an_option_is_the_one_that_is_used(engine):
    if engine in COMPILED:
        needs("llvmlite")

    def count_evaluations(settings):
        run = gauss_bench.simulate("crank_slider", engine, settings=settings, integrator="dop853", step=0.1, at=[0.5])
        assert run.settings == settings
        return float(run.metrics["evaluations"])

    assert count_evaluations("dop853_rtol=1e-4,dop853_atol=1e-6") < 0.7 * count_evaluations("default")


def test_the_rate_of_baumgarte_given_as_an_option_closes_gaps_sooner():
    def drift(rate):
        settings = f"baumgarte_alpha_beta_per_s={rate}"
        run = gauss_bench.simulate("four_bar", "gauss", "conservative", settings, None, "baumgarte", 1e-2, [2.0])
        return float(run.metrics["position_drift"])

    assert drift("20") < 0.2 * drift("0")


def test_every_engine_with_options_takes_its_own_usual_values_by_name():
    for name in ("gauss", "mujoco", "pinocchio", "exudyn", "casadi", "minimal"):
        offered = offer(name)
        usual = next(iter(offered.settings.values()))
        for key in offered.options:
            offered.resolve_settings(f"{key}={json.dumps(usual[key])}")
        with pytest.raises(ChoiceError, match=f"{name}: no option 'nonsense'; there are {next(iter(offered.options))}="):
            offered.resolve_settings("nonsense=1")
