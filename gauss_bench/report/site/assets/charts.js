"use strict";
// Draws every figure of the page, those in sight first, and takes lines away and brings them back.
(() => {
  const views = {}, CONFIG = site.data.config;
  const ready = () => { document.documentElement.dataset.drawn = "true"; };
  const kept = (chart, name) => {
    const box = document.querySelector(`.toggles[data-for="${CSS.escape(name)}"]`);
    if (!box) return chart.rows;
    const on = new Set([...box.querySelectorAll("input:checked")].map((x) => x.dataset.engine));
    return chart.rows.filter((row) => on.has(row.engine));
  };
  const draw = async (place) => {
    const name = place.dataset.chart, chart = site.data.charts[name];
    const spec = { ...chart.spec, config: CONFIG, data: { name: "rows", values: kept(chart, name) } };
    const made = await vegaEmbed(place, spec, { renderer: "svg", actions: false, mode: "vega-lite" });
    place.querySelector("svg").setAttribute("aria-hidden", "true"); // the figure around it has the description, and a table
    views[name] = made.view;
  };
  const places = [...document.querySelectorAll("[data-chart]")];
  const all = async () => {
    for (const place of places) {
      await draw(place);
      await new Promise((next) => setTimeout(next));
    }
    ready();
  };
  for (const box of document.querySelectorAll(".toggles")) {
    box.addEventListener("change", () => {
      const name = box.dataset.for;
      if (views[name]) views[name].remove("rows", () => true).insert("rows", kept(site.data.charts[name], name)).runAsync();
    });
  }
  all();
})();
