"use strict";
// A flight: a time cursor over the map, the charts and the decisions.
const path = data.path, decisions = data.decisions, plan = data.plan;
const END = data.end.duration_s;
const decisionTimes = decisions.time_s || [];
const SPEEDS = [1, 2, 5, 10, 20, 60, 120, 300];
const state = { t: END, playing: false, speed: 20, decision: -1 };

// --- values at a time

/** Linear between the samples of a series. */
function at(series, name, t) {
  const times = series.t, values = series[name];
  const i = lastIndex(times, t);
  if (i < 0) return values[0];
  if (i >= times.length - 1) return values[times.length - 1];
  if (values[i] === null || values[i + 1] === null) return values[i];
  return values[i] + (values[i + 1] - values[i]) * (t - times[i]) / (times[i + 1] - times[i]);
}
const held = (series, t) => series.v[Math.max(0, lastIndex(series.t, t))];

/** A value of a decision's column; texts and vectors are listed once. */
function decided(name, i) {
  const column = decisions[name];
  if (column === undefined || i < 0) return null;
  return column.of ? column.of[column.at[i]] : column[i];
}
const fromDeg = ([east, north]) => (450 - Math.atan2(-north, -east) * 180 / Math.PI) % 360;
/** The true mean wind at a time: linear between its rows of time, east and north. */
const blowing = (t) => {
  const { rows } = data.wind, i = rows.findIndex((row) => row[0] > t);
  if (i < 1) return rows.at(i).slice(1); // -1: after the last
  const [a, b] = [rows[i - 1], rows[i]], share = (t - a[0]) / (b[0] - a[0]);
  return [1, 2].map((k) => a[k] + share * (b[k] - a[k]));
};
const windText = (wind) => `${number(Math.hypot(...wind), 3)} m/s` + (Math.hypot(...wind) > 0.05 ? ` from ${Math.round(fromDeg(wind)) % 360}°` : "");

// --- charts

const charts = [], waiting = [];
const lastForecast = Math.max(0, ...decisionTimes.map((t, i) => t + (decided("remaining_s", i) || 0)));
const spanEnd = Math.max(END, Math.min(1.25 * END, lastForecast)) || 1;

const chart = (...parts) => waiting.push(parts);

function drawChart(title, unit, x, lines, options = {}) {
  const note = el("small");
  const box = el("div", { class: "chart" }, el("h2", {}, title, note));
  $("charts").append(box);
  const plot = new uPlot({
    width: 300, height: options.height || 165,
    scales: { x: { time: false, range: [0, spanEnd] }, y: { range: options.range || ((u, low, high) => (low === null ? [0, 1] : uPlot.rangeNum(low, high, 0.08, true))) } },
    axes: [axis(options.last ? "time [s]" : "", { size: options.last ? 28 : 26 }), axis(unit, { size: 46 })],
    cursor: { y: false, points: { show: false }, drag: { x: false, y: false }, sync: { key: "time" } },
    legend: { show: false },
    series: [{}, ...lines.map((line) => ({ label: line.label, stroke: () => palette[line.colour], width: line.width || 1.5, dash: line.dash, fill: line.fill ? () => `${palette[line.colour]}55` : undefined, fillTo: (u, i, low) => low, paths: line.steps ? uPlot.paths.stepped({ align: 1 }) : undefined, points: { show: false } }))],
    hooks: { draw: options.draw ? [options.draw] : [] },
  }, [x, ...lines.map((line) => line.y)], box);
  const known = lines[0].y.filter((value) => value !== null);
  const [low, high] = known.reduce(([a, b], value) => [Math.min(a, value), Math.max(b, value)], [Infinity, -Infinity]);
  plot.root.setAttribute("role", "img");
  plot.root.setAttribute("aria-label", `${title} over ${Math.round(END)} s: ${lines.map((line) => line.label).join(", ")}. ${lines[0].label} from ${number(low)} to ${number(high)} ${unit}.`);
  const line = el("div", { class: "cursor-line" });
  plot.over.append(line);
  let dragging = false;
  const scrub = (event) => { const box = plot.over.getBoundingClientRect(); setTime(plot.posToVal(event.clientX - box.left, "x")); };
  plot.over.addEventListener("pointerdown", (event) => { dragging = true; pause(); scrub(event); });
  plot.over.addEventListener("pointermove", (event) => { if (dragging && event.buttons) scrub(event); });
  addEventListener("pointerup", () => { dragging = false; });
  const keys = el("ul", { class: "legend" });
  const key = () => keys.replaceChildren(...[...lines, ...(options.extra || [])].map((one) => el("li", {}, swatch("line", one.colour, one.width || 1.5, one.dash), one.label)));
  box.append(keys);
  redraws.push(key);
  key();
  charts.push({ plot, line, box, note, value: options.value, height: options.height || 165 });
}

