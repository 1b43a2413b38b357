"use strict";
// The calibration page: points on a picture, and what the server makes of them.

const KEY = new URLSearchParams(location.search).get("key") || "";
const HINTS = {
  point: "Click a mark whose place on the road you know. Drag to correct, wheel to zoom, arrows move by ¼ px.",
  dashes: "Click the beginnings of a lane's dashes one after the other, the nearest first.",
  line: "Click points of one lane line: only its y has to be known.",
  segment: "Click two opposite corners of the stretch to be watched.",
  check: "Click two places whose distance you know: it takes no part in the fit.",
};
const COLOURS = { point: "#35c26b", bad: "#ff4d42", guess: "#c08bff", line: "#ffb02e", check: "#ff5fc4" };
/** @returns {any} */
const byId = (id) => document.getElementById(id);
/** @returns {NodeListOf<HTMLElement>} */
const modeButtons = () => document.querySelectorAll("[data-mode]");
const canvas = byId("view"), pen = canvas.getContext("2d");
const picture = new Image();
let begin = { presets: [], size: [1, 1] };
// What is undone and saved. A point whose coordinates are not typed yet has null for them.
let sheet = { points: [], lines: [], segments: [], row: { preset: 0, x: 0, y: 0 } };
let past = [], future = [];
let mode = "point", chosen = -1, view = { zoom: 1, u: 0, v: 0 }, fitted = true;
let result = null, check = [], checkKnown = null, checkMetres = null, corners = [];
let vehicles = [], lastFit = null, lineY = 0, pointer = null, guessError = null;

async function ask(what, question) {
  const answer = await fetch("/" + what, {
    method: "POST", headers: { "X-Key": KEY, "Content-Type": "application/json" },
    body: JSON.stringify(question || {}),
  });
  return answer.json();
}
const isTyped = (point) => point.road.every((n) => n !== null);
// A point's number, and its place in what the server answers: only those typed are asked about.
const numberOf = (i) => (isTyped(sheet.points[i]) ? sheet.points.slice(0, i + 1).filter(isTyped).length : null);
const fittedAt = (i) => (result && result.points && numberOf(i) ? result.points[numberOf(i) - 1] : undefined);
const asked = () => ({
  points: sheet.points.filter(isTyped).map((p) => ({ image: p.image, road: p.road })),
  lines: sheet.lines, segments: sheet.segments,
  terms: byId("terms").value ? JSON.parse(byId("terms").value) : null,
});

// Undo keeps whole sheets: they are small.
function change(how) {
  past.push(JSON.stringify(sheet));
  future = [];
  how();
  changed();
}
function travel(from, to) {
  if (!from.length) return;
  to.push(JSON.stringify(sheet));
  sheet = JSON.parse(from.pop());
  chosen = Math.min(chosen, sheet.points.length - 1);
  changed();
}
function changed() {
  byId("saved").textContent = "";
  list();
  options();
  draw();
  fit(false);
}

let waiting = null, busy = false, again = null;
function fit(live) {
  clearTimeout(waiting);
  if (vehicles.length) { vehicles = []; byId("speeds").textContent = ""; }
  if (live) sendFit(true);
  waiting = setTimeout(() => sendFit(false), live ? 350 : 60);
}
async function sendFit(live) {
  if (busy) { again = live; return; }
  busy = true;
  try { result = await ask("fit", { ...asked(), live, fit: lastFit }); }
  catch { result = { problem: "the server does not answer: is it still running?" }; }
  busy = false;
  if (!result.live) lastFit = result.fit === undefined ? null : result.fit;
  show();
  draw();
  if (!result.live) remeasure();
  if (again !== null) { const next = again; again = null; sendFit(next); }
}

