"use strict";
// A sweep: heat map and curves over two of its keys, the runs of a cell, and links to flights that were kept.
const runs = data.runs, COUNT = runs.completed.length;
const FIGURES = {
  completed: { title: "share of flights that complete", unit: "%", of: (i) => (runs.completed[i] === null ? null : 100 * runs.completed[i]) },
  duration_s: { title: "duration, mean", unit: "s", of: (i) => runs.duration_s[i] },
  soc_final: { title: "charge at the end, mean", unit: "%", of: (i) => (runs.soc_final[i] === null ? null : 100 * runs.soc_final[i]) },
  quality: { title: "quality U, mean", unit: "", of: (i) => runs.quality[i] },
};
const MAX_VALUES = 24, BINS = 12, MAX_CURVES = 6, LISTED = 200, Z = 1.959963984540054;
const VIRIDIS = [[68, 1, 84], [71, 44, 122], [59, 81, 139], [44, 113, 142], [33, 144, 141], [39, 173, 129], [92, 200, 99], [170, 220, 50], [253, 231, 37]];
const CURVE_COLOURS = ["blue", "orange", "green", "purple", "brown", "sky"];
const DASHES = [undefined, [8, 4], [3, 3], [10, 3, 2, 3], [14, 4], [5, 2, 1, 2]];

/** The Wilson score interval of a share, 95 %. */
function wilson(successes, trials) {
  const share = successes / trials, square = Z * Z / trials;
  const middle = share + square / 2, reach = Z * Math.sqrt(share * (1 - share) / trials + square / (4 * trials));
  return [Math.max(0, (middle - reach) / (1 + square)), Math.min(1, (middle + reach) / (1 + square))];
}

const column = (key) => runs.values[key];
const valueOf = (key, i) => { const values = column(key); return values.of ? (values.at[i] === null ? "–" : values.of[values.at[i]]) : values[i]; };
const shown = (value) => (typeof value === "number" ? number(value, 6) : value);

/** The values of a key, or equal intervals of many numbers: labels, the position of each on an axis, and each run's. */
function bins(key, limit = MAX_VALUES) {
  if (!key) return { labels: ["all runs"], at: [0], numeric: false, of: () => 0 };
  const numeric = !column(key).of;
  const seen = new Map();
  for (let i = 0; i < COUNT; i++) { const value = valueOf(key, i); seen.set(value, (seen.get(value) || 0) + 1); }
  if (numeric && seen.size > limit) {
    const [low, high] = [...seen.keys()].reduce(([a, b], value) => [Math.min(a, value), Math.max(b, value)], [Infinity, -Infinity]);
    const count = Math.min(BINS, limit), width = (high - low) / count;
    const edge = (k) => number(low + k * width, 3);
    const all = Array.from({ length: count }, (_, k) => k);
    return { labels: all.map((k) => `${edge(k)} to ${edge(k + 1)}`), at: all.map((k) => low + (k + 0.5) * width), numeric, of: (i) => Math.min(count - 1, Math.floor((valueOf(key, i) - low) / width)) };
  }
  let values = [...seen.keys()];
  if (numeric) values.sort((a, b) => a - b);
  const rest = values.length > limit;
  if (rest) values = values.sort((a, b) => seen.get(b) - seen.get(a)).slice(0, limit - 1);
  const place = new Map(values.map((value, k) => [value, k]));
  const labels = [...values.map(shown), ...(rest ? ["others"] : [])];
  return { labels, at: numeric ? values : labels.map((_, k) => k), numeric, of: (i) => place.get(valueOf(key, i)) ?? values.length };
}

/** A figure over some runs: how many were flown, the mean, and its 95 % interval, of distinct flights. */
function summary(members, figure) {
  const counted = figure === "completed" ? members : members.filter((i) => runs.completed[i]); // no figure of a crash in a mean
  const values = counted.map(FIGURES[figure].of).filter((value) => value !== null);
  const n = values.length, flown = members.filter((i) => runs.completed[i] !== null), done = flown.filter((i) => runs.completed[i]).length;
  if (!n) return { n: 0, mean: null, interval: null, done, flown: flown.length };
  const mean = values.reduce((sum, value) => sum + value, 0) / n;
  const own = counted.filter((i) => runs.distinct[i] && FIGURES[figure].of(i) !== null), m = own.length;
  if (figure === "completed") {
    const interval = m ? wilson(own.filter((i) => runs.completed[i]).length, m).map((end) => 100 * end) : null;
    return { n, mean, interval, done, flown: n };
  }
  const std = m > 1 ? Math.sqrt(own.map(FIGURES[figure].of).reduce((sum, value) => sum + (value - mean) ** 2, 0) / (m - 1)) : 0;
  const reach = m > 1 ? Z * std / Math.sqrt(m) : null;
  return { n, mean, interval: reach === null ? null : [mean - reach, mean + reach], done, flown: flown.length };
}

