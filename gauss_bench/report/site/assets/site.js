"use strict";
// What pages share: data that scripts put here, tables that sort and unfold, menus that close.
const site = { data: {}, put(values) { Object.assign(site.data, values); } };

// A click on a column's name sorts by it, a second one the other way; entries without a value stay at the end.
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
const closeMenus = (but) => menus.forEach((menu) => { if (menu !== but) menu.open = false; });
for (const menu of menus) menu.addEventListener("toggle", () => { if (menu.open) closeMenus(menu); });
document.addEventListener("click", (event) => { if (!event.target.closest("details.menu")) closeMenus(null); });
document.addEventListener("keydown", (event) => { if (event.key === "Escape") closeMenus(null); });

// Text into the clipboard, also where a page from a folder may not use it directly.
const copyText = async (text) => {
  try { await navigator.clipboard.writeText(text); return true; } catch { /* try the old way */ }
  const area = document.createElement("textarea");
  area.value = text;
  document.body.append(area);
  area.select();
  const done = document.execCommand("copy");
  area.remove();
  return done;
};
