"use strict";
// Turns a linkage by its crank, and plays two runs of it side by side.
(() => {
  const { turn, pair } = site.data, still = matchMedia("(prefers-reduced-motion: reduce)").matches;
  const radians = Math.PI / 180;

  // Between two values of a list, numbers or lists of numbers; beyond its end, its last one.
  const between = (values, x) => {
    const i = Math.max(Math.min(Math.floor(x), values.length - 2), 0), a = values[i], b = values[Math.min(i + 1, values.length - 1)];
    const share = Math.min(x - i, 1);
    return typeof a === "number" ? a + share * (b - a) : a.map((v, k) => v + share * (b[k] - v));
  };

  // [x, y, angle] of every link when the crank stands at an angle.
  const turned = (crank) => {
    const states = turn.poses[0].length - 1, s = ((crank - turn.first) * turn.sense) / (2 * Math.PI) * states;
    return turn.poses.map((poses) => between(poses, ((s % states) + states) % states));
  };

  const place = (stage, poses) => {
    for (const part of stage.querySelectorAll("[data-link]")) {
      const [x, y, angle] = poses[part.dataset.link];
      if (part.dataset.x === undefined) {
        part.setAttribute("transform", `translate(${x.toFixed(2)} ${y.toFixed(2)}) rotate(${angle.toFixed(2)})`);
      } else {
        const c = Math.cos(angle * radians), s = Math.sin(angle * radians), u = +part.dataset.x, v = +part.dataset.y;
        part.setAttribute("transform", `translate(${(x + c * u - s * v).toFixed(2)} ${(y + s * u + c * v).toFixed(2)})`);
      }
    }
  };

  // A slider with a button that moves it: `perSecond` units of it in a second.
  const playing = (player, perSecond, show) => {
    const slider = player.querySelector("input[type=range]"), button = player.querySelector("[data-play]");
    let frame = 0, last = 0, where = Number(slider.value);
    const step = (now) => {
      where += Math.min(now - last, 100) / 1000 * perSecond;
      last = now;
      if (where > Number(slider.max)) where -= Number(slider.max);
      slider.value = where;
      show(where);
      frame = requestAnimationFrame(step);
    };
    const stop = () => { cancelAnimationFrame(frame); frame = 0; button.textContent = "Play"; };
    button.addEventListener("click", () => {
      if (frame) { stop(); return; }
      if (where >= Number(slider.max) - 1e-9) where = 0;
      button.textContent = "Pause";
      last = performance.now();
      frame = requestAnimationFrame(step);
    });
    slider.addEventListener("input", () => { stop(); where = Number(slider.value); show(where); });
    show(where);
    return () => show(where);
  };

  const one = document.getElementById("turn");
  if (one && turn) playing(one, still ? 30 : 120, (angle) => {
    one.querySelector("output").textContent = `${Math.round(angle)}°`;
    place(one, turned(angle * radians));
  });

  const two = document.getElementById("pair");
  if (!two || !pair) return;
  const choice = (name) => two.querySelector(`[data-run=${name}]`), factor = two.querySelector("[data-factor]");

  // Where a run has its links at frame x, its difference from the true motion f times as large: see site/playback.py.
  const posed = (run, x, f) => {
    const added = (poses, more, times) => poses.map((pose, i) => between(more[i], x).map((v, k) => pose[k] + times * v));
    if (!pair.crank) return added(pair.poses.map((poses) => between(poses, x)), run.moved, f);
    const poses = turned(between(pair.crank, x) + f * between(run.ahead, x));
    const there = run.rest ? added(poses, run.rest, 1) : poses;
    return run.gap ? added(there, run.gap, f) : there;
  };
  const millimetres = (x) => x >= 1e-3 && x < 1e4 ? `${Number(x.toPrecision(2))} mm` : `${x.toExponential(1)} mm`;
  const again = playing(two, pair.times.length / Math.max(pair.times.at(-1), 4), (x) => {
    for (const side of ["a", "b"]) {
      const run = pair.runs[choice(side).value], last = run.off.length - 1, at = Math.min(x, last);
      const stage = two.querySelector(`[data-side=${side}]`);
      place(stage, posed(run, at, Number(factor.value)));
      const ended = last < x ? `, ended at ${pair.times[last].toFixed(2)} s` : "";
      stage.querySelector("p").textContent = `${run.name}: a link is ${millimetres(between(run.off, at))} off the true motion, one ${millimetres(between(run.open, at))} off closed loops${ended}`;
    }
    two.querySelector("output").textContent = `${between(pair.times, x).toFixed(2)} s`;
  });
  two.addEventListener("change", again);
})();