/** Lines over a common time of series that are constant between their changes. */
function stepped(series) {
  const times = [...new Set([...series.flatMap((one) => one.t), END])].sort((a, b) => a - b);
  return [times, series.map((one) => times.map((t) => held(one, t)))];
}

function drawHorizon(u) {
  const i = lastIndex(data.horizons.t, state.t);
  if (i < 0) return;
  const values = data.horizons.w[i], start = data.horizons.t[i], step = data.horizons.s[i] / (values.length - 1);
  drawLine(u, values.map((w, k) => [start + k * step, w]), palette.orange, [5, 4], 2);
}

function drawLine(u, points, colour, dash, width) {
  const { ctx } = u, ratio = devicePixelRatio || 1;
  ctx.save();
  ctx.beginPath();
  ctx.rect(u.bbox.left, u.bbox.top, u.bbox.width, u.bbox.height);
  ctx.clip();
  ctx.beginPath();
  points.forEach(([x, y], i) => ctx[i ? "lineTo" : "moveTo"](u.valToPos(x, "x", true), u.valToPos(y, "y", true)));
  ctx.strokeStyle = colour;
  ctx.lineWidth = width * ratio;
  ctx.setLineDash(dash.map((length) => length * ratio));
  ctx.stroke();
  ctx.restore();
}

/** The reserve, losses of charge, and the forecast of the decision in force: 95 % at its end. */
function drawCharge(u) {
  if (data.reserve !== null) drawLine(u, [[0, 100 * data.reserve], [spanEnd, 100 * data.reserve]], palette.bad, [7, 4], 1.5);
  for (const [t] of data.faults) if (t <= END) drawLine(u, [[t, 0], [t, 110]], palette.soft, [2, 3], 1.5);
  const i = state.decision, left = decided("remaining_s", i), soc = decided("soc_end", i), std = decided("soc_end_std", i);
  if (left === null || soc === null) return;
  const t = decisionTimes[i], now = at(data.charge, "soc", t);
  drawLine(u, [[t, 100 * now], [t + left, 100 * soc]], palette.orange, [5, 4], 2);
  if (std === null) return;
  const { ctx } = u, [x0, x1] = [t, t + left].map((x) => u.valToPos(x, "x", true));
  const y = (value) => u.valToPos(100 * value, "y", true);
  ctx.save();
  ctx.beginPath();
  ctx.rect(u.bbox.left, u.bbox.top, u.bbox.width, u.bbox.height);
  ctx.clip();
  ctx.beginPath();
  ctx.moveTo(x0, y(now));
  ctx.lineTo(x1, y(soc + 1.96 * std));
  ctx.lineTo(x1, y(soc - 1.96 * std));
  ctx.closePath();
  ctx.globalAlpha = 0.22;
  ctx.fillStyle = palette.orange;
  ctx.fill();
  ctx.restore();
}

/** A sample of a line, an area or a marker for a legend. */
function swatch(shape, colour, width, dash = []) {
  const canvas = el("canvas", { "aria-hidden": "true" }), context = fitted(canvas, 26, 12);
  context.strokeStyle = context.fillStyle = palette[colour];
  if (shape === "line") {
    context.lineWidth = width;
    context.setLineDash(dash);
    context.beginPath();
    context.moveTo(0, 6);
    context.lineTo(26, 6);
    context.stroke();
  } else if (shape === "fill") context.fillRect(2, 1, 22, 10);
  else marker(context, [13, 6], shape, shape === "star" ? 6 : 4.5, palette[colour]);
  return canvas;
}