// Where a place of the picture is on the canvas, and back.
/** @returns {[number, number]} */
const toScreen = ([u, v]) => [(u - view.u) * view.zoom, (v - view.v) * view.zoom];
const toPicture = (x, y) => [x / view.zoom + view.u, y / view.zoom + view.v];
function whole() {
  fitted = true;
  const [width, height] = begin.size;
  view.zoom = Math.min(canvas.clientWidth / width, canvas.clientHeight / height);
  view.u = (width - canvas.clientWidth / view.zoom) / 2;
  view.v = (height - canvas.clientHeight / view.zoom) / 2;
  draw();
}
function zoomAt(x, y, factor) {
  fitted = false;
  const [u, v] = toPicture(x, y);
  view.zoom = Math.min(40, Math.max(0.1, view.zoom * factor));
  view.u = u - x / view.zoom;
  view.v = v - y / view.zoom;
  draw();
}

function path(places, closed) {
  pen.beginPath();
  let open = false;
  for (const place of places) {
    if (!place) { open = false; continue; }
    const [x, y] = toScreen(place);
    open ? pen.lineTo(x, y) : pen.moveTo(x, y);
    open = true;
  }
  if (closed) pen.closePath();
}
function label(text, [x, y], colour) {
  pen.font = "600 13px system-ui, sans-serif";
  const width = pen.measureText(text).width;
  pen.fillStyle = "#101820d0";
  pen.fillRect(x, y - 15, width + 8, 19);
  pen.fillStyle = colour || "#fff";
  pen.fillText(text, x + 4, y - 1);
}
function ring(place, colour, text, strong) {
  const [x, y] = toScreen(place);
  pen.lineWidth = strong ? 4 : 2.5;
  for (const [shade, extra] of [["#101820", 2], [colour, 0]]) {
    pen.strokeStyle = shade;
    pen.lineWidth = (strong ? 3.5 : 2) + extra;
    pen.beginPath(); pen.arc(x, y, 8, 0, 7); pen.stroke();
  }
  pen.fillStyle = colour;
  pen.fillRect(x - 1, y - 1, 2, 2);
  if (text) label(text, [x + 12, y - 4], colour);
}
function isFree([x, y], taken) {
  return !taken.some((other) => Math.abs(other[0] - x) < 75 && Math.abs(other[1] - y) < 22);
}
function draw() {
  const scale = devicePixelRatio || 1, wide = canvas.clientWidth, high = canvas.clientHeight;
  if (canvas.width !== wide * scale || canvas.height !== high * scale) {
    canvas.width = wide * scale; canvas.height = high * scale;
  }
  pen.setTransform(scale, 0, 0, scale, 0, 0);
  pen.clearRect(0, 0, wide, high);
  pen.imageSmoothingEnabled = view.zoom < 4;
  if (picture.complete) pen.drawImage(picture, ...toScreen([0, 0]), begin.size[0] * view.zoom, begin.size[1] * view.zoom);
  const known = result && result.grid, taken = [];
  if (known) {
    for (const line of result.grid) {
      pen.strokeStyle = line.strong ? "#00e5ffcc" : "#00e5ff55";
      pen.lineWidth = line.strong ? 1.6 : 1;
      path(line.line); pen.stroke();
    }
    for (const line of result.grid.filter((l) => l.label)) {
      const shown = line.line.filter(Boolean).map(toScreen)
        .filter(([x, y]) => x > 4 && y > 50 && x < wide - 200 && y < high - 40);
      const spot = [Math.floor(shown.length / 2), 0, shown.length - 1].map((i) => shown[i])
        .find((s) => s && isFree(s, taken));
      if (spot) { taken.push(spot); label(line.label, spot, "#7ff1ff"); }
    }
    pen.setLineDash([10, 7]); pen.lineWidth = 2; pen.strokeStyle = "#ffe14d";
    path(result.horizon); pen.stroke(); pen.setLineDash([]);
    const crown = result.horizon.find(Boolean);
    if (crown) { const [x, y] = toScreen(crown); label("horizon", [Math.max(6, x + 6), Math.max(18, y - 5)], "#ffe14d"); }
    result.outlines.forEach((outline, i) => {
      path(outline, true); pen.fillStyle = "#0b62a83a"; pen.fill();
      pen.strokeStyle = "#5db4ff"; pen.lineWidth = 3; pen.stroke();
      const first = outline.find(Boolean);
      if (first && sheet.segments[i]) label(sheet.segments[i].id, toScreen(first), "#9fd2ff");
    });
  }
  for (const vehicle of vehicles) {
    pen.strokeStyle = "#fff"; pen.lineWidth = 2; path(vehicle.path); pen.stroke();
  }
  // Far ones are named once there is room: when zoomed.
  vehicles.map((vehicle) => [vehicle.kmh, toScreen(vehicle.path[vehicle.path.length >> 1])])
    .sort((a, b) => b[1][1] - a[1][1])
    .forEach(([kmh, spot]) => {
      if (isFree(spot, taken)) { taken.push(spot); label(`${kmh.toFixed(0)} km/h`, spot); }
    });
  sheet.lines.forEach((line) => {
    pen.strokeStyle = COLOURS.line; pen.lineWidth = 1.5; path(line.image); pen.stroke();
    line.image.forEach((place, i) => ring(place, COLOURS.line, i ? "" : `y ${line.offset} m`));
  });
  sheet.points.forEach((point, i) => {
    const fitted = known && fittedAt(i);
    const wrong = fitted && !fitted.used;
    const colour = wrong ? COLOURS.bad : point.guess ? COLOURS.guess : COLOURS.point;
    if (fitted && fitted.at) {
      const [x, y] = toScreen(fitted.at), [u, v] = toScreen(point.image);
      // The miss is drawn ten times as long as it is, so that it is seen.
      pen.strokeStyle = colour; pen.lineWidth = 2;
      pen.beginPath(); pen.moveTo(u, v); pen.lineTo(u + 10 * (x - u), v + 10 * (y - v)); pen.stroke();
    }
    ring(point.image, colour, `${numberOf(i) || "x, y?"}`, i === chosen);
  });
  if (check.length) {
    pen.strokeStyle = COLOURS.check; pen.lineWidth = 3; path(check); pen.stroke();
    check.forEach((place, i) => ring(place, COLOURS.check, i || checkMetres === null ? "" : `${checkMetres.toFixed(2)} m`));
  }
  corners.forEach((place) => ring(place, "#5db4ff", "corner"));
  loupe();
}
function loupe() {
  const glass = byId("loupe"), show = pointer && pointer.fine;
  glass.style.display = show ? "block" : "none";
  if (!show) return;
  const brush = glass.getContext("2d"), [u, v] = toPicture(pointer.x, pointer.y);
  const power = Math.max(6, 2 * view.zoom), half = 88 / power;
  brush.imageSmoothingEnabled = false;
  brush.fillStyle = "#20262c"; brush.fillRect(0, 0, 176, 176);
  brush.drawImage(picture, u - half, v - half, 2 * half, 2 * half, 0, 0, 176, 176);
  brush.strokeStyle = "#ff4d42"; brush.lineWidth = 1;
  brush.beginPath(); brush.moveTo(88, 60); brush.lineTo(88, 116); brush.moveTo(60, 88); brush.lineTo(116, 88); brush.stroke();
  glass.style.right = pointer.x > canvas.clientWidth - 220 && pointer.y < 220 ? "auto" : "10px";
  glass.style.left = glass.style.right === "auto" ? "10px" : "auto";
}

