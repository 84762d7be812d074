"""Imported models have MuJoCo's masses, forces and accelerations, and a model that is no planar linkage is refused by name."""

import tomllib
from pathlib import Path
from xml.etree.ElementTree import fromstring

import numpy as np
import pytest

from gauss_bench.api import exchange
from gauss_bench.cli import main
from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.engines.mujoco.compiled import DoesNotCompile, compile_document
from gauss_bench.exchange.errors import ExchangeError
from gauss_bench.exchange.from_mjcf import from_mjcf
from gauss_bench.exchange.imports import import_file
from gauss_bench.exchange.planar import find_plane, pair
from gauss_bench.exchange.safe_xml import read_xml, refuse_bulk
from gauss_bench.linkage.load import load_document
from tests.conftest import DATA
from tests.planar_models import random_model

mujoco = pytest.importorskip("mujoco")
UPRIGHT = DATA / "four_bar_xz.xml"
URDF, CLOSE = DATA / "four_bar.urdf", ["coupler.coupler_end=rocker.rocker_end"]
EXACT = 1e-12  # rounding of places in the world


def brought_in(text, folder, close=None):
    file = folder / "model.xml"
    file.write_text(text, encoding="utf-8")
    return load_document(tomllib.loads(import_file(file, "back", close or []).text))


def acceleration(mechanism):
    model = get("gauss").build(mechanism, Choice("default", "rk4"))
    return model.acceleration(0.0, mechanism.q0, mechanism.v0).reshape(-1, 3)


def flat_motion(text, back, file, rigid):
    """Return places (links, 2), velocities and accelerations (links, 3) of MuJoCo's bodies at the start, in the plane."""
    plane, model = find_plane(from_mjcf(read_xml(file), file)), mujoco.MjModel.from_xml_string(text)
    if rigid:
        model.opt.tolerance, model.opt.iterations = 0.0, 5
        model.eq_solimp[:] = [0.9999, 0.9999, 0.001, 0.5, 2.0]
        model.body_invweight0[:] *= 1e-6
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    mujoco.mj_rnePostConstraint(model, data)
    places, rates, seconds = list[list[float]](), list[list[float]](), list[list[float]]()
    for link in back.links:
        body, found = model.body(link.name).id, np.zeros((2, 6))
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, body, found[0], 0)
        mujoco.mj_objectAcceleration(model, data, mujoco.mjtObj.mjOBJ_BODY, body, found[1], 0)
        found[1, 3:] += model.opt.gravity  # which MuJoCo takes for an acceleration of the world
        places.append(pair(plane.project(data.xipos[body])))
        for levels, x in zip((rates, seconds), found, strict=True):
            levels.append([*pair(plane.project(x[3:])), x[:3] @ plane.normal])
    return np.array(places), np.array(rates), np.array(seconds)


@pytest.mark.parametrize("loops", [0, 1, 2])
@pytest.mark.parametrize("seed", range(5))
def test_random_planar_models_accelerate_as_in_mujoco(seed, loops, tmp_path):
    text = random_model(np.random.default_rng(1000 * loops + seed), loops)
    back = brought_in(text, tmp_path)
    places, rates, seconds = flat_motion(text, back, tmp_path / "model.xml", rigid=loops > 0)
    own = acceleration(back)
    assert np.abs(back.q0.reshape(-1, 3)[:, :2] - places).max() < 1e-11
    assert np.abs(back.v0.reshape(-1, 3) - rates).max() < 1e-11
    assert np.abs(own - seconds).max() < (1e-5 if loops else 1e-11) * max(1.0, np.abs(own).max())  # closures are nearly rigid


def model(joint='axis="0 0 1"', more="", after="", world=""):
    """Return a small document: a body on a joint, with more elements in that body, in the world, and after the world."""
    body = f'<body name="b" pos="0.3 0 0"><joint name="j" {joint}/><geom size="0.1" mass="1"/>{more}</body>'
    return f"<mujoco><worldbody>{body}{world}</worldbody>{after}</mujoco>"


REFUSED = tomllib.loads((DATA / "imports" / "refused.toml").read_text(encoding="utf-8"))
LARGE = {"too deep": "<mujoco>" + "<a>" * 200 + "</a>" * 200 + "</mujoco>", "too large": "<mujoco>" + " " * 5_000_000 + "</mujoco>"}


@pytest.mark.parametrize("what", REFUSED["mjcf"])
def test_what_is_no_planar_linkage_is_refused_with_element_and_reason(what, tmp_path):
    given = dict(REFUSED["mjcf"][what])
    words, text = given.pop("words"), given.pop("text", "")
    file = tmp_path / "model.xml"
    file.write_text(LARGE.get(what) or text or model(**given))
    with pytest.raises(ExchangeError) as caught:
        import_file(file, "back")
    said = str(caught.value)
    assert said.startswith(str(file))
    assert "\n" not in said
    for word in words:
        assert word in said, said


def test_welded_bodies_are_one_link(tmp_path):
    """The two welded bodies hang on different joints, and the weld locks the hinge of the first body."""
    text = """<mujoco><worldbody>
      <body name="post" pos="0 0 1"><geom size="0.1"/>
        <body name="a"><joint name="A" axis="0 1 0"/><geom size="0.05" pos="0.2 0 0" mass="1"/></body>
      </body>
      <body name="b" pos="0.3 0 1"><joint name="B" type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>
        <joint axis="0 1 0"/><geom size="0.05" mass="2"/></body>
      </worldbody><equality><weld body1="a" body2="b"/></equality></mujoco>"""
    back = brought_in(text, tmp_path)
    (link,) = back.links
    assert link.mass == pytest.approx(3.0)
    assert back.dof == 1
    own = 0.4 * 0.05**2 * 3.0
    assert link.inertia == pytest.approx(own + (2 / 3) * 0.1**2, rel=1e-9)


