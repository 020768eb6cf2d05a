// The charts: the tatami from above, what all believe together, how the movement is done, and the last minute.
import { $, attribute, draw, hide, make, mark, put, rowsOf, share } from "./elements.js";
import { CROWD, bars } from "./judges.js";
import { age, bits, count, nowWords, percent, sight, tone, verdictWords, words } from "./words.js";

export const MINUTE_MS = 60000;
const HEIGHT = 170, TOP = [24, 82], LOW = [102, 148];

/* A chart that nobody sees is not drawn: on a phone that is most of the time. appeared: called when one comes into view. */
const inView = new Set();
export function watchCharts(appeared) {
  const watcher = new IntersectionObserver((entries) => {
    for (const { target, isIntersecting } of entries) if (isIntersecting) inView.add(target.id); else inView.delete(target.id);
    appeared();
  });
  for (const id of ["tatami", "strip"]) watcher.observe($(id));
}

export function showCharts(setup, state, verdicts, minute) {
  bars($("fused"), state.fused);
  put($("agreement"), nowWords(state) || "-");
  put($("entropy"), bits(state.entropy));
  showManner(state);
  if (inView.has("tatami")) showMat(setup, state);
  if (inView.has("strip")) showStrip(state, verdicts, minute);
}

/* Facets: rows of two poles and a bar from the middle to the likelier one. */
function facets(list, leanings) {
  const nodes = rowsOf(list, leanings.length, () => make("li", "", make("span", "pole"), make("span", "tug", make("i")), make("span", "pole"), make("span", "unseen")));
  leanings.forEach(([facet, first, last, lean, value, p], i) => {
    const [left, bar, right, spoken] = nodes[i].children;
    put(left, first);
    put(right, last);
    attribute(nodes[i], "title", `${facet.replace("_", ", ")}: ${value} ${percent(p)}`);
    left.classList.toggle("held", value === first);
    right.classList.toggle("held", value === last);
    share(bar.firstChild, (lean / 2).toFixed(3));
    put(spoken, `: ${value} ${percent(p)}`);
  });
}
function showManner(state) {
  hide($("manner"), state.facets.length === 0);
  for (const kind of ["effort", "shape"]) facets($(kind), state.facets.filter((facet) => facet[0].startsWith(`${kind}_`)));
  hide($("facing-fact"), state.facing === null);
  if (state.facing !== null) put($("facing"), state.facing[1]);
}

/* The tatami from above, the performer's front at the top. */
const flags = new Map();
function spot(position) {
  const angle = position.azimuth * Math.PI / 180, x = Math.sin(angle), y = -Math.cos(angle);
  const reach = 152 / Math.max(Math.abs(x), Math.abs(y));
  return { x: x * reach, y: y * reach };
}
const grid = (most, reach) => {
  const seams = [];
  for (let at = -most; at <= most; at += 40) seams.push(`M${at} -${reach}V${reach}M-${reach} ${at}H${reach}`);
  return seams.join("");
};
export function layMat(positions) {
  const mat = $("tatami"), names = Object.keys(positions), quiet = names.length > CROWD;
  mat.replaceChildren(
    draw("rect", { class: "band", x: -200, y: -200, width: 400, height: 400 }), draw("path", { class: "band-seam", d: grid(160, 200), fill: "none" }),
    draw("rect", { class: "area", x: -178, y: -178, width: 356, height: 356 }), draw("path", { class: "seam", d: grid(120, 178), fill: "none" }),
    // Which way the person faces, on the edge of the referee's disc.
    draw("g", { id: "needle", hidden: "" }, draw("path", { d: "M-12 -88L0 -122L12 -88Z" })));
  // An observer in front marks the front by itself.
  if (!Object.values(positions).some(({ azimuth }) => Math.min(azimuth, 360 - azimuth) < 25)) {
    mat.append(draw("text", { class: "front", x: 0, y: -129 }, "front"), draw("path", { class: "nose", d: "M-8 -142L0 -150L8 -142" }));
  }
  flags.clear();
  const spots = names.map((name) => spot(positions[name]));
  names.forEach((name, i) => flags.set(name, flag(name, spots[i], quiet, quiet && i % 2 ? 0.92 : 1)));
  // Words short enough for the judges beside it.
  names.forEach((name, i) => { flags.get(name).most = spots.some((other, j) => j !== i && Math.hypot(other.x - spots[i].x, other.y - spots[i].y) < 120) ? 11 : 15; });
  for (const { group } of flags.values()) mat.append(group);
  attribute(mat, "aria-label", `The tatami from above with ${count(names.length, "judge")} around the referee`);
}
function flag(name, place, quiet, near) {
  const x = place.x * near, y = place.y * near, reach = Math.hypot(x, y);
  const ray = draw("line", { class: "sight", x1: x, y1: y, x2: x / reach * 96, y2: y / reach * 96, stroke: "var(--tone)" });
  const dot = draw("circle", { class: "dot", cx: x, cy: y, r: quiet ? 3.5 : 9 });
  const middle = Math.abs(x) < 110, anchor = middle ? "middle" : x < 0 ? "start" : "end";
  const textX = middle ? x : x < 0 ? x - 12 : x + 12, textY = y + (y < 0 ? 28 : -32);
  const who = draw("text", { x: textX, y: textY, "text-anchor": anchor }, quiet ? "" : shortened(name, 16));
  const held = draw("text", { class: "held", x: textX, y: textY + 16, "text-anchor": anchor });
  return { group: draw("g", { class: "flag", "data-stance": "silent" }, ray, dot, who, held), ray, held, quiet };
}
const shortened = (text, most) => text.length > most ? `${text.slice(0, most - 1)}…` : text;
function showMat(setup, state) {
  put($("phase"), state.silent ? `referee silent ${age(state.silence)}` : !state.judged ? "no referee" : state.waiting ? "waiting for observers" : state.moving ? "moving" : "at rest");
  put($("now"), state.moving && !state.silent && !state.waiting && state.label !== null ? words(state.label) : "");
  const needle = $("needle");
  needle.toggleAttribute("hidden", state.facing === null);
  if (state.facing !== null) attribute(needle, "transform", `rotate(${-state.facing[0]})`);
  for (const observer of state.observers) {
    const parts = flags.get(observer.name);
    if (!parts) continue;
    const rests = tone(observer, state.moving) === "rests";
    mark(parts.group, "stance", tone(observer, state.moving));
    attribute(parts.ray, "stroke-width", parts.quiet ? 0.6 : (1 + 12 * observer.weight).toFixed(1));
    if (!parts.quiet) put(parts.held, rests ? "no movement" : shortened(observer.heard && observer.label && !observer.gone ? words(observer.label) : sight(observer, state, setup.sure).replace(/^is /, ""), parts.most));
  }
}

