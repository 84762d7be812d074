"use strict";
// Turns the crank of a linkage, and plays two runs of the linkage side by side.
(() => {
  const { turn, pair } = site.data, still = matchMedia("(prefers-reduced-motion: reduce)").matches;
  const radians = Math.PI / 180;

  // Interpolates linearly in a list of numbers, or of lists of numbers, at the fractional index x; beyond the end, the last one.
  const interpolate = (values, x) => {
    const i = Math.max(Math.min(Math.floor(x), values.length - 2), 0), a = values[i], b = values[Math.min(i + 1, values.length - 1)];
    const share = Math.min(x - i, 1);
    return typeof a === "number" ? a + share * (b - a) : a.map((v, k) => v + share * (b[k] - v));
  };

  // Returns [x, y, angle] of every link at a crank angle [rad].
  const posesAt = (crank) => {
    const intervals = turn.poses[0].length - 1, s = ((crank - turn.first) * turn.sense) / (2 * Math.PI) * intervals;
    return turn.poses.map((poses) => interpolate(poses, ((s % intervals) + intervals) % intervals));
  };

  // Moves every part of a drawing to the pose of its link; parts with a place on the link stay upright.
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

  // Connects a slider with its button, which moves it by `perSecond` units in a second; returns a function that draws again.
  const connect = (player, perSecond, show) => {
    const slider = player.querySelector("input[type=range]"), button = player.querySelector("[data-play]");
    let frame = 0, last = 0, position = Number(slider.value);
    const step = (now) => {
      position += Math.min(now - last, 100) / 1000 * perSecond; // at most 100 ms, after a pause of the browser
      last = now;
      if (position > Number(slider.max)) position -= Number(slider.max);
      slider.value = position;
      show(position);
      frame = requestAnimationFrame(step);
    };
    const stop = () => { cancelAnimationFrame(frame); frame = 0; button.textContent = "Play"; };
    button.addEventListener("click", () => {
      if (frame) { stop(); return; }
      if (position >= Number(slider.max) - 1e-9) position = 0;
      button.textContent = "Pause";
      last = performance.now();
      frame = requestAnimationFrame(step);
    });
    slider.addEventListener("input", () => { stop(); position = Number(slider.value); show(position); });
    show(position);
    return () => show(position);
  };

  const single = document.getElementById("turn");
  if (single && turn) connect(single, still ? 30 : 120, (angle) => {
    single.querySelector("output").textContent = `${Math.round(angle)}°`;
    place(single, posesAt(angle * radians));
  });

  const double = document.getElementById("pair");
  if (!double || !pair) return;
  const choice = (name) => double.querySelector(`[data-run=${name}]`), factor = double.querySelector("[data-factor]");

  // Returns the poses of the links of a run at frame x, with its difference from the reference magnified f times: see site/playback.py.
  const magnify = (run, x, f) => {
    const add = (poses, shifts, times) => poses.map((pose, i) => interpolate(shifts[i], x).map((v, k) => pose[k] + times * v));
    if (!pair.crank) return add(pair.poses.map((poses) => interpolate(poses, x)), run.moved, f);
    const turned = posesAt(interpolate(pair.crank, x) + f * interpolate(run.ahead, x));
    const poses = run.rest ? add(turned, run.rest, 1) : turned;
    return run.gap ? add(poses, run.gap, f) : poses;
  };
  const millimetres = (x) => x >= 1e-3 && x < 1e4 ? `${Number(x.toPrecision(2))} mm` : `${x.toExponential(1)} mm`;
  const redraw = connect(double, pair.times.length / Math.max(pair.times.at(-1), 4), (x) => {
    for (const side of ["a", "b"]) {
      const run = pair.runs[choice(side).value], last = run.off.length - 1, frame = Math.min(x, last);
      const stage = double.querySelector(`[data-side=${side}]`);
      place(stage, magnify(run, frame, Number(factor.value)));
      const ended = last < x ? `, ended at ${pair.times[last].toFixed(2)} s` : "";
      stage.querySelector("p").textContent = `${run.name}: links are up to ${millimetres(interpolate(run.off, frame))} off the reference, and loops are open by up to ${millimetres(interpolate(run.open, frame))}${ended}`;
    }
    double.querySelector("output").textContent = `${interpolate(pair.times, x).toFixed(2)} s`;
  });
  double.addEventListener("change", redraw);
})();
