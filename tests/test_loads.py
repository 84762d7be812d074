"""Loads of joints and drivers over a motion against Newton's laws by hand, and the tables that report them."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

import gauss_bench
from gauss_bench.cli import main

DATA = Path(__file__).parent / "data"
ARM = str(DATA / "excavator_arm.toml")
G = 9.81


def crank_slider_on_paper(t):
    """Forces [N] and torque [N m] of `crank_slider`, its crank turning once a second, by Newton for one body after another."""
    r, length, omega = 0.15, 0.56, 2 * np.pi
    crank_mass, rod_mass, slider_mass = 0.37, 0.77, 0.1
    theta = omega * t
    beta = -np.arcsin(r * np.sin(theta) / length)
    beta_1 = -r * np.cos(theta) * omega / (length * np.cos(beta))
    beta_2 = (r * np.sin(theta) * omega**2 + length * np.sin(beta) * beta_1**2) / (length * np.cos(beta))
    pin, arm = r * np.exp(1j * theta), length * np.exp(1j * beta)
    x, speed = (pin + arm).real, (1j * omega * pin + 1j * beta_1 * arm).real
    turning = 1j * beta_2 - beta_1**2
    slider = (-(omega**2) * pin + turning * arm).real
    # the pin B pulls the slider along the guide, beside the spring and its damper
    along = slider_mass * slider - (5.0 * (0.71 - x) - speed)
    # the rod about A: the moment of B on it, and of its weight, is what its inertia takes
    rod = -(omega**2) * pin + 0.5 * turning * arm
    euler = rod_mass * length**2 / 12 * beta_2 + (np.conj(arm / 2) * rod_mass * (rod + 1j * G)).imag
    across = -(euler - arm.imag * along) / arm.real
    at_b = along + 1j * across  # on the slider
    at_a = rod_mass * (rod + 1j * G) + at_b  # on the rod
    crank = -(omega**2) * pin / 2
    at_o = crank_mass * (crank + 1j * G) + at_a
    torque = (np.conj(pin / 2) * crank_mass * 1j * G).imag + (np.conj(pin) * at_a).imag
    return {
        "O.force": np.abs(at_o),
        "A.force": np.abs(at_a),
        "B.force": np.abs(at_b),
        "guide.normal": np.abs(slider_mass * G - across),
        "crank.torque": np.abs(torque),
    }


def test_loads_of_a_crank_slider_are_those_of_newton_on_paper():
    found = gauss_bench.kinematics("crank_slider", forces=True).loads
    times, fine = np.linspace(0.0, 1.0, 361), np.linspace(0.0, 1.0, 20001)
    samples, turn = crank_slider_on_paper(times), crank_slider_on_paper(fine)
    for name, size in samples.items():
        peak = found.peaks[name]
        assert peak.largest == pytest.approx(size.max(), rel=1e-9), name
        assert peak.t == times[size.argmax()], name
        assert peak.crank_deg == pytest.approx(np.degrees(2 * np.pi * peak.t), abs=1e-6)
        assert peak.mean == pytest.approx(turn[name].mean(), rel=2e-4), name
        assert peak.rms == pytest.approx(np.sqrt((turn[name] ** 2).mean()), rel=2e-4), name
    assert found.peaks["guide.moment"].largest == pytest.approx(0.0, abs=1e-9)  # its line passes through the pin
    assert (found.acting, found.until, found.determined) == (("gravity", "spring"), 1.0, True)


def test_what_is_held_carries_the_weight_beyond_it():
    """The arm stands still: held pins carry all beyond them, and held angles the moment about their pins."""
    still = "constant:joint=lift,start=1.2,speed=0"
    found = gauss_bench.kinematics(ARM, "drop", still, 2, hold=["T", "bucket"], forces=True)
    peaks = found.loads.peaks
    bucket, tooth, stick = 12.0, 1.5, 25.0
    assert peaks["T_held.force"].largest == pytest.approx((stick + bucket + tooth) * G, rel=1e-9)
    assert peaks["E.force"].largest == pytest.approx((bucket + tooth) * G, rel=1e-9)
    assert peaks["seam.force"].largest == pytest.approx(tooth * G, rel=1e-9)
    at = {name: complex(x["x"][0], x["y"][0]) for name, x in found.links.items()}
    turn = found.links["bucket"]["theta"][0]
    pin = at["bucket"] - np.hypot(0.3, 0.1) / 2 * np.exp(1j * (turn + np.arctan2(0.1, 0.3)))
    moment = G * (bucket * (at["bucket"] - pin).real + tooth * (at["tooth"] - pin).real)
    assert peaks["bucket.torque"].largest == pytest.approx(abs(moment), rel=1e-9)
    assert "pin_T" not in found.loads.acting, "a pin that is held does not turn: its damping exerts nothing"
    assert set(found.loads.acting) == {"gravity", "pin_E", "oil"}


def test_loads_are_taken_from_the_part_of_a_run_that_holds_all_checks():
    failing = gauss_bench.simulate("crank_slider", step=0.05, forces=True)
    assert not failing.valid
    assert failing.loads.until == failing.trusted_until
    assert failing.loads.peaks["B.force"].largest < 20.0
    assert failing.loads.until < failing.trajectory.t[-1]


def test_wrong_accelerations_give_no_loads(capsys):
    assert main(["simulate", "four_bar", "--engine", "yuan_ge_eq16", "--step", "1e-2", "--forces"]) == 1
    assert "loads: none, because no part of the run can be trusted" in capsys.readouterr().out


def test_redundant_rows_are_told_and_friction_with_them_is_refused(tmp_path, capsys):
    assert main(["kinematics", "parallelogram", "--forces", "--intervals", "4"]) == 0
    assert "loads of single joints are not determined" in capsys.readouterr().out
    text = Path(gauss_bench.load("parallelogram").source).read_text(encoding="utf-8")
    rubbing = '[forces.rubbing]\ntype = "coulomb_friction"\njoint = "A"\nmu = 0.1\nradius = 0.01\nspeed = 0.1\n\n[assembly]'
    path = tmp_path / "parallelogram.toml"
    path.write_text(text.replace("[assembly]", rubbing, 1).replace("forces   = []", 'forces   = ["rubbing"]', 1), encoding="utf-8")
    assert main(["kinematics", str(path), "--forces", "--out", str(tmp_path / "x.csv")]) == 2
    told = capsys.readouterr().err
    assert "parallelogram: the forces of this motion are not determined: redundant constraint rows (1)" in told
    assert not (tmp_path / "x.csv").exists()


def columns(path):
    heading, *rows = csv.reader(path.open(encoding="utf-8"))
    return {name: np.array([float(row[k] or "nan") for row in rows]) for k, name in enumerate(heading)}


def end_of(capsys, *arguments):
    assert main(["simulate", "four_bar", "--step", "1e-2", "--scenario", "driven", *arguments, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    return told["t"], told["metrics"]["until"]


def test_times_of_a_report_shorten_no_file_and_a_report_alone_runs_no_further(tmp_path, capsys):
    out = tmp_path / "run.csv"
    duration = gauss_bench.load("four_bar", "driven").duration
    assert end_of(capsys, "--at", "0.1,0.3") == ([0.1, 0.3], 0.3)  # nothing else is shown
    assert end_of(capsys, "--at", "0.1,0.3", "--out", str(out)) == ([0.1, 0.3], duration)
    assert columns(out)["t [s]"][-1] == duration
    assert end_of(capsys, "--at", "0.1,0.3", "--forces") == ([0.1, 0.3], duration)
    later = duration + 0.5
    assert end_of(capsys, "--at", f"0.1,{later}", "--out", str(out), "--replace") == ([0.1, later], later)
    assert columns(out)["t [s]"][-1] == later


def test_a_mean_over_time_does_not_count_crowded_samples_twice():
    even = gauss_bench.simulate("four_bar", scenario="driven", step=2e-3, forces=True).loads
    crowded = [*np.linspace(0.1, 0.102, 40)]
    uneven = gauss_bench.simulate("four_bar", scenario="driven", step=2e-3, at=crowded, forces=True).loads
    for name, peak in even.peaks.items():
        assert uneven.peaks[name].mean == pytest.approx(peak.mean, rel=1e-4), name


def test_a_driver_in_place_of_the_scenarios_own_leaves_its_forces_and_changes(tmp_path):
    path = tmp_path / "crank_slider.toml"
    text = (Path(gauss_bench.load("crank_slider").source)).read_text(encoding="utf-8")
    changed = text.replace('forces   = ["spring"]\n', 'forces   = ["spring"]\noverride.forces.spring.k = 50.0\n', 1)
    assert changed != text
    path.write_text(changed, encoding="utf-8")
    own = gauss_bench.kinematics(str(path), intervals=4, forces=True).loads
    replaced = gauss_bench.kinematics(str(path), driver=f"constant:speed={2 * np.pi}", intervals=4, forces=True).loads
    assert replaced.acting == own.acting == ("gravity", "spring")
    assert replaced.peaks["B.force"].largest == pytest.approx(own.peaks["B.force"].largest, rel=1e-9)
    assert own.peaks["B.force"].largest > 10.0  # 3.9 N with the weak spring