function cells(upward, across) {
  const found = upward.labels.map(() => across.labels.map(() => []));
  for (let i = 0; i < COUNT; i++) found[upward.of(i)][across.of(i)].push(i);
  return found;
}

const chosen = () => ({ figure: $("figure").value, across: $("across").value, upward: $("upward").value });
const withUnit = (value, unit, digits = 4) => `${number(value, digits)}${unit ? ` ${unit}` : ""}`;

function summaryText(one, figure) {
  const { unit, title } = FIGURES[figure];
  if (!one.n) return one.flown ? `none of ${one.flown} flights completed` : "no flight";
  const words = [`${title}: ${withUnit(one.mean, unit)}`];
  if (one.interval) words[0] += ` (95 % interval ${number(one.interval[0], 3)} to ${withUnit(one.interval[1], unit, 3)})`;
  words.push(`${one.done} of ${one.flown} flights completed`);
  return words.join("\n");
}

// --- heat map

function colourOf(share) {
  const place = Math.min(0.9999, Math.max(0, share)) * (VIRIDIS.length - 1), k = Math.floor(place);
  return VIRIDIS[k].map((from, c) => Math.round(from + (VIRIDIS[k + 1][c] - from) * (place - k)));
}
/** Black or white, whichever is easier to read on a colour. */
const inkOn = ([r, g, b]) => (0.2126 * (r / 255) ** 2.2 + 0.7152 * (g / 255) ** 2.2 + 0.0722 * (b / 255) ** 2.2 > 0.18 ? "#000" : "#fff");
const rgb = (colour) => `rgb(${colour.join(",")})`;

/** The mean of a cell, and × with the number of flights that did not complete, which it leaves out. */
function cellText(cell, figure) {
  const mean = cell.mean === null ? "" : FIGURES[figure].unit === "%" ? cell.mean.toFixed(0) : number(cell.mean, figure === "duration_s" ? 4 : 2);
  return figure === "completed" || cell.done === cell.flown ? mean : `${mean} ×${cell.flown - cell.done}`.trim();
}

function drawHeat() {
  const { figure, across, upward } = chosen(), { unit, title } = FIGURES[figure];
  const [right, up] = [bins(across), bins(upward)];
  const found = cells(up, right).map((line) => line.map((members) => ({ members, ...summary(members, figure) })));
  const known = found.flat().map((cell) => cell.mean).filter((mean) => mean !== null);
  let [low, high] = known.length ? [Math.min(...known), Math.max(...known)] : [0, 1];
  if (unit === "%") [low, high] = [Math.min(0, low), 100];
  if (figure === "quality") [low, high] = [0, 1];
  if (low === high) high = low + 1;
  $("heat-title").textContent = `${title}${unit ? ` [${unit}]` : ""}`;
  const rows = up.labels.map((label, j) => el("tr", {}, el("th", { scope: "row" }, label), ...found[j].map((cell, k) => {
    const name = `${across} ${right.labels[k]}${upward ? `, ${upward} ${label}` : ""}`;
    const button = el("button", { type: "button", "aria-label": `${name}: ${summaryText(cell, figure)}` }, cellText(cell, figure));
    if (figure !== "completed" && cell.done < cell.flown) button.classList.add("crashed");
    if (cell.mean !== null) {
      const colour = colourOf((cell.mean - low) / (high - low));
      button.style.backgroundColor = rgb(colour);
      button.style.color = inkOn(colour);
    }
    button.disabled = !cell.members.length;
    tipOn(button, () => `${name}\n${summaryText(cell, figure)}${cell.members.length === 1 ? `\n${runText(cell.members[0])}` : "\nclick lists the runs"}`);
    button.addEventListener("click", () => listRuns(cell.members, name));
    return el("td", {}, button);
  }))).reverse();
  const foot = el("tr", {}, el("th", {}, `${upward ? `${upward} ↑ ` : ""}${across} →`), ...right.labels.map((label) => el("th", { scope: "col" }, label)));
  $("heat").replaceChildren(el("tbody", {}, ...rows, foot));
  const bar = el("span", { class: "scale-bar", "aria-hidden": "true" });
  bar.style.background = `linear-gradient(90deg, ${VIRIDIS.map(rgb).join(",")})`;
  $("scale").replaceChildren(withUnit(low, unit, 3), bar, withUnit(high, unit, 3));
}