// Panels.
function tag(name, attributes, ...inside) {
  const element = document.createElement(name);
  for (const [key, value] of Object.entries(attributes || {})) {
    if (key.startsWith("on")) element.addEventListener(key.slice(2), value);
    else if (value !== undefined) element.setAttribute(key, value);
  }
  element.append(...inside);
  return element;
}
// Puts new content in, and keeps what is alike: a field that has or gets the focus must stay. Handlers go by index, and
// what has one has a name (aria-label), so that those kept are the right ones.
function renew(holder, fresh) {
  fresh.forEach((next, i) => {
    const old = holder.childNodes[i];
    if (!old) { holder.append(next); return; }
    if (next.nodeType === Node.TEXT_NODE && old.nodeType === Node.TEXT_NODE) { old.data = next.data; return; }
    const name = (node) => node.nodeName + (node.getAttribute ? node.getAttribute("aria-label") : "");
    if (name(old) !== name(next)) { old.replaceWith(next); return; }
    for (const { name: key, value } of next.attributes) old.setAttribute(key, value);
    renew(old, [...next.childNodes]);
    const typing = old.nodeName === "INPUT" && old === document.activeElement;
    if ("value" in next && !typing && old.value !== next.value) old.value = next.value;
  });
  while (holder.childNodes.length > fresh.length) holder.lastChild.remove();
}
const number = (value, what, set, extra) => tag("input", {
  type: "number", step: "any", value: value === null ? "" : value, "aria-label": what, ...extra,
  onchange: (event) => { const n = Number(event.target.value); if (event.target.value !== "" && Number.isFinite(n)) set(n); },
});
const field = (text, input) => tag("label", { class: "row" }, text, input);
function list() {
  renew(byId("points"), sheet.points.map((point, i) => tag("tr", {
    class: i === chosen ? "chosen" : "", onclick: () => { if (chosen !== i) { chosen = i; mark(); } },
  },
  tag("td", {}, `${numberOf(i) || "?"}`),
  ...[0, 1].map((axis) => tag("td", {}, number(point.road[axis], `${"xy"[axis]} of point ${i + 1}`,
    (n) => change(() => { sheet.points[i].road[axis] = n; delete sheet.points[i].guess; })))),
  tag("td", { class: "miss" }),
  tag("td", {}, tag("button", { class: "small", "aria-label": `Delete point ${i + 1}`, onclick: (event) => { event.stopPropagation(); drop(i); } }, "×")))));
  const drawn = [];
  sheet.lines.forEach((line, i) => drawn.push(tag("div", { class: "row" }, `Line, ${line.image.length} points, y`,
    number(line.offset, `y of line ${i + 1}`, (n) => change(() => { sheet.lines[i].offset = n; })),
    tag("button", { class: "small", "aria-label": `Delete line ${i + 1}`, onclick: () => change(() => sheet.lines.splice(i, 1)) }, "×"))));
  sheet.segments.forEach((segment, i) => {
    const edit = (key) => (event) => change(() => { sheet.segments[i][key] = event.target.value; });
    drawn.push(tag("h2", {}, `Segment ${i + 1}`),
      field("Id", tag("input", { type: "text", "aria-label": `id of segment ${i + 1}`, value: segment.id, onchange: edit("id") })),
      field("Travels", tag("select", { "aria-label": `direction of segment ${i + 1}`, onchange: (event) => change(() => { sheet.segments[i].direction = [Number(event.target.value), 0]; }) },
        ...[["1", "towards larger x"], ["-1", "towards smaller x"]].map(([value, text]) =>
          tag("option", { value, selected: Math.sign(segment.direction[0]) === Number(value) ? "" : undefined }, text)))),
      field("Lanes", number(segment.lanes, `lanes of segment ${i + 1}`, (n) => change(() => { sheet.segments[i].lanes = Math.max(1, Math.round(n)); }))),
      field("Lane width, m", number(segment.lane_width_m, `lane width of segment ${i + 1}`, (n) => change(() => { sheet.segments[i].lane_width_m = n; }))),
      tag("button", { class: "small", "aria-label": `Delete segment ${i + 1}`, onclick: () => change(() => sheet.segments.splice(i, 1)) }, "Delete segment"));
  });
  renew(byId("drawn"), drawn);
  byId("undo").disabled = !past.length;
  byId("redo").disabled = !future.length;
  misses();
}
function mark() {
  [...byId("points").children].forEach((line, i) => { line.className = i === chosen ? "chosen" : ""; });
  draw();
}
function misses() {
  [...byId("points").querySelectorAll(".miss")].forEach((cell, i) => {
    const point = fittedAt(i);
    cell.textContent = point ? (point.miss === null ? "?" : point.miss.toFixed(2)) : "";
    cell.className = "miss" + (point && !point.used ? " bad" : "");
  });
}
const NAMES = { lens: "lens distortion", arc: "bend", crest: "crest or sag" };
function show() {
  byId("problem").textContent = result.problem || "";
  misses();
  if (result.problem) { byId("figures").replaceChildren(); return; }
  const pairs = [["Reprojection error", `${result.rms_px.toFixed(2)} px`],
    ["Road", result.terms.length ? result.terms.map((t) => NAMES[t]).join(", ") : "plane"]];
  if (result.pose) pairs.push(["Camera's height", `${result.pose.height_m.toFixed(1)} m`]);
  for (const end of result.ends || []) pairs.push([`Speed error, ${end.segment}, ${end.end} end`,
    Number.isFinite(end.speed_error) ? `${(100 * end.speed_error).toFixed(1)} %` : "?"]);
  const figures = [tag("dl", { class: "figures" }, ...pairs.flatMap(([name, value]) => [tag("dt", {}, name), tag("dd", {}, value)]))];
  if (sheet.points.some((p) => p.guess)) figures.push(tag("p", { class: "warn" },
    `A guess from the traffic, lengths ±${(100 * (guessError || 0.1)).toFixed(0)} %: replace its points by measured ones.`));
  if (!sheet.points.every(isTyped)) figures.push(tag("p", { class: "warn" }, "A point without x and y takes no part."));
  if (result.live) figures.push(tag("p", {}, "…"));
  for (const warning of result.warnings || []) figures.push(tag("p", { class: "warn" }, warning));
  if (!sheet.segments.length) figures.push(tag("p", { class: "warn" }, "No segment yet: mark what is to be watched, then the speed error is shown too."));
  byId("figures").replaceChildren(...figures);
}
function options() {
  const row = sheet.row;
  modeButtons().forEach((b) => b.setAttribute("aria-pressed", String(b.dataset.mode === mode)));
  byId("hint").textContent = HINTS[mode];
  const box = [];
  if (mode === "dashes") {
    const marks = begin.presets[row.preset];
    box.push(tag("h2", {}, "Row of dashes"),
      field("Marks of", tag("select", { id: "preset", "aria-label": "marks", onchange: (event) => { sheet.row.preset = Number(event.target.value); options(); } },
        ...begin.presets.map((m, i) => tag("option", { value: i, selected: i === row.preset ? "" : undefined }, m.name)))),
      tag("p", {}, `Dashes of ${marks.dash_m} m every ${marks.period_m} m, lanes of ${marks.lane_width_m} m: by the rules, so check on site.`),
      field("x of the next click, m", number(row.x, "x of the next click", (n) => { sheet.row.x = n; })),
      field("y of this row, m", number(row.y, "y of this row", (n) => { sheet.row.y = n; })),
      tag("div", { class: "buttons" },
        tag("button", { onclick: () => newRow(1) }, "Next row, left"), tag("button", { onclick: () => newRow(-1) }, "Next row, right"),
        tag("button", { title: "a dash that cannot be seen", onclick: () => { step(); options(); } }, "Leave one out")));
  } else if (mode === "line") {
    box.push(tag("h2", {}, "Line of known y"), field("y, m", number(lineY, "y of the line", (n) => { lineY = n; chosen = -1; })));
  } else if (mode === "check") {
    box.push(tag("h2", {}, "Check"),
      field("True length, m", number(checkKnown ? checkKnown.m : "", "true length", (n) => { checkKnown = { ...checkKnown, m: n }; options(); })),
      field("Or time of a vehicle over it, s", number(checkKnown && checkKnown.s ? checkKnown.s : "", "time", (n) => { checkKnown = { ...checkKnown, s: n }; options(); })));
    if (checkMetres !== null) {
      const off = checkKnown && checkKnown.m ? 100 * (checkMetres / checkKnown.m - 1) : null;
      box.push(tag("p", { id: "checked", class: off === null ? "" : Math.abs(off) <= 2 ? "good" : "bad" },
        `Measured ${checkMetres.toFixed(2)} m` + (off === null ? "" : `, ${off >= 0 ? "+" : ""}${off.toFixed(1)} %`)
        + (checkKnown && checkKnown.s ? `; ${(3.6 * checkMetres / checkKnown.s).toFixed(1)} km/h` : "")));
    }
  }
  // Fields of another mode are other fields.
  if (byId("options").dataset.mode !== mode) byId("options").replaceChildren();
  byId("options").dataset.mode = mode;
  renew(byId("options"), box);
}
function step() { sheet.row.x = Math.round(100 * (sheet.row.x + begin.presets[sheet.row.preset].period_m)) / 100; }
function newRow(side) {
  const row = sheet.row;
  row.y = Math.round(100 * (row.y + side * begin.presets[row.preset].lane_width_m)) / 100;
  row.x = 0;
  options();
}
function setMode(next) { mode = next; corners = []; options(); draw(); }

