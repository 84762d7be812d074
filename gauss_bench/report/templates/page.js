"use strict";
document.documentElement.classList.add("js");

// A click on a column's name sorts by it, a second one the other way; entries without a value stay at the end.
for (const button of document.querySelectorAll("th button")) {
  button.addEventListener("click", () => {
    const head = button.parentElement, body = head.closest("table").tBodies[0];
    const up = head.getAttribute("aria-sort") !== "ascending", column = head.cellIndex;
    for (const other of head.parentElement.cells) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", up ? "ascending" : "descending");
    const value = (row) => row.cells[column].dataset.sort;
    const compare = (a, b) => (isNaN(a) || isNaN(b) ? a.localeCompare(b) : a - b) * (up ? 1 : -1);
    const rows = [...body.rows].map((row) => [value(row), row]);
    rows.sort(([a], [b]) => (a === "" || b === "" ? (a === "") - (b === "") : compare(a, b)));
    body.append(...rows.map(([, row]) => row));
  });
}

// Long tables get a field that keeps only the rows with all the words typed.
for (const figure of document.querySelectorAll("figure[data-filter]")) {
  const input = document.createElement("input");
  input.className = "filter";
  input.type = "search";
  input.placeholder = "Keep rows with these words";
  input.setAttribute("aria-label", input.placeholder);
  input.addEventListener("input", () => {
    const words = input.value.toLowerCase().split(/\s+/).filter(Boolean);
    for (const row of figure.querySelectorAll("tbody tr")) {
      const text = [...row.cells].map((cell) => cell.textContent.toLowerCase()).join(" ");
      row.hidden = !words.every((word) => text.includes(word));
    }
  });
  figure.querySelector(".scroll").before(input);
}

// One linkage at a time; links into a linkage open it. Without this script all of them are shown.
const chapters = [...document.querySelectorAll(".chapter")], tabs = [...document.querySelectorAll(".tabs button")];
const open = (name) => {
  for (const chapter of chapters) chapter.hidden = chapter.id !== name;
  for (const tab of tabs) tab.setAttribute("aria-selected", String(tab.dataset.for === name));
};
const follow = () => {
  const target = document.getElementById(decodeURIComponent(location.hash.slice(1)));
  const chapter = target && target.closest(".chapter");
  if (chapter) {
    open(chapter.id);
    target.scrollIntoView();
  }
};
for (const tab of tabs) tab.addEventListener("click", () => open(tab.dataset.for));
if (chapters.length) open(chapters[0].id);
addEventListener("hashchange", follow);
follow();

// The contents mark what is being read.
const links = new Map([...document.querySelectorAll("nav li a")].map((a) => [a.getAttribute("href").slice(1), a]));
const seen = new IntersectionObserver((entries) => {
  for (const entry of entries) {
    const link = links.get(entry.target.id);
    if (link && entry.isIntersecting) {
      for (const other of links.values()) other.classList.remove("here");
      link.classList.add("here");
    }
  }
}, { rootMargin: "-10% 0px -80% 0px" });
for (const id of links.keys()) {
  const target = document.getElementById(id);
  if (target) seen.observe(target);
}