function buildCharts() {
  const power = [{ label: "measured", colour: "blue", y: data.power.w, width: 2.2 }];
  if (data.power.forecast_w) power.push({ label: "forecast, one step ahead", colour: "orange", y: data.power.forecast_w, width: 1 });
  const ahead = data.horizons.t.length ? [{ label: "forecast at the cursor, as far as the planner looks", colour: "orange", dash: [5, 4], width: 2 }] : [];
  chart("Power", "W", data.power.t, power, { extra: ahead, draw: drawHorizon, value: (t) => `${number(at(data.power, "w", t))} W` });
  const also = data.reserve === null ? [] : [{ label: "reserve", colour: "bad", dash: [7, 4] }];
  if (decisions.soc_end) also.push({ label: "forecast at the cursor, with 95 % at its end", colour: "orange", dash: [5, 4], width: 2 });
  if (data.faults.length) also.push({ label: "sudden loss", colour: "soft", dash: [2, 3] });
  chart("State of charge", "%", data.charge.t, [{ label: "state of charge", colour: "green", y: data.charge.soc.map((soc) => (soc === null ? null : 100 * soc)), width: 2 }],
    { extra: also, draw: drawCharge, range: [0, 104], value: (t) => percent(at(data.charge, "soc", t)) });
  if (data.parameters.length) {
    const colours = ["purple", "blue", "green", "orange", "brown", "sky"];
    const [t, values] = stepped(data.parameters);
    const lines = data.parameters.map((one, i) => ({
      label: `${one.name} ${number(one.low)} … ${number(one.high)}${one.unit ? ` ${one.unit}` : ""}`, colour: colours[i % colours.length], steps: true,
      dash: i >= colours.length ? [6, 3] : undefined, width: 1.5 + 1.6 * Math.min(3, data.parameters.length - 1 - i),
      y: values[i].map((value) => shareOf(one, value)) }));
    chart("Parameters", "share of the set", t, lines, { range: [-0.06, 1.06], value: (now) => data.parameters.map((one) => `${one.name} ${number(held(one, now))}`).join(", ") });
  }
  if (decisions.wind_mps) {
    const winds = decisionTimes.map((_, i) => decided("wind_mps", i));
    const lines = [["east", "blue", 0], ["north", "orange", 1]].map(([name, colour, k]) => ({ label: `estimated, towards ${name}`, colour, steps: true, width: 2, y: winds.map((wind) => wind && wind[k]) }));
    if (data.wind) for (const [name, colour, k] of [["east", "blue", 0], ["north", "orange", 1]]) lines.push({ label: `true mean, ${name}`, colour, dash: [6, 4], width: 1, y: decisionTimes.map((t) => blowing(t)[k]) });
    if (winds.some((wind) => wind)) chart("Wind", "m/s", decisionTimes, lines, { height: 150, value: () => { const wind = decided("wind_mps", state.decision); return wind ? windText(wind) : ""; } });
  }
  if (data.airspeed) {
    const speeds = [
      { label: "flown", colour: "blue", y: data.airspeed.mps, width: 2 },
      { label: "commanded", colour: "orange", y: data.airspeed.commanded_mps, steps: true },
    ];
    chart("Airspeed", "m/s", data.airspeed.t, speeds, { value: (t) => `${number(at(data.airspeed, "mps", t))} m/s` });
  }
  if (data.altitude) {
    const heights = [{ label: "altitude", colour: "blue", y: data.altitude.m, width: 2 }];
    chart("Altitude", "m", data.altitude.t, heights, { value: (t) => `${number(at(data.altitude, "m", t))} m` });
  }
  waiting[waiting.length - 1][4].last = true;
  for (const parts of waiting) drawChart(...parts);
}

function sizeCharts() {
  for (const one of charts) one.plot.setSize({ width: Math.max(220, one.box.clientWidth), height: one.height });
  moveLines();
}

function moveLines() {
  for (const { plot, line, note, value } of charts) {
    line.style.transform = `translateX(${plot.valToPos(state.t, "x") - 1}px)`;
    if (value) note.textContent = value(state.t);
  }
}

// --- map

const map = $("map"), base = document.createElement("canvas");
const airspace = data.airspace || { obstacles: [], boundary: [] };
const view = { x: 0, y: 0, scale: 1, fitted: true };
const corners = (() => { // of all that is drawn
  const xs = path.x.filter((x) => x !== null), ys = path.y.filter((y) => y !== null);
  const lines = [...plan.routes.map(([, line]) => line), ...plan.faint, ...(data.field ? data.field.rings.map((ring) => ring.flat()) : []), ...[...airspace.obstacles.map(([, ring]) => ring), ...airspace.boundary].map((ring) => ring.flat())];
  for (const line of lines) for (let i = 0; i < line.length; i += 2) { xs.push(line[i]); ys.push(line[i + 1]); }
  for (const point of [plan.start, plan.final]) if (point) { xs.push(point[0]); ys.push(point[1]); }
  const ends = (values) => values.reduce(([a, b], value) => [Math.min(a, value), Math.max(b, value)], [Infinity, -Infinity]);
  return [...ends(xs), ...ends(ys)];
})();
const px = (x) => (x - view.x) * view.scale + map.clientWidth / 2;
const py = (y) => (view.y - y) * view.scale + map.clientHeight / 2;

const onMap = ([x, y]) => [px(x), py(y)];

