"use strict";
// Shows the entries that contain every word of the search box; the search box of the documentation passes its words in the address.
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
