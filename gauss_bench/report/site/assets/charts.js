"use strict";
// Draws the figures of the page one after another, and hides and shows their lines when a reader toggles an engine.
(() => {
  const views = {}, CONFIG = site.data.config;
  // Returns the rows of a chart. An entry of `lines` stands for several rows: `same` has the values that they share, `columns` a list
  // of numbers for each key, one for each row.
  const unpackRows = (chart) => chart.rows ??= chart.lines.flatMap(({ same, columns }) => {
    const keys = Object.keys(columns);
    return keys.length ? columns[keys[0]].map((_, i) => Object.fromEntries([...Object.entries(same), ...keys.map((k) => [k, columns[k][i]])])) : [same];
  });
  // Returns the rows of the engines that the reader has not hidden.
  const visibleRows = (chart, name) => {
    const box = document.querySelector(`.toggles[data-for="${CSS.escape(name)}"]`);
    if (!box) return unpackRows(chart);
    const engines = new Set([...box.querySelectorAll("input:checked")].map((x) => x.dataset.engine));
    return unpackRows(chart).filter((row) => engines.has(row.engine));
  };
  const NARROW = 480; // [px] a narrower figure has a legend of two columns
  const narrow = (spec) => {
    spec.config = { ...spec.config, legend: { ...spec.config.legend, columns: 2 } };
  };
  const draw = async (place) => {
    const name = place.dataset.chart, chart = site.data.charts[name];
    const spec = { ...chart.spec, config: CONFIG, data: { name: "rows", values: visibleRows(chart, name) } };
    if (place.clientWidth < NARROW) narrow(spec);
    const embedded = await vegaEmbed(place, spec, { renderer: "svg", actions: false, mode: "vega-lite" });
    place.querySelector("svg").setAttribute("aria-hidden", "true"); // the figure around it has the description, and a table
    views[name] = embedded.view;
  };
  const places = [...document.querySelectorAll("[data-chart]")];
  const drawAll = async () => {
    for (const place of places) {
      await draw(place);
      await new Promise((next) => setTimeout(next)); // lets the browser react to the reader between two figures
    }
    document.documentElement.dataset.drawn = "true"; // tests wait for this mark
  };
  for (const box of document.querySelectorAll(".toggles")) {
    box.addEventListener("change", () => {
      const name = box.dataset.for;
      if (views[name]) views[name].data("rows", visibleRows(site.data.charts[name], name)).runAsync();
    });
  }
  drawAll();
})();