def test_names_of_any_kind_become_names(tmp_path):
    text = model(more='<site name="a &quot;b&#10;c"/><site name="a b c"/>').replace('"j"', '"= ] # &lt;"')
    back = brought_in(text.replace('name="b"', 'name="ground"'), tmp_path)
    assert [x.name for x in back.links] == ["ground_2"]
    assert back.dof == 1


def test_a_urdf_with_its_loop_closed(tmp_path):
    found = import_file(URDF, "back", CLOSE)
    back = load_document(tomllib.loads(found.text))
    assert found.kind == "URDF"
    assert back.dof == 1
    wanted = {"crank": (0.1, 0.00012), "coupler": (0.3, 0.0032), "rocker": (0.25, 0.0019)}
    assert {x.name: (x.mass, x.inertia) for x in back.links} == wanted
    assert back.gravity == pytest.approx([0.0, -9.81])
    assert len(back.joints) == 4
    crank = back.links[0]
    assert np.linalg.norm(crank.points["B"] - crank.points["A"]) == pytest.approx(0.12, rel=EXACT)
    for words in ("limits of joint B", "<visual>", "was open by"):
        assert any(words in x for x in found.left_out), words


@pytest.mark.parametrize("what", REFUSED["urdf"])
def test_what_a_urdf_may_not_have_is_refused(what, tmp_path):
    given, text, file = REFUSED["urdf"][what], URDF.read_text(), tmp_path / "model.urdf"
    assert given.get("old", "") in text
    file.write_text(text.replace(given.get("old", ""), given.get("new", ""), 1))
    with pytest.raises(ExchangeError) as caught:
        import_file(file, "back", given.get("close", CLOSE))
    for word in (str(file), *given["words"]):
        assert word in str(caught.value), str(caught.value)


SIZE, ASSET, SENSOR = "<mujoco>{}</mujoco>", "<mujoco><asset>{}</asset></mujoco>", "<mujoco><sensor>{}</sensor></mujoco>"
COPIES = "<mujoco><worldbody>{}</worldbody></mujoco>"
COPY = '<replicate count="{}"><body><joint axis="0 0 1"/><geom size="1"/></body></replicate>'
BULK = [  # where it stands, what is read, what is refused, and words of the refusal; a number is eight bytes: 2^24 are 128 MiB
    (ASSET, '<hfield nrow="4096" ncol="4096"/>', '<hfield nrow="4096" ncol="4097"/>', "16777216"),
    (ASSET, '<texture width="2048" height="4096"/>' * 2, '<texture width="2048" height="4096"/>' * 3, "16777216"),
    *((SIZE, f'<size {key}="{most}"/>', f'<size {key}="{beyond}"/>', f"m.xml: <size>: {key}='{beyond}' asks for")
      for key, most, beyond in (("memory", "128M", "129M"), ("memory", "131072k", "1G"), ("njmax", "1600", "1610"),
                                ("nconmax", "209000", "210000"), ("nstack", "16777216", "16777217"))),
    (SENSOR, '<contact num="16777216"/>', '<contact num="16777217"/>', "m.xml: <contact>: .* makes more than 16777216 numbers"),
    (SENSOR, '<camera resolution="4096 2"/>', '<camera resolution="4097 2"/>', "m.xml: <camera>: .* makes more"),
    (SENSOR, '<user dim="16777216"/>', '<user dim="16777217"/>', "m.xml: <user>: .* makes more than 16777216 numbers"),
    (COPIES, COPY.format(16665), COPY.format(16666), "more than 50000 elements"),  # three, and three for each of the copies
]  # fmt: skip


@pytest.mark.parametrize(("where", "most", "beyond", "words"), BULK)
def test_what_a_document_makes_is_bounded(where, most, beyond, words):
    refuse_bulk(fromstring(where.format(most)), Path("m.xml"))
    with pytest.raises(ExchangeError, match=words):
        refuse_bulk(fromstring(where.format(beyond)), Path("m.xml"))


@pytest.mark.parametrize("fault", [RuntimeError("Caught an unknown exception!"), MemoryError()])
def test_what_mujoco_cannot_name_is_a_refusal(fault, monkeypatch):
    def fail(_):
        raise fault

    monkeypatch.setattr(mujoco, "MjData", fail)
    with pytest.raises(DoesNotCompile, match="memory"):
        compile_document(model())


@pytest.mark.long
def test_a_hostile_file_ends_in_bounded_time(tmp_path, monkeypatch, capsys):
    """The worker is stopped if MuJoCo's compiler takes too long."""
    monkeypatch.setattr(exchange, "READING", 4.0)
    file = tmp_path / "model.xml"
    file.write_text(model(world='<replicate count="40000"><geom size="1"/></replicate>'))
    assert main(["import", str(file), "--out", str(tmp_path / "my.toml")]) == 2
    assert str(file) in capsys.readouterr().err
    assert not (tmp_path / "my.toml").exists()