function fitMap() {
  const [left, right, low, high] = corners;
  [view.x, view.y] = [(left + right) / 2, (low + high) / 2];
  view.scale = Math.min((map.clientWidth - 40) / Math.max(right - left, 1), (map.clientHeight - 56) / Math.max(high - low, 1));
  view.fitted = true;
}

function strokePoints(context, line) {
  context.beginPath();
  for (let i = 0; i < line.length; i += 2) context[i ? "lineTo" : "moveTo"](px(line[i]), py(line[i + 1]));
  context.stroke();
}

function marker(context, [cx, cy], shape, size, fill) {
  context.beginPath();
  if (shape === "circle") context.arc(cx, cy, size, 0, 7);
  else if (shape === "square") context.rect(cx - size, cy - size, 2 * size, 2 * size);
  else if (shape === "diamond") for (const [dx, dy] of [[0, -1], [1, 0], [0, 1], [-1, 0]]) context.lineTo(cx + size * dx, cy + size * dy);
  else for (let i = 0; i < 10; i++) { const r = i % 2 ? size * 0.45 : size, a = i * Math.PI / 5; context.lineTo(cx + r * Math.sin(a), cy - r * Math.cos(a)); }
  context.closePath();
  context.fillStyle = fill;
  context.fill();
  context.strokeStyle = palette.ink;
  context.lineWidth = 1.5;
  context.stroke();
}

/** What does not depend on time: field, faint lines, start, final point, home, scale, north. */
function drawBase() {
  const context = fitted(base, map.clientWidth, map.clientHeight);
  const [width, height] = [map.clientWidth, map.clientHeight];
  context.fillStyle = palette.back;
  context.fillRect(0, 0, width, height);
  if (data.field) {
    context.beginPath();
    for (const ring of data.field.rings) { ring.forEach(([x, y], i) => context[i ? "lineTo" : "moveTo"](px(x), py(y))); context.closePath(); }
    context.fillStyle = palette.field;
    context.fill("evenodd");
    context.strokeStyle = palette.green;
    context.lineWidth = 1.2;
    context.stroke();
  }
  drawAirspace(context);
  context.strokeStyle = palette.faint;
  context.lineWidth = 1;
  for (const line of plan.faint) strokePoints(context, line);
  // a bar of a round length, and north
  let length = 10 ** Math.floor(Math.log10(110 / view.scale));
  length *= [5, 2, 1].find((times) => length * times * view.scale <= 110) || 1;
  context.strokeStyle = context.fillStyle = palette.soft;
  context.lineWidth = 2;
  context.font = "12px system-ui, sans-serif";
  context.beginPath();
  context.moveTo(14, height - 18);
  context.lineTo(14, height - 12);
  context.lineTo(14 + length * view.scale, height - 12);
  context.lineTo(14 + length * view.scale, height - 18);
  context.stroke();
  context.fillText(length >= 1000 ? `${length / 1000} km` : `${length} m`, 18, height - 18);
  context.fillText("N", 15, 20);
  context.beginPath();
  context.moveTo(19, 48);
  context.lineTo(19, 25);
  context.lineTo(15, 32);
  context.moveTo(19, 25);
  context.lineTo(23, 32);
  context.stroke();
}

/** The path so far; with `lines`, that on the stages that are lines. */
function strokeFlown(context, lines = false) {
  const last = lastIndex(path.t, state.t), { t, v } = data.stage;
  let open = false, k = 0;
  const drawn = () => !lines || plan.stages[v[k] - 1] === "line";
  const to = (x, y) => { context[open ? "lineTo" : "moveTo"](px(x), py(y)); open = true; };
  context.beginPath();
  const add = (time, x, y) => {
    for (; k + 1 < t.length && t[k + 1] <= time; k++) { // a stage starts between two samples
      const [x0, y0] = [at(path, "x", t[k + 1]), at(path, "y", t[k + 1])];
      if (open && drawn() && x0 !== null) to(x0, y0);
      open = false;
      if (x0 !== null && (!lines || plan.stages[v[k + 1] - 1] === "line")) to(x0, y0);
    }
    if (x === null || y === null || !drawn()) open = false;
    else to(x, y);
  };
  for (let i = 0; i <= last; i++) add(path.t[i], path.x[i], path.y[i]);
  add(state.t, at(path, "x", state.t), at(path, "y", state.t));
  context.stroke();
}

