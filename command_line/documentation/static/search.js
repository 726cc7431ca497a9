"use strict";
/* Search in the pages. PASSAGES of passages.js are [page, heading, address, text]; it is there on the search page only. */

const MOST = 40, BEFORE = 60, BEHIND = 170;
const field = document.getElementById("search-words") ?? document.querySelector(".sidebar-search");

/* How well a passage fits; 0 where one of the words is missing. */
function score([page, heading, , text], words) {
  const [inPage, inHeading, inText] = [page, heading, text].map(one => one.toLowerCase());
  let sum = 0;
  for (const word of words) {
    const times = inText.split(word).length - 1;
    const found = 20 * inHeading.includes(word) + 8 * inPage.includes(word) + Math.min(times, 5);
    if (!found) return 0;
    sum += found;
  }
  return sum + 10 * (words.length > 1 && inText.includes(words.join(" ")));
}

/* The text around the first word that is in it, in pieces; every second one is such a word. */
function excerpt(text, words) {
  const lower = text.toLowerCase();
  const at = Math.max(0, Math.min(...words.map(word => lower.indexOf(word)).filter(place => place >= 0)));
  const first = isFinite(at) ? at : 0;
  const begin = first > BEFORE ? text.indexOf(" ", first - BEFORE) + 1 : 0;
  const rest = text.slice(Math.min(begin, first));
  const shown = rest.length > BEHIND + BEFORE ? rest.slice(0, rest.lastIndexOf(" ", BEHIND + BEFORE)) + " …" : rest;
  const any = words.map(word => word.replace(/[.*+?^${}()|[\]\\]/g, "\\$&")).join("|");
  return ((begin ? "… " : "") + shown).split(new RegExp(`(${any})`, "i"));
}

function element(name, ...parts) {
  const made = document.createElement(name);
  made.append(...parts);
  return made;
}

function marked(pieces) {
  return pieces.map((piece, place) => place % 2 ? element("mark", piece) : piece);
}

function row([page, heading, address, text], words) {
  const link = element("a", heading === page ? page : `${page} / ${heading}`);
  link.href = address;
  return element("li", link, element("p", ...marked(excerpt(text, words))));
}

function search() {
  const words = field.value.toLowerCase().split(/\s+/).filter(Boolean);
  const found = words.length ? PASSAGES.map(one => [score(one, words), one]).filter(([much]) => much) : [];
  found.sort(([one], [other]) => other - one);
  document.getElementById("search-found").replaceChildren(...found.slice(0, MOST).map(([, one]) => row(one, words)));
  const many = found.length > MOST ? `the best ${MOST} of ${found.length} places` : `${found.length} places`;
  document.getElementById("search-count").textContent = words.length ? found.length === 1 ? "1 place" : many : "";
}

/* Arrows go through what was found, Enter opens the best, Escape goes back to the words. */
function go(event) {
  const stops = [field, ...document.querySelectorAll("#search-found a")];
  const here = stops.indexOf(document.activeElement);
  const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
  if (here >= 0 && step) stops[Math.max(0, Math.min(stops.length - 1, here + step))].focus();
  else if (here > 0 && event.key === "Escape") field.focus();
  else if (here === 0 && event.key === "Enter" && stops[1]) stops[1].click();
  else return;
  event.preventDefault();
}

document.addEventListener("keydown", event => {
  if (event.key === "/" && !event.target.closest("input, textarea")) {
    event.preventDefault();
    field?.focus();
  }
});

if (typeof PASSAGES !== "undefined") {
  field.value = new URLSearchParams(location.search).get("q") ?? "";
  field.addEventListener("input", search);
  document.addEventListener("keydown", go);
  window.addEventListener("pageshow", search); // also when one comes back from a page that was found
}