/* The last minute: belief above, entropy below, verdicts as bands from their beginning to their end. */
function showStrip(state, verdicts, minute) {
  const strip = $("strip"), width = strip.clientWidth;
  if (!width) return;
  attribute(strip, "viewBox", `0 0 ${width} ${HEIGHT}`);
  const left = 46, right = width - 6, x = (ms) => left + (right - left) * (1 - (state.now - ms) / MINUTE_MS);
  const most = Math.max(1, Math.log2(Math.max(2, state.labels)));
  const points = minute.filter((point) => point[0] >= state.now - MINUTE_MS && point[0] <= state.now + 500);
  const path = (index, scale, [top, bottom]) => points.map((point, i) => {
    const gap = i === 0 || point[0] - points[i - 1][0] > 2000;
    return `${gap ? "M" : "L"}${x(point[0]).toFixed(1)} ${(bottom - (bottom - top) * Math.min(1, point[index] / scale)).toFixed(1)}`;
  }).join("");
  strip.replaceChildren(
    ...times(state, x, width), ...bands(state, verdicts, x, left, right),
    text(left - 6, TOP[0] + 8, "100%", "end"), text(left - 6, TOP[1], "0", "end"),
    text(left - 6, LOW[0] + 8, `${most.toFixed(1)} bit`, "end"), text(left - 6, LOW[1], "0", "end"),
    draw("path", { class: "believed", d: path(2, 1, TOP) }), draw("path", { class: "bits", d: path(3, most, LOW) }));
  attribute(strip, "aria-label", `Belief and entropy over the last minute${verdicts.length ? `; last verdict ${words(verdicts[0].label)}` : ""}`);
}
function times(state, x, width) {
  const parts = [];
  for (let ago = 0; ago <= 60; ago += 10) {
    const at = x(state.now - ago * 1000).toFixed(1);
    parts.push(draw("line", { class: "grid", x1: at, x2: at, y1: TOP[0], y2: LOW[1] }));
    if (ago % (width < 500 ? 20 : 10) === 0) parts.push(text(at, HEIGHT - 6, ago ? `-${ago} s` : "now", ago === 0 ? "end" : "middle"));
  }
  return parts;
}
function bands(state, verdicts, x, left, right) {
  const parts = [], inside = (ms) => Math.min(right, Math.max(left, x(ms)));
  let free = 0;
  for (const each of [...verdicts].reverse()) {
    const end = each.ended ?? state.now;
    if (end < state.now - MINUTE_MS || each.began > state.now) continue;
    const from = inside(each.began), to = inside(end), kind = each.abstain ? " abstain" : "";
    parts.push(draw("rect", { class: `span${kind}`, x: from, y: TOP[0], width: Math.max(2, to - from), height: LOW[1] - TOP[0], rx: 3 }));
    if (!each.abstain && each.decided >= state.now - MINUTE_MS) parts.push(draw("line", { class: "decided", x1: inside(each.decided), x2: inside(each.decided), y1: TOP[0], y2: LOW[1] }));
    const name = verdictWords(each), wide = name.length * 7.4, start = Math.min(from, right - wide);
    if (start >= free) { parts.push(text(start, 16, name, "start", `label${kind}`)); free = start + wide + 8; }
  }
  return parts;
}
function text(x, y, content, anchor, name = "") {
  return draw("text", { x, y, "text-anchor": anchor, class: name }, content);
}