// Adding, moving and dropping.
let adding = Promise.resolve();
function clicked(place) {
  // One after the other: each dash's x follows from the one before.
  adding = adding.then(() => add(place)).catch(() => { byId("problem").textContent = "the server does not answer: is it still running?"; });
}
async function add(place) {
  const how = mode, x = sheet.row.x, y = sheet.row.y;
  if (how === "segment") { corners.push(place); draw(); if (corners.length === 2) await outline(); return; }
  if (byId("snap").checked) place = (await ask("snap", { u: place[0], v: place[1] })).image;
  if (how === "check") {
    check = check.length === 2 ? [place] : [...check, place];
    checkMetres = null;
    draw();
    return remeasure();
  }
  if (how === "line") {
    return change(() => {
      const last = sheet.lines.find((line) => line.offset === lineY);
      last ? last.image.push(place) : sheet.lines.push({ offset: lineY, image: [place] });
    });
  }
  change(() => {
    // A guess gives way to what is measured.
    sheet.points = sheet.points.filter((p) => !p.guess);
    const road = how === "dashes" ? [Math.round(100 * x) / 100, y] : [null, null];
    sheet.points.push({ image: place, road });
    chosen = sheet.points.length - 1;
    if (how === "dashes" && sheet.row.x === x && sheet.row.y === y) step();
  });
  if (how === "point") { const input = byId("points").lastElementChild.querySelector("input"); input.focus(); input.select(); }
}
async function outline() {
  const answer = await ask("measure", { ends: corners, fit: lastFit });
  corners = [];
  if (answer.problem) { byId("problem").textContent = answer.problem; draw(); return; }
  const round = (n) => Math.round(2 * n) / 2, [[x0, y0], [x1, y1]] = answer.road;
  const low = [Math.min(x0, x1), Math.min(y0, y1)].map(round), high = [Math.max(x0, x1), Math.max(y0, y1)].map(round);
  const lane = begin.presets[sheet.row.preset].lane_width_m, lanes = Math.max(1, Math.round((high[1] - low[1]) / lane));
  change(() => sheet.segments.push({
    id: `segment${sheet.segments.length + 1}`, polygon: [low, [high[0], low[1]], high, [low[0], high[1]]],
    direction: [1, 0], lanes, lane_width_m: lane,
  }));
}
async function remeasure() {
  if (check.length !== 2) return;
  const answer = await ask("measure", { ends: check, fit: lastFit });
  checkMetres = answer.problem ? null : answer.metres;
  if (answer.problem) byId("problem").textContent = answer.problem;
  if (mode === "check") options();
  draw();
}
function drop(i) {
  change(() => {
    const [dropped] = sheet.points.splice(i, 1), row = sheet.row, [x, y] = dropped.road;
    chosen = -1;
    // The last dash is clicked again.
    const back = Math.abs(x + begin.presets[row.preset].period_m - row.x) < 0.01;
    if (mode === "dashes" && i === sheet.points.length && y === row.y && back) row.x = x;
  });
}
function nudge(du, dv) {
  const point = sheet.points[chosen];
  if (!point) return;
  change(() => { point.image = [point.image[0] + du, point.image[1] + dv]; });
}

