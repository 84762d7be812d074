"""An engine's own options, one by one: typed, known, and refused by name otherwise."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

import gauss_bench
from gauss_bench.engines import COMPILED, OWN
from gauss_bench.engines.own_options import OptionError, OptionTable
from gauss_bench.runs.offers import ChoiceError, offer
from tests.conftest import needs
from tests.engine_runs import table_of_faults

KNOWN = OptionTable(
    {
        "usual": {"rounds": 20, "mu": 1e-8, "shut": True, "pair": [0.02, 1.0], "method": "Newton", "remark": "as shipped"},
        "quick": {"rounds": 1, "mu": 1e-8, "shut": True, "pair": [0.02, 1.0], "method": "CG", "remark": ""},
    },
    {"rounds": (), "mu": (), "shut": (), "pair": (), "method": ("PGS",)},
)


def test_options_change_what_they_name_and_nothing_else() -> None:
    usual = KNOWN.resolve("usual")
    assert KNOWN.resolve("rounds=3") == usual | {"rounds": 3}
    assert KNOWN.resolve("quick, pair=[3, 1], method=PGS , shut=false") == KNOWN.resolve("quick") | {
        "pair": [3.0, 1.0],
        "method": "PGS",
        "shut": False,
    }
    mu = KNOWN.resolve("mu=0")["mu"]
    assert (mu, type(mu)) == (0.0, float)


@pytest.mark.parametrize(("text", "said"), table_of_faults("options"))
def test_what_an_engine_does_not_know_is_refused_with_what_it_knows(text: str, said: str) -> None:
    with pytest.raises(OptionError, match=said):
        KNOWN.resolve(text)


@given(st.text("roundsmuhpair =,.[]{}\"'\n\\#0123456789-+_é", max_size=40))
def test_whatever_is_written_is_options_or_refused(text: str) -> None:
    try:
        found = KNOWN.resolve(text)
    except (OptionError, KeyError):
        return
    assert found.keys() == KNOWN.labels["usual"].keys()


@pytest.mark.parametrize("engine", [OWN[0], COMPILED[0]])
def test_a_tolerance_given_as_an_option_is_the_one_that_is_used(engine: str) -> None:
    if engine in COMPILED:
        needs("llvmlite")

    def count_evaluations(settings: str) -> float:
        run = gauss_bench.simulate("crank_slider", engine, settings=settings, integrator="dop853", step=0.1, at=[0.5])
        assert run.settings == settings
        return float(run.metrics["evaluations"])

    assert count_evaluations("dop853_rtol=1e-4,dop853_atol=1e-6") < 0.7 * count_evaluations("default")


def test_the_rate_of_baumgarte_given_as_an_option_closes_gaps_sooner() -> None:
    def drift(rate: str) -> float:
        settings = f"baumgarte_alpha_beta_per_s={rate}"
        run = gauss_bench.simulate("four_bar", "gauss", "conservative", settings, None, "baumgarte", 1e-2, [2.0])
        return float(run.metrics["position_drift"])

    assert drift("20") < 0.2 * drift("0")


def test_every_engine_with_options_takes_its_own_usual_values_by_name() -> None:
    for name in ("gauss", "mujoco", "pinocchio", "exudyn", "casadi", "minimal"):
        offered = offer(name)
        usual = next(iter(offered.settings.values()))
        for key in offered.options:
            offered.resolve_settings(f"{key}={json.dumps(usual[key])}")
        with pytest.raises(ChoiceError, match=f"{name}: no option 'nonsense'; there are {next(iter(offered.options))}="):
            offered.resolve_settings("nonsense=1")
