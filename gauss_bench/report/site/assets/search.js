"use strict";
// Keeps the entries that have every word that is asked for, here or by the address: the documentation's box leads here.
(() => {
  const ask = document.getElementById("ask"), entries = [...document.querySelectorAll(".found li")];
  const narrow = () => {
    const words = ask.value.toLowerCase().split(/[\s_]+/).filter(Boolean);
    for (const entry of entries) {
      const text = `${entry.textContent} ${entry.firstElementChild.getAttribute("href")}`.toLowerCase();
      entry.hidden = !words.every((word) => text.includes(word));
    }
  };
  ask.addEventListener("input", narrow);
  ask.value = new URLSearchParams(location.search).get("ask") ?? ask.value;
  narrow();
})();