/** Obstacles with their names, and the boundary, dashed. */
function drawAirspace(context) {
  const ring = (points) => { context.beginPath(); points.forEach(([x, y], i) => context[i ? "lineTo" : "moveTo"](px(x), py(y))); context.closePath(); };
  context.strokeStyle = context.fillStyle = palette.bad;
  context.lineWidth = 1.2;
  context.textAlign = "center";
  for (const [name, outline] of airspace.obstacles) {
    ring(outline);
    context.globalAlpha = 0.2;
    context.fill();
    context.globalAlpha = 1;
    context.stroke();
    const [x, y] = [0, 1].map((i) => outline.reduce((sum, point) => sum + point[i], 0) / outline.length);
    if (airspace.obstacles.length <= 20) context.fillText(name, px(x), py(y));
  }
  context.setLineDash([7, 4]);
  for (const outline of airspace.boundary) { ring(outline); context.stroke(); }
  context.setLineDash([]);
  context.textAlign = "start";
}

const cover = document.createElement("canvas");
/** The ground within half a swath of the lines flown so far, in the field. */
function drawCovered(context) {
  if (!data.field || !data.field.swath_m) return;
  const layer = fitted(cover, map.clientWidth, map.clientHeight);
  layer.clearRect(0, 0, map.clientWidth, map.clientHeight);
  layer.save();
  layer.beginPath();
  for (const ring of data.field.rings) { ring.forEach(([x, y], i) => layer[i ? "lineTo" : "moveTo"](px(x), py(y))); layer.closePath(); }
  layer.clip("evenodd");
  layer.strokeStyle = palette.blue;
  layer.lineWidth = data.field.swath_m * view.scale;
  layer.lineJoin = "round";
  strokeFlown(layer, true);
  layer.restore();
  context.globalAlpha = 0.25;
  context.drawImage(cover, 0, 0, map.clientWidth, map.clientHeight);
  context.globalAlpha = 1;
}

function drawMap() {
  const context = fitted(map, map.clientWidth, map.clientHeight);
  context.drawImage(base, 0, 0, map.clientWidth, map.clientHeight);
  drawCovered(context);
  const route = plan.routes[Math.max(0, lastIndex(plan.routes.map(([t]) => t), state.t))];
  if (route) { context.strokeStyle = palette.orange; context.lineWidth = 2; strokePoints(context, route[1]); }
  context.strokeStyle = palette.blue;
  context.lineWidth = 3;
  context.lineJoin = "round";
  strokeFlown(context);
  if (plan.home) marker(context, onMap(plan.home), "square", 5, palette.back);
  if (plan.final) marker(context, onMap(plan.final), "star", 9, palette.brown);
  if (plan.start) marker(context, onMap(plan.start), "circle", 4.5, palette.back);
  decisions.changed && decisions.changed.forEach((changed, i) => {
    const [x, y] = [at(path, "x", decisionTimes[i]), at(path, "y", decisionTimes[i])];
    if (changed && x !== null) marker(context, onMap([x, y]), "diamond", i === state.decision ? 8 : 5.5, i === state.decision ? palette.orange : palette.brown);
  });
  const [x, y, heading] = ["x", "y", "heading"].map((name) => at(path, name, state.t));
  if (x !== null && y !== null) {
    context.save();
    context.translate(px(x), py(y));
    context.rotate(-(heading || 0));
    context.beginPath();
    for (const [dx, dy] of [[13, 0], [-9, -9], [-4, 0], [-9, 9]]) context.lineTo(dx, dy);
    context.closePath();
    context.fillStyle = palette.ink;
    context.strokeStyle = palette.back;
    context.lineWidth = 2;
    context.stroke();
    context.fill();
    context.restore();
  }
  drawWind(context);
}

/** An arrow that blows as the wind, at the top beside north. */
function drawWind(context) {
  const wind = data.wind ? blowing(state.t) : decided("wind_mps", state.decision);
  if (!wind || Math.hypot(...wind) < 0.05) return;
  const angle = -Math.atan2(wind[1], wind[0]);
  context.save();
  context.strokeStyle = context.fillStyle = palette.sky;
  context.lineWidth = 2.5;
  context.font = "12px system-ui, sans-serif";
  context.fillText(`wind ${windText(wind)}`, 72, 24);
  context.translate(50, 28);
  context.rotate(angle);
  context.beginPath();
  context.moveTo(-16, 0);
  context.lineTo(16, 0);
  context.moveTo(9, -6);
  context.lineTo(16, 0);
  context.lineTo(9, 6);
  context.stroke();
  context.restore();
}

function sizeMap() {
  if (view.fitted) fitMap();
  drawBase();
  drawMap();
}

function zoom(factor, x = map.clientWidth / 2, y = map.clientHeight / 2) {
  const [dx, dy] = [x - map.clientWidth / 2, y - map.clientHeight / 2];
  view.x += dx / view.scale * (1 - 1 / factor);
  view.y -= dy / view.scale * (1 - 1 / factor);
  view.scale *= factor;
  view.fitted = false;
  sizeMap();
}