// --- curves

let curves = null;
function drawCurves() {
  const { figure, across, upward } = chosen(), { unit, title } = FIGURES[figure];
  const right = bins(across), groups = bins(upward, MAX_CURVES);
  const found = cells(groups, right).map((line) => line.map((members) => summary(members, figure)));
  const y = found.map((line) => line.map((cell) => cell.mean));
  const means = [].concat(...found.map((line) => line.flatMap((cell) => [cell.mean, ...(cell.interval || [])]))).filter((value) => value !== null);
  let [low, high] = unit === "%" ? [0, 102] : figure === "quality" ? [0, 1.02] : [Math.min(...means), Math.max(...means)];
  if (!(low < high)) [low, high] = [low - 1, low + 1];
  $("curves-title").textContent = `${title}${unit ? ` [${unit}]` : ""} over ${across}`;
  $("curves-note").textContent = `Bars: 95 % intervals${figure === "completed" ? " (Wilson)" : " of the mean"}. ${upward ? `A curve for each ${upward}.` : ""}`;
  if (curves) curves.destroy();
  const [first, last] = [right.at[0], right.at[right.at.length - 1]], pad = (last - first || 1) * 0.04;
  const bars = (u) => {
    const { ctx } = u, ratio = devicePixelRatio || 1;
    ctx.save();
    ctx.lineWidth = 1.2 * ratio;
    found.forEach((line, g) => line.forEach((cell, k) => {
      if (!cell.interval) return;
      ctx.strokeStyle = palette[CURVE_COLOURS[g]];
      const x = u.valToPos(right.at[k], "x", true) + (g - (found.length - 1) / 2) * 1.5 * ratio;
      ctx.beginPath();
      for (const end of cell.interval) { ctx.moveTo(x - 3 * ratio, u.valToPos(end, "y", true)); ctx.lineTo(x + 3 * ratio, u.valToPos(end, "y", true)); }
      ctx.moveTo(x, u.valToPos(cell.interval[0], "y", true));
      ctx.lineTo(x, u.valToPos(cell.interval[1], "y", true));
      ctx.stroke();
    }));
    ctx.restore();
  };
  const box = $("curves");
  const ticks = right.numeric ? {} : { splits: () => right.at, values: (_, at) => at.map((k) => String(right.labels[k] ?? "").slice(0, 14)) };
  box.replaceChildren();
  curves = new uPlot({
    width: Math.max(240, box.clientWidth), height: 340,
    scales: { x: { time: false, range: [first - pad, last + pad] }, y: { range: [low, high] } },
    axes: [axis(across, { size: 34, ...ticks }), axis(unit, { size: 52 })],
    legend: { show: false }, cursor: { y: false, drag: { x: false, y: false }, points: { show: false } },
    series: [{}, ...groups.labels.map((label, g) => ({ label, stroke: () => palette[CURVE_COLOURS[g]], width: 2, dash: DASHES[g], spanGaps: true, points: { show: true, size: 6, stroke: () => palette[CURVE_COLOURS[g]], fill: () => palette[CURVE_COLOURS[g]] } }))],
    hooks: { draw: [bars] },
  }, [right.at, ...y], box);
  curves.root.setAttribute("role", "img");
  curves.root.setAttribute("aria-label", `${title} over ${across}, as in the table of the heat map.`);
  box.append(el("ul", { class: "legend" }, ...(upward ? groups.labels.map((label, g) => el("li", {}, swatch(g), `${upward} ${label}`)) : [])));
  tipOn(curves.over, (event) => {
    const bounds = curves.over.getBoundingClientRect(), x = curves.posToVal(event.clientX - bounds.left, "x");
    const k = right.at.reduce((best, at, i) => (Math.abs(at - x) < Math.abs(right.at[best] - x) ? i : best), 0);
    return [`${across} ${right.labels[k]}`, ...found.map((line, g) => (line[k].n ? `${upward ? `${groups.labels[g]}: ` : ""}${withUnit(line[k].mean, unit)}${line[k].interval ? ` (${number(line[k].interval[0], 3)} to ${number(line[k].interval[1], 3)})` : ""}, ${line[k].n} flights` : null)).filter(Boolean)].join("\n");
  });
}