// Pointer: a click adds, a drag of a point moves it, a drag elsewhere moves the picture.
const fingers = new Map();
let drag = null;
const nearest = (x, y) => {
  let best = -1, least = 14;
  sheet.points.forEach((point, i) => { const [a, b] = toScreen(point.image), d = Math.hypot(a - x, b - y); if (d < least) { least = d; best = i; } });
  return best;
};
// A drag that ends in none leaves its point where it was.
function abandon() {
  if (drag && drag.moved && drag.point >= 0) { sheet = JSON.parse(drag.before); changed(); }
  drag = null;
}
canvas.addEventListener("pointerdown", (event) => {
  if (event.button !== 0) return;
  canvas.setPointerCapture(event.pointerId);
  fingers.set(event.pointerId, [event.offsetX, event.offsetY]);
  if (fingers.size > 1) { abandon(); return; }
  const point = nearest(event.offsetX, event.offsetY);
  drag = { x: event.offsetX, y: event.offsetY, point, moved: false, before: JSON.stringify(sheet), view: { ...view } };
  if (point >= 0) { chosen = point; mark(); }
});
canvas.addEventListener("pointermove", (event) => {
  pointer = { x: event.offsetX, y: event.offsetY, fine: true };
  if (fingers.size === 2 && fingers.has(event.pointerId)) {
    const [a, b] = [...fingers.values()], apart = Math.hypot(a[0] - b[0], a[1] - b[1]);
    fingers.set(event.pointerId, [event.offsetX, event.offsetY]);
    const [c, d] = [...fingers.values()];
    zoomAt((c[0] + d[0]) / 2, (c[1] + d[1]) / 2, Math.hypot(c[0] - d[0], c[1] - d[1]) / Math.max(apart, 1));
    return;
  }
  if (drag) {
    const dx = event.offsetX - drag.x, dy = event.offsetY - drag.y;
    if (Math.hypot(dx, dy) > 4) drag.moved = true;
    if (drag.moved && drag.point >= 0) {
      sheet.points[drag.point].image = toPicture(event.offsetX, event.offsetY);
      fit(true);
    } else if (drag.moved) {
      fitted = false;
      view.u = drag.view.u - dx / view.zoom;
      view.v = drag.view.v - dy / view.zoom;
    }
  }
  draw();
});
canvas.addEventListener("pointerup", (event) => {
  fingers.delete(event.pointerId);
  canvas.focus();
  const done = drag;
  drag = null;
  if (!done) return;
  if (done.moved && done.point >= 0) { past.push(done.before); future = []; changed(); }
  else if (!done.moved && done.point < 0) {
    const place = toPicture(event.offsetX, event.offsetY);
    if (place[0] >= 0 && place[1] >= 0 && place[0] <= begin.size[0] && place[1] <= begin.size[1]) clicked(place);
  } else if (!done.moved && mode === "check") clicked([...sheet.points[done.point].image]);
});
canvas.addEventListener("pointercancel", (event) => { fingers.delete(event.pointerId); abandon(); });
canvas.addEventListener("pointerleave", () => { pointer = null; draw(); });
canvas.addEventListener("wheel", (event) => { event.preventDefault(); zoomAt(event.offsetX, event.offsetY, Math.exp(-event.deltaY / 400)); }, { passive: false });
document.addEventListener("keydown", (event) => {
  const typing = ["INPUT", "SELECT"].includes(/** @type {Element} */ (event.target).tagName), key = event.key.toLowerCase();
  if ((event.ctrlKey || event.metaKey) && (key === "z" || key === "y") && !typing) {
    event.preventDefault();
    key === "y" || event.shiftKey ? travel(future, past) : travel(past, future);
  }
  if (typing || event.ctrlKey || event.metaKey || event.altKey) return;
  const by = event.shiftKey ? 2 : 0.25, moves = { arrowleft: [-by, 0], arrowright: [by, 0], arrowup: [0, -by], arrowdown: [0, by] };
  if (moves[key] && document.activeElement === canvas) { event.preventDefault(); nudge(...moves[key]); }
  else if ((key === "delete" || key === "backspace") && chosen >= 0) drop(chosen);
  else if (key === "0") whole();
  else if (key === "+" || key === "-") zoomAt(canvas.clientWidth / 2, canvas.clientHeight / 2, key === "+" ? 1.25 : 0.8);
  else if ("12345".includes(key)) setMode(Object.keys(HINTS)[Number(key) - 1]);
});