function bindMap() {
  $("zoom-in").addEventListener("click", () => zoom(1.5));
  $("zoom-out").addEventListener("click", () => zoom(1 / 1.5));
  $("zoom-fit").addEventListener("click", () => { fitMap(); sizeMap(); });
  map.addEventListener("wheel", (event) => {
    if (!event.ctrlKey) return;
    event.preventDefault();
    zoom(Math.exp(-event.deltaY / 300), event.offsetX, event.offsetY);
  }, { passive: false });
  let from = null;
  map.addEventListener("pointerdown", (event) => { from = { x: event.clientX, y: event.clientY, moved: false }; });
  map.addEventListener("pointermove", (event) => {
    if (!from || !event.buttons) return;
    const [dx, dy] = [event.clientX - from.x, event.clientY - from.y];
    if (!from.moved && Math.hypot(dx, dy) < 5) return;
    view.x -= dx / view.scale;
    view.y += dy / view.scale;
    view.fitted = false;
    from = { x: event.clientX, y: event.clientY, moved: true };
    sizeMap();
  });
  map.addEventListener("pointerup", (event) => {
    if (from && !from.moved) pick(event.offsetX, event.offsetY);
    from = null;
  });
}

/** Go to the decision, or to the moment of the path, that was clicked. */
function pick(x, y) {
  const near = (times, allowed, limit) => {
    let best = -1, least = limit;
    times.forEach((t, i) => {
      if (!allowed(i)) return;
      const distance = Math.hypot(px(at(path, "x", t)) - x, py(at(path, "y", t)) - y);
      if (distance < least) { least = distance; best = i; }
    });
    return best;
  };
  const decision = near(decisionTimes, (i) => decisions.changed[i], 14);
  const sample = near(path.t, (i) => path.x[i] !== null, 18);
  pause();
  if (decision >= 0) setTime(decisionTimes[decision]);
  else if (sample >= 0) setTime(path.t[sample]);
}

function legend() {
  const items = [["line", "blue", 3, "flown so far"]];
  if (plan.routes.length) items.unshift(["line", "orange", 2, "plan at the parameters in force"]);
  if (plan.faint.length) items.unshift(["line", "faint", 1, "plan across its parameters"]);
  if (data.field) items.push(["fill", "field", 0, "field"]);
  if (data.field && data.field.swath_m) items.push(["fill", "covered", 0, `covered so far, ${number(data.field.swath_m)} m wide`]);
  if (plan.start) items.push(["circle", "back", 0, "start"]);
  if (plan.final) items.push(["star", "brown", 0, "final point"]);
  if (plan.home) items.push(["square", "back", 0, "home"]);
  if (decisions.changed && decisions.changed.includes(true)) items.push(["diamond", "brown", 0, "decision that changed parameters"]);
  $("map-legend").replaceChildren(...items.map(([shape, colour, width, text]) => el("li", {}, swatch(shape, colour, width), text)));
}

// --- decisions

/** Where a value lies in a parameter's set: 0 at its coarse or low end, 1 at the other. */
function shareOf(one, value) { return one.high === one.low ? 1 : (value - one.low) / (one.high - one.low); }

const parametersText = (values) => (values ? Object.entries(values).map(([name, value]) => `${name} ${number(value)}`).join(", ") : "–");
/** A value and its standard deviation, to two digits of the latter. */
function spread(value, std, unit) {
  if (value === null) return null;
  if (!std) return `${number(value)} ${unit}`;
  const digits = Math.max(0, 1 - Math.floor(Math.log10(std)));
  return `${value.toFixed(digits).replace("-", "−")} ± ${std.toFixed(digits)} ${unit}`;
}

