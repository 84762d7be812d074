"use strict";
// The first screen: what is required in, the cheapest passing setting of each engine out.
(() => {
  const { choices, positions, forces, engines, own, dots } = site.data, by = (id) => document.getElementById(id);
  const fields = ["linkage", "position", "force", "horizon"].map(by), [linkage, position, force, horizon] = fields;
  const answers = by("answers"), said = by("said");
  const element = (tag, css, text) => {
    const made = document.createElement(tag);
    if (css) made.className = css;
    if (text !== undefined) made.textContent = text;
    return made;
  };
  const engineName = (x) => (own.includes(x) ? `${x} (own)` : x);
  const digits = (x, n = 3) => Number(x.toPrecision(n)).toString();
  const length = (x) => (x == null ? "not measured" : x >= 1e-3 ? `${digits(1e3 * x, 2)} mm` : x >= 1e-6 ? `${digits(1e6 * x, 2)} µm` : `${digits(1e9 * x, 2)} nm`);
  const time = (x) => (x >= 1 ? `${digits(x)} s` : x >= 1e-3 ? `${digits(1e3 * x)} ms` : `${digits(1e6 * x)} µs`);
  const times = (x) => (x >= 100 ? x.toFixed(0) : x >= 10 ? x.toFixed(1) : x.toFixed(2));

  // A linkage's programs come with the first that is asked for.
  const programOf = async (name, index) => {
    const key = `programs of ${name}`;
    if (!site.data[key]) {
      await new Promise((done, failed) => {
        const script = document.createElement("script");
        script.src = `data/${choices[name].programs}.js`;
        script.addEventListener("load", done);
        script.addEventListener("error", failed);
        document.head.append(script);
      });
    }
    const { lines, texts } = site.data[key];
    return texts[index].map((i) => lines[i]).join("\n");
  };

  const fillHorizons = () => {
    const was = horizon.value;
    horizon.replaceChildren(...choices[linkage.value].horizons.map((h) => {
      const one = element("option", "", `${digits(h)} s`);
      one.value = h;
      return one;
    }));
    const there = [...horizon.options].map((x) => x.value);
    horizon.value = there.includes(was) ? was : there.at(-1);
  };

  const passing = (one, index, ratio, share) => {
    const line = element("li");
    const size = one.step != null ? `step ${digits(1e3 * one.step, 4)} ms` : one.tolerance != null ? `tolerance ${one.tolerance.toExponential(0)}` : "its own steps";
    const untimed = one.seconds == null;
    const cost = element("span", "ratio", untimed ? "not timed" : ratio === null ? time(one.seconds * share) : `${one.estimated ? "≈ " : ""}${times(ratio)} ×`);
    if (!untimed) cost.append(element("small", "", `${one.estimated ? "≈ " : ""}${time(one.seconds * share)}`));
    if (one.low != null) cost.append(element("small", "", `${time(one.low * share)} to ${time(one.high * share)}`));
    const name = element("a", "engine", engineName(one.engine)), what = element("div", "what", `${one.words}, ${size}`);
    name.href = engines[one.engine];
    name.style.setProperty("--dot", dots[one.engine]);
    what.append(element("span", "", `error ${length(one.position)}${one.force == null ? "" : `, joint forces ${one.force.toExponential(1)} N`}, ${one.steps == null ? "steps not counted" : `${digits(one.steps, 6)} steps`}`));
    const show = element("button", "", "Code");
    show.type = "button";
    show.setAttribute("aria-expanded", "false");
    show.setAttribute("aria-label", `Code for ${one.engine}`);
    show.addEventListener("click", async () => {
      const open = line.querySelector("pre");
      if (open) { open.remove(); line.querySelector(".copy").remove(); show.setAttribute("aria-expanded", "false"); return; }
      const program = await programOf(linkage.value, index);
      const text = element("pre", "", program), copy = element("button", "copy", "Copy");
      text.tabIndex = 0;
      copy.type = "button";
      copy.addEventListener("click", async () => { copy.textContent = (await copyText(program)) ? "Copied" : "Select the text and copy it"; });
      line.append(text, copy);
      show.setAttribute("aria-expanded", "true");
    });
    line.append(cost, name, what, show);
    return line;
  };

  const failing = (engine, words) => {
    const line = element("li", "no"), name = element("a", "engine", engineName(engine));
    name.href = engines[engine];
    name.style.setProperty("--dot", dots[engine]);
    line.append(element("span", "ratio", "–"), name, element("div", "what", words), element("span"));
    return line;
  };

  const show = () => {
    const one = choices[linkage.value], share = Number(horizon.value) / one.until;
    const asked = `${position.value},${force.value}`, picks = one.picks[asked];
    const lines = picks.map(([i, ratio]) => passing(one.settings[i], i, ratio, share));
    const place = Number(position.value) * forces.length + Number(force.value);
    for (const [engine, places] of Object.entries(one.none)) if (places[place] >= 0) lines.push(failing(engine, one.words[places[place]]));
    answers.replaceChildren(...lines);
    said.replaceChildren();
    const page = element("a", "", `All of ${linkage.value.replaceAll("_", " ")}`);
    page.href = one.page;
    const shorter = share < 1 ? ` Errors hold over ${digits(one.until)} s and so over the shorter run, where a cheaper setting might do.` : "";
    said.append(page, ` (scenario ${one.scenario}). × is the time over that of the fastest of all, whoever made it (first in the list); own: written by this suite's authors; ≈ follows from the time of a step raced at another size. Times are processor time of one thread, with the spread of their race (what it spans stands with its table).${shorter}`);
    document.documentElement.dataset.answered = `${linkage.value} ${position.value} ${force.value} ${horizon.value}`;
  };

  const ask = new URLSearchParams(location.hash.slice(1));
  for (const field of fields) if ([...field.options].some((x) => x.value === ask.get(field.id))) field.value = ask.get(field.id);
  fillHorizons();
  if ([...horizon.options].some((x) => x.value === ask.get("horizon"))) horizon.value = ask.get("horizon");
  for (const field of fields) {
    field.addEventListener("change", () => {
      if (field === linkage) fillHorizons();
      history.replaceState(null, "", `#${new URLSearchParams(fields.map((x) => [x.id, x.value]))}`);
      show();
    });
  }
  show();
})();
