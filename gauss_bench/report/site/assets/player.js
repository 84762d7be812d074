"use strict";
// Turns a linkage by its crank, and plays two runs of it side by side.
(() => {
  const { turn, pair } = site.data, still = matchMedia("(prefers-reduced-motion: reduce)").matches;
  const STATES = turn.poses[0].length - 1, radians = Math.PI / 180;

  // Places every part of a drawing at a state, which may lie between two of them.
  const place = (stage, state) => {
    const s = ((state % STATES) + STATES) % STATES, i = Math.floor(s), share = s - i;
    const at = turn.poses.map((poses) => poses[i].map((x, k) => x + share * (poses[i + 1][k] - x)));
    for (const part of stage.querySelectorAll("[data-link]")) {
      const [x, y, angle] = at[part.dataset.link];
      if (part.dataset.x === undefined) {
        part.setAttribute("transform", `translate(${x.toFixed(2)} ${y.toFixed(2)}) rotate(${angle.toFixed(2)})`);
      } else {
        const c = Math.cos(angle * radians), s2 = Math.sin(angle * radians), u = +part.dataset.x, v = +part.dataset.y;
        part.setAttribute("transform", `translate(${(x + c * u - s2 * v).toFixed(2)} ${(y + s2 * u + c * v).toFixed(2)})`);
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
  playing(one, still ? 30 : 120, (angle) => {
    one.querySelector("output").textContent = `${Math.round(angle)}°`;
    place(one, ((angle * radians - turn.first) * turn.sense) / (2 * Math.PI) * STATES);
  });

  const two = document.getElementById("pair");
  if (!two || !pair) return;
  const choice = (name) => two.querySelector(`[data-run=${name}]`), factor = two.querySelector("[data-factor]");
  const between = (values, x) => {
    const i = Math.min(Math.floor(x), values.length - 2);
    return values[i] + (x - i) * (values[i + 1] - values[i]);
  };
  const again = playing(two, pair.times.length / Math.max(pair.times.at(-1), 4), (x) => {
    const truth = between(pair.truth, x);
    for (const side of ["a", "b"]) {
      const run = pair.runs[choice(side).value], error = between(run.error, x), stage = two.querySelector(`[data-side=${side}]`);
      place(stage, ((truth + factor.value * error - turn.first) * turn.sense) / (2 * Math.PI) * STATES);
      stage.querySelector("p").textContent = `${run.name}: crank off by ${error.toExponential(1)} rad, drawn ${Number(factor.value).toLocaleString("en")} times as much`;
    }
    two.querySelector("output").textContent = `${between(pair.times, x).toFixed(2)} s`;
  });
  two.addEventListener("change", again);
})();
