"""The second emitter, plain C by the host's own compiler, and narrower processors: both against the native code of this one."""

import ctypes
import platform
import subprocess

import numpy as np
import pytest

from gauss_bench.compiler.closure import compile_closure
from gauss_bench.compiler.kernel import compile_kernel
from gauss_bench.compiler.machine import native_code
from gauss_bench.engines.c_code import NO_COMPILER, compiler
from gauss_bench.linkage.load import load

pytest.importorskip("llvmlite")
compiled_c = pytest.mark.skipif(compiler() is None, reason=NO_COMPILER)
DOUBLES = np.ctypeslib.ndpointer(float, flags="C_CONTIGUOUS")


def library(kernel, folder, integrator="rk4"):
    source, target = folder / "kernel.c", folder / "kernel.so"
    source.write_text(kernel.c_source(integrator), encoding="utf-8")
    warnings = ["-Wall", "-Wextra", "-Werror", "-Wno-unused-parameter", "-Wno-unused-variable"]
    subprocess.run([str(compiler()), "-std=c99", "-O1", *warnings, "-shared", "-fPIC", source, "-o", target, "-lm"], check=True)
    return ctypes.CDLL(str(target))


def accelerated(c, t, q, v, p):
    out = np.full(len(q) + 1, np.nan)
    c.accelerate.argtypes = [DOUBLES] * 4
    return c.accelerate(np.append(q, v), p, np.array([t]), out), out[:-1]


def rolled(c, q, v, p, h, n):
    y, sample, report = np.append(q, v), np.full(2 * len(q), np.nan), np.zeros(3)
    c.rollout.argtypes = [*[DOUBLES] * 4, ctypes.c_double, ctypes.c_double, *[ctypes.c_long] * 3]
    return c.rollout(y, p, sample, report, h, 0.0, n, n, 1), sample, report


@compiled_c
@pytest.mark.parametrize(("stabilization", "integrator"), [("none", "semi_implicit_euler"), ("projection", "rk4")])
def test_code_in_c_computes_what_native_code_does(stabilization, integrator, tmp_path):
    m, h, n = load("crank_slider"), 1e-3, 100
    kernel = compile_kernel(m, "gauss", stabilization, open_parameters=("links.crank.mass",))
    p = np.array([0.37])  # as in the file
    c = library(kernel, tmp_path, integrator)
    code, a = accelerated(c, 0.0, m.q0, m.v0, p)
    assert code == 0
    np.testing.assert_allclose(a, kernel.acceleration(m.q0, m.v0), rtol=1e-12, atol=1e-11)  # rounding in another order
    code, found, report = rolled(c, m.q0, m.v0, p, h, n)
    assert code == 0
    assert report.tolist() == [n, 1, 0]
    wanted = kernel.rollout(m.q0, m.v0, h, n, parameters=p, integrator=integrator)
    np.testing.assert_allclose(found, np.concatenate(wanted), rtol=1e-11, atol=1e-11)  # rounding of 100 steps


@compiled_c
def test_a_guard_in_c_returns_one(tmp_path):
    """All bars of the parallelogram lie on one line: no partition serves there, and no step is taken."""
    mechanism = load("n_four_bar_1")
    kernel = compile_kernel(mechanism, "gauss")
    flat, rest = np.zeros(mechanism.n), np.zeros(mechanism.n)
    flat[0::3] = [0.5, 1.5, 1.0]
    c = library(kernel, tmp_path)
    assert accelerated(c, 0.0, flat, rest, np.zeros(1))[0] == 1
    code, _, report = rolled(c, flat, rest, np.zeros(1), 1e-3, 5)
    assert code == 1
    assert report[:2].tolist() == [0, 0]


X86 = pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="narrower x86 processors on another kind of host")
NARROW = {"SSE2": ("x86-64", "", 2), "AVX2": ("x86-64", "+avx,+avx2,+fma", 4)}


@pytest.mark.long("SSE2")
@pytest.mark.slow
@X86
@pytest.mark.parametrize("width", NARROW)
def test_a_narrower_processor_computes_the_same(width, monkeypatch):
    """Trajectories and accelerations to the bit; a turn, cut into as many parts as there are lanes, and long sums to rounding."""

    def results(name):
        m = load(name)
        kernel = compile_kernel(m, "gauss", cache=False)
        faster = m.v0 * np.linspace(0.9, 1.1, 5)[:, None]
        rolled = np.concatenate(kernel.rollout(np.tile(m.q0, (5, 1)), faster, 1e-4, 50), axis=-1)
        return [rolled, kernel.acceleration(m.q0, m.v0)]

    turn = compile_closure(load("four_bar")).turn(64)
    wide = {name: results(name) for name in ("four_bar", "n_four_bar_7")}
    cpu, features, lanes = NARROW[width]
    monkeypatch.setattr(native_code, "host", lambda: (cpu, features))
    assert native_code.best_lanes() == lanes
    for narrow, wanted in zip(results("four_bar"), wide["four_bar"], strict=True):
        np.testing.assert_array_equal(narrow, wanted)
    for narrow, wanted in zip(results("n_four_bar_7"), wide["n_four_bar_7"], strict=True):
        np.testing.assert_allclose(narrow, wanted, rtol=1e-12, atol=1e-12)
    again = compile_closure(load("four_bar")).turn(64)
    for narrow, wanted in zip((again.q, again.v, again.a), (turn.q, turn.v, turn.a), strict=True):
        np.testing.assert_allclose(narrow, wanted, rtol=1e-13, atol=1e-13)
