"use strict";
// What the pages share: the data, elements whose content is text alone, colours, charts.
const data = JSON.parse(document.getElementById("data").textContent);
const $ = (id) => document.getElementById(id);

/** An element with attributes and children; a child that is no element is text. */
function el(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  for (const child of children) made.append(child instanceof Node ? child : document.createTextNode(String(child)));
  return made;
}

const COLOURS = ["back", "card", "ink", "soft", "line", "grid", "blue", "orange", "green", "purple", "sky", "brown", "faint",
  "field", "covered", "good", "bad"];
const palette = {};
const redraws = []; // called when colours have changed

function readPalette() {
  const style = getComputedStyle(document.documentElement);
  for (const name of COLOURS) palette[name] = style.getPropertyValue(`--${name}`).trim();
}

function repaint() {
  readPalette();
  for (const redraw of redraws) redraw();
}

function setTheme(theme) {
  if (theme) document.documentElement.setAttribute("data-theme", theme);
  else document.documentElement.removeAttribute("data-theme");
  repaint();
}

readPalette();
const darkScreen = matchMedia("(prefers-color-scheme: dark)");
darkScreen.addEventListener("change", repaint);
$("theme").addEventListener("click", () => {
  const now = document.documentElement.getAttribute("data-theme") || (darkScreen.matches ? "dark" : "light");
  setTheme(now === "dark" ? "light" : "dark");
});
let screenTheme = null;
addEventListener("beforeprint", () => { screenTheme = document.documentElement.getAttribute("data-theme"); setTheme("light"); });
addEventListener("afterprint", () => setTheme(screenTheme));

/** The index of the last value that is not above x; -1 before the first. */
function lastIndex(values, x) {
  let low = 0, high = values.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (values[middle] <= x) low = middle + 1; else high = middle;
  }
  return low - 1;
}

function number(value, digits = 4) {
  if (value === null || value === undefined) return "–";
  return String(Number(value.toPrecision(digits))).replace("-", "−");
}
const percent = (share) => (share === null || share === undefined ? "–" : `${number(100 * share, 3)} %`);

function clockText(s) {
  const whole = Math.floor(s / 60);
  return whole ? `${whole} min ${(s - 60 * whole).toFixed(1).padStart(4, "0")} s` : `${s.toFixed(1)} s`;
}

/** A line of a table of two or more columns. */
const row = (...cells) => el("tr", {}, ...cells.map((cell) => (cell instanceof Node && cell.tagName === "TD" ? cell : el("td", {}, cell))));
function tableOf(head, rows) {
  return el("table", {}, el("thead", {}, el("tr", {}, ...head.map((title) => el("th", { scope: "col" }, title)))), el("tbody", {}, ...rows));
}

function axis(label, more = {}) {
  return { stroke: () => palette.soft, grid: { stroke: () => palette.grid, width: 1 }, ticks: { stroke: () => palette.grid, width: 1 }, font: "12px system-ui, sans-serif", label, labelSize: label ? 18 : 0, labelFont: "12px system-ui, sans-serif", ...more };
}

/** A size for a canvas in device pixels; its drawing context in CSS pixels. */
function fitted(canvas, width, height) {
  const ratio = devicePixelRatio || 1;
  const [w, h] = [Math.max(1, Math.round(width * ratio)), Math.max(1, Math.round(height * ratio))];
  if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  return context;
}

document.title = data.title;
$("title").textContent = data.title;
(data.words || []).forEach((words, i) => $("words").append(el("p", i === 0 && (data.completed === true || data.completed === false) ? { class: data.completed ? "yes" : "no" } : {}, words)));