/** What was forecast at a decision, beside what came. */
function showDecision() {
  const i = state.decision, box = $("decision-now");
  $("decision-title").textContent = decisionTimes.length ? "Decisions" : "No decisions are recorded by this planner";
  if (i < 0) { box.replaceChildren(); markRow(); return; }
  const t = decisionTimes[i], left = END - t, end = data.end;
  const reached = data.completed ? "" : ` (${end.reason})`;
  const lines = [
    ["time to the end", spread(decided("remaining_s", i), decided("remaining_std_s", i), "s"), `${number(left)} s${reached}`],
    ["energy to the end", spread(decided("energy_wh", i), decided("energy_std_wh", i), "Wh"), decisions.used_after_wh[i] === null ? "–" : `${number(decisions.used_after_wh[i])} Wh${reached}`],
    ["charge at the end", decided("soc_end", i) === null ? null : `${percent(decided("soc_end", i))} ± ${number(100 * (decided("soc_end_std", i) || 0), 2)} %`, percent(end.soc_final)],
    ["completes", decided("completes_probability", i) === null ? null : `with ${percent(decided("completes_probability", i))}`, data.completed === null ? "–" : data.completed ? "yes" : `no: ${end.reason}`],
    ["keeps the reserve", decided("reserve_probability", i) === null ? null : `with ${percent(decided("reserve_probability", i))}`, data.reserve_kept === null ? "–" : data.reserve_kept ? "yes" : "no"],
    ["quality of the flight", decided("quality_forecast", i) === null ? null : number(decided("quality_forecast", i)), number(end.quality)],
    ["wind", decided("wind_mps", i) ? windText(decided("wind_mps", i)) : null, data.wind ? `${windText(blowing(decisionTimes[i]))}${data.wind.gust_std_mps ? `, gusts of ${number(data.wind.gust_std_mps)} m/s` : ""}` : "–"],
    ["home can be reached", decided("home_reachable", i) === null ? null : decided("home_reachable", i) ? "yes" : "no", "–"],
  ].filter(([, forecast]) => forecast !== null);
  const details = [decided("cause", i) && `Cause: ${decided("cause", i)}`, decided("status", i) && `status: ${decided("status", i)}`].filter(Boolean);
  if (decided("calls", i)) details.push(`${decided("calls", i)} run${decided("calls", i) > 1 ? "s" : ""} of the solver`);
  if (decided("battery_limit", i)) details.push(`limit that binds: ${decided("battery_limit", i)}`);
  box.replaceChildren(
    el("strong", {}, `At ${clockText(t)}, stage ${decided("stage", i)}, lap ${decided("lap", i)}: ${decided("reason", i) || "no reason given"}`),
    el("span", {}, `${data.parameters.length ? `Decided: ${parametersText(decided("parameters", i))}. ` : ""}${details.join("; ")}${details.length ? "." : ""}`),
    lines.length ? el("div", { class: "scroll" }, tableOf(["", "forecast then", "what came"], lines.map((line) => row(...line)))) : "",
  );
  markRow();
}

/** Whether a re-planning changed parameters, follows a jump of the charge, or is the first without a solution. */
function notable(i) {
  const status = decided("status", i), failed = status === "infeasible" || status === "fallback";
  return decisions.changed[i] || decided("cause", i) === "the charge has jumped" || (failed && status !== decided("status", i - 1));
}

let rows = new Map();
function listDecisions() {
  const all = $("all").checked;
  rows = new Map();
  decisionTimes.forEach((t, i) => {
    if (!all && !notable(i)) return;
    const button = el("button", { type: "button" }, clockText(t));
    const line = row(el("td", {}, button), `${decided("stage", i)} / ${decided("lap", i)}`, decided("cause", i) || "", decided("reason", i) || "", parametersText(decided("parameters", i)), percent(decided("completes_probability", i)));
    line.setAttribute("data-at", i);
    line.addEventListener("click", () => { pause(); setTime(t); });
    rows.set(i, line);
  });
  $("decision-list").replaceChildren(tableOf(["time", "stage / lap", "cause", "reason", "decided", "completes"], [...rows.values()]));
  $("decision-list").hidden = !rows.size;
  $("all").parentElement.hidden = rows.size === decisionTimes.length && !all;
  markRow();
}

function markRow() {
  for (const line of document.querySelectorAll("#decision-list tr[aria-current]")) line.removeAttribute("aria-current");
  const line = rows.get(state.decision), list = $("decision-list");
  if (!line) return;
  line.setAttribute("aria-current", "true");
  const [top, bottom] = [line.offsetTop - 30, line.offsetTop + line.offsetHeight];
  if (top < list.scrollTop) list.scrollTop = top;
  else if (bottom > list.scrollTop + list.clientHeight) list.scrollTop = bottom - list.clientHeight;
}

// --- time

function nowText() {
  const t = state.t, stage = held(data.stage, t);
  const words = [];
  if (stage) words.push(`stage ${stage}${plan.stages.length ? ` of ${plan.stages.length} (${plan.stages[stage - 1]})` : ""}, lap ${held(data.lap, t)}`);
  const [x, y] = [at(path, "x", t), at(path, "y", t)];
  if (x !== null) words.push(`x ${number(x)} m, y ${number(y)} m`);
  if (path.lat) words.push(`${at(path, "lat", t).toFixed(5)}°, ${at(path, "lon", t).toFixed(5)}°`);
  words.push(`${number(at(data.power, "w", t))} W`, `charge ${percent(at(data.charge, "soc", t))}`);
  if (data.parameters.length) words.push(data.parameters.map((one) => `${one.name} ${number(held(one, t))}`).join(", "));
  return words.join(" · ");
}

