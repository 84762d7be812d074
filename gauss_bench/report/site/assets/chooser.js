"use strict";
// The form of the first page: a reader chooses a requirement, and the page lists the cheapest setting of each engine that meets it.
(() => {
  const { choices, positions, forces, engines, own, dots } = site.data, by = (id) => document.getElementById(id);
  const fields = ["linkage", "position", "force", "horizon"].map(by), [linkage, position, force, horizon] = fields;
  const answers = by("answers"), note = by("said");
  const element = (tag, css, text) => {
    const node = document.createElement(tag);
    if (css) node.className = css;
    if (text !== undefined) node.textContent = text;
    return node;
  };
  const engineName = (x) => (own.includes(x) ? `${x} (own)` : x);
  const digits = (x, n = 3) => Number(x.toPrecision(n)).toString();
  const length = (x) => (x == null ? "not measured" : x >= 1e-3 ? `${digits(1e3 * x, 2)} mm` : x >= 1e-6 ? `${digits(1e6 * x, 2)} µm` : `${digits(1e9 * x, 2)} nm`);
  const time = (x) => (x >= 1 ? `${digits(x)} s` : x >= 1e-3 ? `${digits(1e3 * x)} ms` : `${digits(1e6 * x)} µs`);
  const times = (x) => (x >= 100 ? x.toFixed(0) : x >= 10 ? x.toFixed(1) : x.toFixed(2));

  // Loads the programs of a linkage when the first of them is needed, and returns one.
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
    const former = horizon.value;
    horizon.replaceChildren(...choices[linkage.value].horizons.map((h) => {
      const option = element("option", "", `${digits(h)} s`);
      option.value = h;
      return option;
    }));
    const offered = [...horizon.options].map((x) => x.value);
    horizon.value = offered.includes(former) ? former : offered.at(-1);
  };

  // Returns the line of a setting that meets the requirement; `share` is the chosen duration divided by that of the stored run.
  const passing = (setting, index, ratio, share) => {
    const line = element("li");
    const size = setting.step != null ? `step ${digits(1e3 * setting.step, 4)} ms` : setting.tolerance != null ? `tolerance ${setting.tolerance.toExponential(0)}` : "its own steps";
    const untimed = setting.seconds == null;
    const cost = element("span", "ratio", untimed ? "not timed" : ratio === null ? time(setting.seconds * share) : `${setting.estimated ? "≈ " : ""}${times(ratio)} ×`);
    if (!untimed) cost.append(element("small", "", `${setting.estimated ? "≈ " : ""}${time(setting.seconds * share)}`));
    if (setting.low != null) cost.append(element("small", "", `${time(setting.low * share)} to ${time(setting.high * share)}`));
    const name = element("a", "engine", engineName(setting.engine)), what = element("div", "what", `${setting.words}, ${size}`);
    name.href = engines[setting.engine];
    name.style.setProperty("--dot", dots[setting.engine]);
    what.append(element("span", "", `error ${length(setting.position)}${setting.force == null ? "" : `, joint forces ${setting.force.toExponential(1)} N`}, ${setting.steps == null ? "steps not counted" : `${digits(setting.steps, 6)} steps`}`));
    const show = element("button", "", "Code");
    show.type = "button";
    show.setAttribute("aria-expanded", "false");
    show.setAttribute("aria-label", `Code for ${setting.engine}`);
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

  // Returns the line of an engine without such a setting, with the reason.
  const failing = (engine, words) => {
    const line = element("li", "no"), name = element("a", "engine", engineName(engine));
    name.href = engines[engine];
    name.style.setProperty("--dot", dots[engine]);
    line.append(element("span", "ratio", "–"), name, element("div", "what", words), element("span"));
    return line;
  };

  const show = () => {
    const choice = choices[linkage.value], share = Number(horizon.value) / choice.until;
    const picks = choice.picks[`${position.value},${force.value}`];
    const lines = picks.map(([i, ratio]) => passing(choice.settings[i], i, ratio, share));
    const requirement = Number(position.value) * forces.length + Number(force.value); // its number
    for (const [engine, reasons] of Object.entries(choice.none)) {
      if (reasons[requirement] >= 0) lines.push(failing(engine, choice.words[reasons[requirement]]));
    }
    answers.replaceChildren(...lines);
    note.replaceChildren();
    const page = element("a", "", `All of ${linkage.value.replaceAll("_", " ")}`);
    page.href = choice.page;
    const shorter = share < 1 ? ` Errors are those of a run of ${digits(choice.until)} s; for the shorter run a cheaper setting may suffice.` : "";
    note.append(page, ` (scenario ${choice.scenario}). × is the time divided by that of the fastest engine, which is first in the list. Engines marked own are written by the authors of this suite. ≈ marks a time that is estimated from a race at another step. Times are processor time of one thread, with the range of their race.${shorter}`);
    document.documentElement.dataset.answered = `${linkage.value} ${position.value} ${force.value} ${horizon.value}`;
  };

  // The address may have a choice. The durations that are offered depend on the linkage, so they are filled in and chosen last.
  const stored = new URLSearchParams(location.hash.slice(1));
  const restore = (field) => {
    if ([...field.options].some((x) => x.value === stored.get(field.id))) field.value = stored.get(field.id);
  };
  fields.forEach(restore);
  fillHorizons();
  restore(horizon);
  for (const field of fields) {
    field.addEventListener("change", () => {
      if (field === linkage) fillHorizons();
      history.replaceState(null, "", `#${new URLSearchParams(fields.map((x) => [x.id, x.value]))}`);
      show();
    });
  }
  show();
})();
