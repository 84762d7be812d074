"use strict";
// Draws every figure of the page, those in sight first, and takes lines away and brings them back.
(() => {
  const views = {}, CONFIG = site.data.config;
  const ready = () => { document.documentElement.dataset.drawn = "true"; };
  // The rows of a chart: what a sequence of them shares stands once, and each of its numbers in a column.
  const rows = (chart) => chart.rows ??= chart.lines.flatMap(({ same, columns }) => {
    const keys = Object.keys(columns);
    return keys.length ? columns[keys[0]].map((_, i) => Object.fromEntries([...Object.entries(same), ...keys.map((k) => [k, columns[k][i]])])) : [same];
  });
  const kept = (chart, name) => {
    const box = document.querySelector(`.toggles[data-for="${CSS.escape(name)}"]`);
    if (!box) return rows(chart);
    const on = new Set([...box.querySelectorAll("input:checked")].map((x) => x.dataset.engine));
    return rows(chart).filter((row) => on.has(row.engine));
  };
  // A narrow figure: fewer names beside each other.
  const NARROW = 480;
  const narrow = (spec) => {
    spec.config = { ...spec.config, legend: { ...spec.config.legend, columns: 2 } };
  };
  const draw = async (place) => {
    const name = place.dataset.chart, chart = site.data.charts[name];
    const spec = { ...chart.spec, config: CONFIG, data: { name: "rows", values: kept(chart, name) } };
    if (place.clientWidth < NARROW) narrow(spec);
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
      if (views[name]) views[name].data("rows", kept(site.data.charts[name], name)).runAsync();
    });
  }
  all();
})();