function setTime(t) {
  state.t = Math.min(END, Math.max(0, t));
  const decision = lastIndex(decisionTimes, state.t + 1e-6);
  const turned = decision !== state.decision || Math.abs(state.t - (setTime.drawn ?? -9)) > END / 300;
  state.decision = decision;
  $("time").value = state.t;
  $("clock").textContent = `${clockText(state.t)} of ${clockText(END)}`;
  $("now").textContent = nowText();
  map.setAttribute("aria-label", `Map at ${clockText(state.t)}: ${nowText()}`);
  if (turned) {
    setTime.drawn = state.t;
    for (const { plot } of charts) plot.redraw(false);
    showDecision();
  }
  moveLines();
  drawMap();
}

function pause() {
  state.playing = false;
  $("play").textContent = "Play";
  $("play").setAttribute("aria-pressed", "false");
  $("now").setAttribute("aria-live", "polite");
}

function play() {
  if (state.t >= END - 1e-6) setTime(0);
  state.playing = true;
  $("play").textContent = "Stop";
  $("play").setAttribute("aria-pressed", "true");
  $("now").setAttribute("aria-live", "off");
  let last = performance.now();
  const step = (now) => {
    if (!state.playing) return;
    setTime(state.t + Math.max(0, now - last) / 1000 * state.speed);
    last = now;
    if (state.t >= END - 1e-6) pause(); else requestAnimationFrame(step);
  };
  requestAnimationFrame(step);
}

function setSpeed(speed) {
  state.speed = speed;
  $("speed").value = speed;
}

/** To the decision before or after that changed something; to any if all are listed. */
function stepDecision(direction) {
  const known = [...rows.keys()].map((i) => decisionTimes[i]);
  const found = direction > 0 ? known.find((t) => t > state.t + 1e-6) : known.filter((t) => t < state.t - 1e-6).pop();
  if (found !== undefined) { pause(); setTime(found); }
}

function onKey(event) {
  const tag = event.target.tagName;
  if (event.ctrlKey || event.metaKey || event.altKey || tag === "SELECT" || tag === "TEXTAREA") return;
  if (event.key === " " && (tag === "BUTTON" || event.target.type === "checkbox")) return;
  const far = event.shiftKey ? 10 : 1;
  const actions = {
    " ": () => (state.playing ? pause() : play()),
    ArrowLeft: () => { pause(); setTime(state.t - far); },
    ArrowRight: () => { pause(); setTime(state.t + far); },
    ArrowUp: () => stepDecision(-1),
    ArrowDown: () => stepDecision(1),
    Home: () => { pause(); setTime(0); },
    End: () => { pause(); setTime(END); },
    "+": () => setSpeed(SPEEDS.find((speed) => speed > state.speed) || state.speed),
    "-": () => setSpeed([...SPEEDS].reverse().find((speed) => speed < state.speed) || state.speed),
  };
  if (actions[event.key]) { event.preventDefault(); actions[event.key](); }
}

function errorsText() {
  let text = `${path.t.length} moments of the flight are shown; flight.csv has all.`;
  if (plan.shown < plan.turns) text += ` ${plan.shown} of ${plan.turns} courses of the plan in force are drawn.`;
  return `${text} Made by eadp ${data.version}; charts by uPlot (MIT).`;
}

// --- start

for (const speed of SPEEDS) $("speed").append(el("option", { value: speed }, `${speed} ×`));
setSpeed(END > 1200 ? 60 : 20);
$("speed").addEventListener("change", () => setSpeed(Number($("speed").value)));
$("time").max = END;
$("time").addEventListener("input", () => { pause(); setTime(Number($("time").value)); });
$("play").addEventListener("click", () => (state.playing ? pause() : play()));
$("all").addEventListener("change", listDecisions);
addEventListener("keydown", onKey);
$("errors").textContent = errorsText();
$("figures").append(el("h2", {}, "Figures"), el("div", { class: "scroll" }, tableOf(["", ""], (data.facts || []).map((fact) => row(...fact)))));
buildCharts();
bindMap();
listDecisions();
fitMap();
redraws.push(() => { legend(); drawBase(); for (const { plot } of charts) plot.redraw(false); drawMap(); });
new ResizeObserver(() => { sizeCharts(); sizeMap(); }).observe($("panels"));
sizeCharts();
legend();
drawBase();
setTime(END);
document.documentElement.setAttribute("data-ready", performance.now().toFixed(0));
