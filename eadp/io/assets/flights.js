"use strict";
// Several flights: a table of their figures, and their picture.
document.title = data.title;
$("title").textContent = data.title;
$("plans").textContent = data.note;
const [head, ...rows] = data.table;
$("differences").append(
  el("thead", {}, el("tr", {}, ...head.map((name) => el("th", { scope: "col" }, name)))),
  el("tbody", {}, ...rows.map(([name, ...cells]) => el("tr", {}, el("th", { scope: "row" }, name), ...cells.map((cell) => el("td", {}, cell))))),
);
$("picture").src = `data:image/svg+xml;base64,${data.figure}`;
document.documentElement.setAttribute("data-ready", performance.now().toFixed(0));