// Traffic, guess, save.
async function follow(what, done) {
  const button = byId(what);
  button.disabled = true;
  try {
    for (;;) {
      const about = lastFit, answer = await ask(what, { fit: about });
      const stale = what === "traffic" && (about !== lastFit || busy);
      if (answer.progress === undefined && !stale) { answer.problem ? byId("speeds").textContent = answer.problem : done(answer); break; }
      byId("speeds").textContent = `Looking for vehicles: ${(100 * (answer.progress === undefined ? 1 : answer.progress)).toFixed(0)} %`;
      await new Promise((wait) => setTimeout(wait, 500));
    }
  } catch { byId("speeds").textContent = "the server does not answer: is it still running?"; }
  button.disabled = false;
}
byId("traffic").addEventListener("click", () => follow("traffic", (answer) => {
  vehicles = answer.vehicles;
  const speeds = vehicles.map((v) => v.kmh).sort((a, b) => a - b);
  byId("speeds").textContent = speeds.length
    ? `${speeds.length} vehicles, ${speeds[0].toFixed(0)} to ${speeds[speeds.length - 1].toFixed(0)} km/h, middle ${speeds[speeds.length >> 1].toFixed(0)} km/h`
    : "No vehicle could be followed on the calibrated road.";
  draw();
}));
byId("guess").addEventListener("click", () => follow("guess", (answer) => {
  guessError = answer.relative_error;
  change(() => { sheet.points = answer.points.map((point) => ({ ...point, guess: true })); chosen = -1; });
  byId("speeds").textContent = `Guessed from ${answer.vehicles} cars: lengths ±${(100 * guessError).toFixed(0)} %.`;
}));
byId("save").addEventListener("click", async () => {
  let answer;
  try { answer = await ask("save", asked()); } catch { answer = { problem: "the server does not answer: is it still running?" }; }
  byId("saved").textContent = answer.saved || answer.problem;
  byId("saved").className = answer.saved ? "good" : "bad";
});
byId("undo").addEventListener("click", () => travel(past, future));
byId("redo").addEventListener("click", () => travel(future, past));
byId("whole").addEventListener("click", whole);
byId("terms").addEventListener("change", () => fit(false));
modeButtons().forEach((button) => button.addEventListener("click", () => setMode(button.dataset.mode)));
new ResizeObserver(() => (fitted ? whole() : draw())).observe(canvas);

(async () => {
  const answer = await fetch(`/begin?key=${encodeURIComponent(KEY)}`);
  begin = await answer.json();
  if (!answer.ok) { byId("problem").textContent = begin.problem; return; }
  sheet = { ...sheet, points: begin.points, lines: begin.lines, segments: begin.segments };
  if (begin.terms) {
    const text = JSON.stringify(begin.terms), known = [...byId("terms").options].some((one) => one.value === text);
    if (!known) byId("terms").append(tag("option", { value: text }, begin.terms.map((t) => NAMES[t]).join(", ")));
    byId("terms").value = text;
  }
  for (const id of ["traffic", "guess"]) byId(id).disabled = !begin.moving;
  if (!begin.moving) byId("speeds").textContent = "A single picture has no traffic: start with a clip or a camera.";
  byId("save").textContent = `Save as ${begin.out.split("/").pop()}`;
  picture.onload = whole;
  picture.src = `/picture.png?key=${encodeURIComponent(KEY)}`;
  list(); options(); fit(false);
})();
