"use strict";
// Code that all pages share: data that scripts store here, tables that sort and unfold, menus that close.
const site = { data: {}, put(values) { Object.assign(site.data, values); } };

// A click on the heading of a column sorts by the column, a second click in the other order; cells without a value come last.
for (const button of document.querySelectorAll("th button")) {
  button.addEventListener("click", () => {
    const head = button.parentElement, body = head.closest("table").tBodies[0], column = head.cellIndex;
    const up = head.getAttribute("aria-sort") !== "ascending";
    for (const other of head.parentElement.cells) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", up ? "ascending" : "descending");
    const hidden = [...body.rows].map((row) => row.hidden);
    const value = (row) => row.cells[column].dataset.sort ?? row.cells[column].textContent;
    const compare = (a, b) => (isNaN(a) || isNaN(b) ? a.localeCompare(b) : a - b) * (up ? 1 : -1);
    const rows = [...body.rows].map((row) => [value(row), row]);
    const lacks = (x) => /^-( |$)/.test(x); // a dash and its reason
    rows.sort(([a], [b]) => (lacks(a) || lacks(b) ? lacks(a) - lacks(b) : compare(a, b)));
    body.append(...rows.map(([, row]) => row));
    [...body.rows].forEach((row, i) => { row.hidden = hidden[i]; });
  });
}

for (const button of document.querySelectorAll("button.more")) {
  button.addEventListener("click", () => {
    for (const row of button.parentElement.querySelectorAll("tr[hidden]")) row.hidden = false;
    button.remove();
  });
}

const menus = document.querySelectorAll("details.menu");
const closeMenus = (except) => menus.forEach((menu) => { if (menu !== except) menu.open = false; });
for (const menu of menus) menu.addEventListener("toggle", () => { if (menu.open) closeMenus(menu); });
document.addEventListener("click", (event) => { if (!event.target.closest("details.menu")) closeMenus(null); });
document.addEventListener("keydown", (event) => { if (event.key === "Escape") closeMenus(null); });

// Copies a text to the clipboard, and returns whether that succeeded.
const copyText = async (text) => {
  try { await navigator.clipboard.writeText(text); return true; } catch { /* a page in a local folder may not do this: use a selection */ }
  const area = document.createElement("textarea");
  area.value = text;
  document.body.append(area);
  area.select();
  const done = document.execCommand("copy");
  area.remove();
  return done;
};