function swatch(g) {
  const canvas = el("canvas", { "aria-hidden": "true" }), context = fitted(canvas, 26, 12);
  context.strokeStyle = palette[CURVE_COLOURS[g]];
  context.lineWidth = 2;
  context.setLineDash(DASHES[g] || []);
  context.moveTo(0, 6);
  context.lineTo(26, 6);
  context.stroke();
  return canvas;
}

// --- runs

function runText(i) {
  const words = data.keys.map((key) => `${key} ${shown(valueOf(key, i))}`);
  if (runs.completed[i] === null) words.push(`could not be made: ${runs.error.of[runs.error.at[i]]}`);
  else words.push(`${runs.completed[i] ? "completed" : "not completed"}: ${runs.reason.of[runs.reason.at[i]]}`, `${number(runs.duration_s[i])} s, charge ${percent(runs.soc_final[i])}${runs.quality[i] === null ? "" : `, U ${number(runs.quality[i], 3)}`}`);
  return words.join("\n");
}

function flightLink(i) {
  const folder = runs.folder && runs.folder[i];
  return folder ? el("a", { href: encodeURI(`${data.folder}/${folder}/report.html`) }, "flight") : "";
}

function listRuns(members, name) {
  $("runs-title").textContent = `${members.length} runs${name ? `: ${name}` : ""}${members.length > LISTED ? `; the first ${LISTED}` : ""}`;
  const kept = Boolean(runs.folder);
  const head = [...data.keys, "ended", "duration [s]", "charge at the end", "quality U", ...(kept ? ["flight"] : [])];
  const order = (a, b) => data.keys.reduce((found, key) => found || (valueOf(key, a) < valueOf(key, b) ? -1 : valueOf(key, a) > valueOf(key, b) ? 1 : 0), 0);
  const lines = [...members].sort(order).slice(0, LISTED).map((i) => {
    const ended = runs.completed[i] === null ? `could not be made: ${runs.error.of[runs.error.at[i]]}` : `${runs.completed[i] ? "✓" : "✕"} ${runs.reason.of[runs.reason.at[i]]}`;
    const line = row(...data.keys.map((key) => shown(valueOf(key, i))), ended, number(runs.duration_s[i]), percent(runs.soc_final[i]), number(runs.quality[i], 3), ...(kept ? [flightLink(i)] : []));
    tipOn(line, () => runText(i));
    return line;
  });
  $("runs").replaceChildren(tableOf(head, lines));
}

// --- hover

function tipOn(target, text) {
  const show = (event) => {
    const tip = $("tip"), box = target.getBoundingClientRect();
    const [x, y] = event.clientX === undefined ? [box.left, box.bottom] : [event.clientX, event.clientY];
    tip.textContent = text(event);
    tip.hidden = false;
    tip.style.left = `${Math.max(4, Math.min(x + 14, innerWidth - tip.offsetWidth - 8))}px`;
    tip.style.top = `${Math.max(4, Math.min(y + 14, innerHeight - tip.offsetHeight - 8))}px`;
  };
  const hide = () => { $("tip").hidden = true; };
  target.addEventListener("pointermove", show);
  target.addEventListener("pointerleave", hide);
  if (target.tagName === "BUTTON") { target.addEventListener("focus", show); target.addEventListener("blur", hide); }
}

// --- start

function draw() {
  drawHeat();
  drawCurves();
}

for (const [name, { title }] of Object.entries(FIGURES)) if (name !== "quality" || runs.quality.some((value) => value !== null)) $("figure").append(el("option", { value: name }, title));
for (const id of ["across", "upward"]) {
  if (id === "upward") $(id).append(el("option", { value: "" }, "–"));
  for (const key of data.keys) $(id).append(el("option", { value: key }, key));
  $(id).addEventListener("change", draw);
}
$("figure").addEventListener("change", draw);
$("upward").value = data.keys.find((key, k) => k > 0 && key !== "seed") || "";
$("errors").textContent = `${COUNT < data.count ? `${COUNT} of ${data.count} runs are in this page, a random sample; the words at the top count all. ` : ""}Numbers of more than ${MAX_VALUES} values are in ${BINS} equal intervals. Made by eadp ${data.version}; charts by uPlot (MIT).`;
if (data.keys.length && COUNT) draw();
else $("controls").hidden = $("panels").hidden = true;
listRuns(Array.from({ length: COUNT }, (_, i) => i), "");
redraws.push(() => { if (curves) drawCurves(); });
let lastWidth = innerWidth;
addEventListener("resize", () => { if (innerWidth !== lastWidth && curves) { lastWidth = innerWidth; drawCurves(); } });
document.documentElement.setAttribute("data-ready", performance.now().toFixed(0));
