// The page: turns server-sent events into the tatami, the strip and the log. All data is text, never HTML.
// An observer is shown to people as a judge, and fusion as the referee.
"use strict";

const $ = (id) => document.getElementById(id);
const MINUTE_MS = 60000, CROWD = 12, QUIET_MS = 4000, AGAIN_MS = 1000, LOG_LIMIT = 100, LOG_SHOWN = 12;
const SVG = "http://www.w3.org/2000/svg";
const known = { setup: null, state: null, verdicts: [], minute: [], updated: 0 };
const replay = { playing: true, head: 0, dragging: false };
let source = null, again = 0, announced = new Map();

/* Making and changing elements: only what differs is touched, so that nothing flickers and focus stays. */
function make(tag, name, ...children) {
  const node = document.createElement(tag);
  if (name) node.className = name;
  node.append(...children);
  return node;
}
function draw(tag, attributes, ...children) {
  const node = document.createElementNS(SVG, tag);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  node.append(...children);
  return node;
}
const put = (node, text) => { if (node.textContent !== text) node.textContent = text; };
const mark = (node, key, value) => { if (node.dataset[key] !== value) node.dataset[key] = value; };
const attribute = (node, key, value) => { if (node.getAttribute(key) !== String(value)) node.setAttribute(key, value); };
function share(node, value) {
  if (node.shown !== value) { node.shown = value; node.style.setProperty("--share", value); }
}

/* Words. */
const percent = (value) => `${Math.round(value * 100)}%`;
const bits = (value) => value === null ? "-" : `${value.toFixed(2)} bit`;
const words = (label) => label.replaceAll("_", " ");
const verdictWords = (verdict) => (verdict.revises === null ? "" : `${words(verdict.revises)} → `) + words(verdict.label);
function age(seconds) {
  if (seconds === null) return "-";
  if (seconds < 1) return `${Math.round(seconds * 1000)} ms`;
  return seconds < 120 ? `${seconds.toFixed(1)} s` : `${Math.round(seconds / 60)} min`;
}
const clock = (ms) => new Date(ms).toLocaleTimeString([], { hourCycle: "h23" });
const took = (verdict) => verdict.ended === null ? "now" : age((verdict.ended - verdict.began) / 1000);
const agree = (pair) => pair ? `${pair[0]} of ${pair[1]}` : "-";
const count = (number, noun) => `${number} ${noun}${number === 1 ? "" : "s"}`;
// "agrees" is what the judgement counts as its k of n; a stale observer is still heard.
function stance(observer) {
  if (observer.gone) return "gone";
  if (!observer.heard) return observer.state;
  return observer.label === null ? "undecided" : observer.agrees ? "agrees" : "differs";
}
const isStale = (observer) => observer.state === "stale" && !observer.gone;
const stanceWords = (observer) => stance(observer) + (isStale(observer) ? ", stale" : "");
const tone = (observer) => observer.gone ? "silent" : isStale(observer) ? "stale" : stance(observer);
function health(observer) {
  const status = observer.health ? [observer.health.state, observer.health.rate === null ? "" : `${observer.health.rate} Hz`, observer.health.reason] : [];
  const clockOff = observer.skew !== null && Math.abs(observer.skew) >= 0.5 ? `clock ${observer.skew > 0 ? "+" : "-"}${age(Math.abs(observer.skew))}` : "";
  const rejected = observer.same_id ? "two processes have this id" : observer.rejected ? count(observer.rejected, "bad message") : "";
  const lies = observer.contradicted === null ? "" : `the others contradict it: ${percent(observer.contradicted)} trusted`;
  const doubted = observer.rest_contradicted ?? null;
  const aboutRest = doubted === null ? "" : `its rest contradicts the others: ${percent(doubted)} trusted`;
  const text = (observer.gone ? ["its process is gone"] : status).concat(clockOff, lies, aboutRest, rejected).filter(Boolean).join(", ");
  return [text, observer.gone || Boolean(clockOff || lies || aboutRest || rejected) || Boolean(observer.health && observer.health.state !== "running")];
}

/* Bars: rows of name, bar and share, one for each answer. */
function bars(list, ranked) {
  while (list.children.length > ranked.length) list.lastChild.remove();
  while (list.children.length < ranked.length) {
    list.append(make("li", "", make("span", "name"), make("span", "bar", make("i")), make("span", "share")));
  }
  ranked.forEach(([label, p], i) => {
    const [name, bar, figure] = list.children[i].children;
    put(name, words(label));
    share(bar.firstChild, p);
    put(figure, percent(p));
  });
}

/* Facets: rows of two poles and a bar from the middle to the likelier one. */
function facets(list, leanings) {
  while (list.children.length > leanings.length) list.lastChild.remove();
  while (list.children.length < leanings.length) {
    list.append(make("li", "", make("span", "pole"), make("span", "tug", make("i")), make("span", "pole"), make("span", "unseen")));
  }
  leanings.forEach(([facet, first, last, lean, value, p], i) => {
    const node = list.children[i], [left, bar, right, spoken] = node.children;
    put(left, first);
    put(right, last);
    attribute(node, "title", `${facet.replace("_", ", ")}: ${value} ${percent(p)}`);
    left.classList.toggle("held", value === first);
    right.classList.toggle("held", value === last);
    share(bar.firstChild, (lean / 2).toFixed(3));
    put(spoken, `: ${value} ${percent(p)}`);
  });
}
function showManner(state) {
  $("manner").hidden = state.facets.length === 0;
  for (const kind of ["effort", "shape"]) facets($(kind), state.facets.filter((facet) => facet[0].startsWith(`${kind}_`)));
  $("facing-fact").hidden = state.facing === null;
  const needle = $("needle");
  if (needle) {
    needle.toggleAttribute("hidden", state.facing === null);
    if (state.facing !== null) attribute(needle, "transform", `rotate(${-state.facing[0]})`);
  }
  if (state.facing !== null) put($("facing"), state.facing[1]);
}

/* Observers: a card each beside the tatami, or one line each when there are many. */
const cards = new Map(), lines = new Map();
function card(name) {
  const node = make("li", "card observer");
  const parts = {
    node, name: make("h3"), stance: make("span", "stance"), bars: make("ul", "bars"), weight: make("i"), share: make("span", "share"),
    entropy: make("b"), age: make("b"), health: make("p", "health"),
    ...sight(name),
  };
  const fact = (title, value) => make("span", "", make("span", "quiet", `${title} `), value);
  node.append(make("div", "head", parts.name, parts.stance), parts.bars,
    make("div", "weigh", make("span", "", "weight"), make("span", "bar", parts.weight), parts.share),
    make("p", "facts", fact("entropy", parts.entropy), fact("age", parts.age)), parts.health, parts.sight);
  put(parts.name, name);
  parts.eye.addEventListener("click", () => watch(name, parts, parts.canvas.hidden));
  return parts;
}
function showCard(observer) {
  if (!cards.has(observer.name)) cards.set(observer.name, card(observer.name));
  const parts = cards.get(observer.name), [text, bad] = health(observer);
  mark(parts.node, "stance", tone(observer));
  put(parts.stance, stanceWords(observer));
  bars(parts.bars, observer.ranked.length || !observer.label ? observer.ranked : [[observer.label, 0]]);
  share(parts.weight, observer.weight);
  put(parts.share, percent(observer.weight));
  put(parts.entropy, bits(observer.entropy));
  put(parts.age, age(observer.age));
  put(parts.health, text);
  parts.health.classList.toggle("bad", bad);
  parts.sight.hidden = !known.setup.pictures[observer.name];
  return parts.node;
}

/* Live pictures: only of observers that the scene file switches on, and only after a click. Nothing is kept. */
function sight(name) {
  const eye = make("button", "eye"), canvas = make("canvas"), note = make("p", "quiet");
  eye.type = "button";
  canvas.hidden = true;
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", `What ${name} sees`);
  const parts = { sight: make("div", "sight-box", eye, canvas, note), eye, canvas, note, shown: "", shownAt: 0 };
  labelEye(name, parts);
  return parts;
}
function labelEye(name, parts) {
  const open = !parts.canvas.hidden;
  put(parts.eye, open ? "Hide picture" : "Show picture");
  parts.eye.setAttribute("aria-expanded", String(open));
  parts.eye.setAttribute("aria-label", `${parts.eye.textContent} of ${name}`);
}
function watch(name, parts, open) {
  Object.assign(parts, { shown: "", shownAt: performance.now() });
  parts.canvas.hidden = !open;
  parts.canvas.width = parts.canvas.height = 0;
  put(parts.note, open ? "waiting for a picture" : "");
  labelEye(name, parts);
  if (open) look(name, parts);
}
async function look(name, parts) {
  const rate = known.setup.pictures[name], watched = () => !parts.canvas.hidden && cards.get(name) === parts;
  if (!watched() || !rate) return;
  if (!document.hidden) {
    try {
      const answer = await fetch(`picture/${encodeURIComponent(name)}?after=${parts.shown}`, { cache: "no-store" });
      if (answer.status === 200) await showPicture(parts, answer, watched);
      else if (answer.status !== 204) put(parts.note, (await answer.text()).trim());
      else if (performance.now() - parts.shownAt > QUIET_MS) put(parts.note, parts.shown ? "no new picture: is its camera there?" : "no picture yet: does this judge run?");
    } catch { put(parts.note, "no connection"); }
  }
  // Twice as often as there are pictures, so that none waits long.
  setTimeout(look, 500 / rate, name, parts);
}
async function showPicture(parts, answer, watched) {
  const bitmap = await createImageBitmap(await answer.blob());
  if (watched()) {
    Object.assign(parts.canvas, { width: bitmap.width, height: bitmap.height });
    parts.canvas.getContext("2d").drawImage(bitmap, 0, 0);
    Object.assign(parts, { shown: answer.headers.get("x-picture"), shownAt: performance.now() });
    put(parts.note, "");
  }
  bitmap.close();
}
function line() {
  const node = make("li", "", make("span", "lamp"), make("span", "who"), make("span", "what"));
  for (const title of ["belief", "weight", "age"]) {
    const figure = make("span", "figure", make("span", "unseen", `${title} `), make("span"));
    figure.title = title;
    node.append(figure);
  }
  return node;
}
function showLine(observer) {
  if (!lines.has(observer.name)) lines.set(observer.name, line());
  const node = lines.get(observer.name), [, who, what, ...figures] = node.children, steady = observer.heard && !observer.gone;
  mark(node, "stance", tone(observer));
  put(who, observer.name);
  put(what, steady && observer.label ? words(observer.label) : stanceWords(observer));
  const values = [steady && observer.ranked.length ? percent(observer.ranked[0][1]) : "", percent(observer.weight), age(observer.age)];
  values.forEach((value, i) => put(figures[i].lastChild, value));
  return node;
}
function keep(list, nodes) {
  const wanted = new Set(nodes);
  for (const old of [...list.children]) if (!wanted.has(old)) old.remove();
  nodes.forEach((node, i) => { if (list.children[i] !== node) list.insertBefore(node, list.children[i] || null); });
}
function showObservers(state) {
  const crowd = state.observers.length > CROWD;
  $("crowd").hidden = !crowd;
  $("floor").classList.toggle("alone", crowd);
  $("left").hidden = $("right").hidden = crowd;
  if (crowd) {
    keep($("list"), state.observers.map(showLine));
    const counts = new Map();
    for (const observer of state.observers) counts.set(stance(observer), (counts.get(stance(observer)) || 0) + 1);
    put($("count"), `${state.observers.length}: ` + [...counts].map(([word, number]) => `${number} ${word.replace(/^(agree|differ)s$/, "$1")}`).join(", "));
    return;
  }
  // Observers on the left of the performer are listed left of the tatami, from the front to the back.
  const across = (observer) => { const place = spot(observer.name); return place ? place.x : 0; };
  const along = (observer) => { const place = spot(observer.name); return place ? place.y : 999; };
  const sorted = [...state.observers].sort((a, b) => across(a) - across(b) || along(a) - along(b));
  const half = Math.ceil(sorted.length / 2), byDepth = (a, b) => along(a) - along(b);
  keep($("left"), sorted.slice(0, half).sort(byDepth).map(showCard));
  keep($("right"), sorted.slice(half).sort(byDepth).map(showCard));
}

/* The tatami from above, the performer's front at the top. */
function spot(name) {
  const position = known.setup.positions[name];
  if (!position) return null;
  const angle = position.azimuth * Math.PI / 180, x = Math.sin(angle), y = -Math.cos(angle);
  const reach = 152 / Math.max(Math.abs(x), Math.abs(y));
  return { x: x * reach, y: y * reach };
}
const flags = new Map();
function layMat() {
  const mat = $("tatami"), seams = [];
  for (let at = -160; at <= 160; at += 40) seams.push(`M${at} -200V200M-200 ${at}H200`);
  mat.replaceChildren(
    draw("rect", { class: "band", x: -200, y: -200, width: 400, height: 400 }), draw("path", { class: "band-seam", d: seams.join(""), fill: "none" }),
    draw("rect", { class: "area", x: -178, y: -178, width: 356, height: 356 }), draw("path", { class: "seam", fill: "none", d: innerSeams() }));
  const front = draw("text", { class: "front", x: 0, y: -129 });
  front.textContent = "front";
  // Which way the person faces, on the edge of the referee's disc.
  const needle = draw("g", { id: "needle", hidden: "" }, draw("path", { d: "M-12 -88L0 -122L12 -88Z" }));
  mat.append(needle);
  // An observer in front marks the front by itself.
  const before = Object.values(known.setup.positions).some(({ azimuth }) => Math.min(azimuth, 360 - azimuth) < 25);
  if (!before) mat.append(front, draw("path", { class: "nose", d: "M-8 -142L0 -150L8 -142" }));
  flags.clear();
  const names = Object.keys(known.setup.positions), quiet = names.length > CROWD;
  names.forEach((name, i) => flags.set(name, flag(name, quiet, mat, quiet && i % 2 ? 0.92 : 1)));
}
function innerSeams() {
  let path = "";
  for (let at = -120; at <= 120; at += 40) path += `M${at} -178V178M-178 ${at}H178`;
  return path;
}
function flag(name, quiet, mat, near) {
  const place = spot(name), x = place.x * near, y = place.y * near, reach = Math.hypot(x, y), group = draw("g", { class: "flag", "data-stance": "silent" });
  const ray = draw("line", { class: "sight", x1: x, y1: y, x2: x / reach * 96, y2: y / reach * 96, stroke: "var(--tone)" });
  const dot = draw("circle", { class: "dot", cx: x, cy: y, r: quiet ? 3.5 : 9 });
  const middle = Math.abs(x) < 60, anchor = middle ? "middle" : x < 0 ? "start" : "end", below = y < 0;
  const textX = middle ? x : x < 0 ? x - 12 : x + 12, textY = y + (below ? 28 : -32);
  const who = draw("text", { x: textX, y: textY, "text-anchor": anchor }), held = draw("text", { class: "held", x: textX, y: textY + 16, "text-anchor": anchor });
  if (!quiet) who.textContent = name.length > 16 ? `${name.slice(0, 15)}…` : name;
  group.append(ray, dot, who, held);
  mat.append(group);
  return { group, ray, held, quiet };
}
function showMat(state) {
  for (const observer of state.observers) {
    const parts = flags.get(observer.name);
    if (!parts) continue;
    mark(parts.group, "stance", tone(observer));
    attribute(parts.ray, "stroke-width", parts.quiet ? 0.6 : (1 + 12 * observer.weight).toFixed(1));
    if (parts.quiet) continue;
    const text = observer.heard && observer.label && !observer.gone ? words(observer.label) : stanceWords(observer);
    put(parts.held, text.length > 18 ? `${text.slice(0, 17)}…` : text);
  }
}

/* The referee. */
function showReferee(state) {
  const last = known.verdicts[0], box = $("referee");
  mark(box, "kind", !last ? "none" : last.abstain ? "abstain" : last.ended === null ? "open" : "ended");
  put($("verdict"), last ? words(last.label) : "no verdict yet");
  $("verdict").classList.toggle("long", Boolean(last) && last.label.length > 9);
  put($("phase"), state.silent ? `referee silent ${age(state.silence)}` : !state.judged ? "" : state.waiting ? "waiting for observers" : state.moving ? "moving" : "at rest");
  const ago = last ? Math.max(0, Math.round((state.now - (last.ended ?? last.decided)) / 1000)) : 0;
  const when = !last ? "" : last.ended === null ? "now" : ago < 100 ? `${ago} s ago` : `at ${clock(last.ended)}`;
  const before = last && last.revises !== null ? `, corrected from ${words(last.revises)}` : "";
  put($("verdict-facts"), last ? `${when}, ${agree(last.agreement)} agreed${before}` : "");
  put($("undecided"), !state.judged ? "No referee is heard. Start the scene: labanmesh up, and the scene file." : state.waiting && !state.silent ? unheard(state.observers) : state.why && !state.silent ? `no verdict yet: ${words(state.why)}` : "");
  bars($("fused"), state.fused);
  showManner(state);
  put($("agreement"), state.waiting ? "-" : agree(state.agreement));
  put($("entropy"), bits(state.entropy));
}
// Why nobody counts, and what to do.
function unheard(observers) {
  const all = (state) => observers.every((observer) => observer.gone || observer.state === state);
  if (observers.every((observer) => observer.gone)) return "No judge runs. Start them: labanmesh up, and the scene file.";
  if (all("late")) return "All judges are late: their machines are too busy, or their clocks or the network are wrong. labanmesh doctor says which.";
  return all("silent") ? "No judge is heard. Do they run? labanmesh up starts them; labanmesh doctor says what is wrong." : "No judge counts now; their cards say why.";
}
function showHeader(state) {
  const kind = known.setup.span !== null ? "capture" : !state.judged ? "waiting" : state.silent ? "silent" : state.waiting ? "unobserved" : "live";
  link(kind, { capture: "capture", waiting: "waiting for a referee", silent: "referee silent", unobserved: "waiting for observers", live: "live" }[kind]);
  const news = state.rule === null ? [] : [`${state.fusion}: ${state.rule}`];
  if (known.setup.quorum) news.push(`${known.setup.quorum} must agree`);
  if (state.standby.length) news.push(`${state.standby.join(", ")} standing by`);
  if (state.same_ids) news.push(state.same_ids);
  if (state.rejected) news.push(`${count(state.rejected, "message")} rejected`);
  put($("news"), [...news, clock(state.now)].join(" · "));
}
function link(kind, text) {
  mark($("link"), "kind", kind);
  put($("link"), text);
  document.body.toggleAttribute("data-away", kind === "away");
}

/* The last minute: belief above, entropy below, verdicts as bands from their beginning to their end. */
const HEIGHT = 170, TOP = [24, 82], LOW = [102, 148];
function showStrip(state) {
  const strip = $("strip"), width = strip.clientWidth;
  if (!width) return;
  attribute(strip, "viewBox", `0 0 ${width} ${HEIGHT}`);
  const left = 46, right = width - 6, x = (ms) => left + (right - left) * (1 - (state.now - ms) / MINUTE_MS);
  const most = Math.max(1, Math.log2(Math.max(2, state.labels))), inside = (ms) => Math.min(right, Math.max(left, x(ms)));
  const parts = [];
  for (let ago = 0; ago <= 60; ago += 10) {
    const at = x(state.now - ago * 1000).toFixed(1);
    parts.push(draw("line", { class: "grid", x1: at, x2: at, y1: TOP[0], y2: LOW[1] }));
    if (ago % (width < 500 ? 20 : 10) === 0) parts.push(text(at, HEIGHT - 6, ago ? `-${ago} s` : "now", ago === 0 ? "end" : "middle"));
  }
  let free = 0;
  for (const each of [...known.verdicts].reverse()) {
    const end = each.ended ?? state.now;
    if (end < state.now - MINUTE_MS || each.began > state.now) continue;
    const from = inside(each.began), to = inside(end), kind = each.abstain ? " abstain" : "";
    parts.push(draw("rect", { class: `span${kind}`, x: from, y: TOP[0], width: Math.max(2, to - from), height: LOW[1] - TOP[0], rx: 3 }));
    if (!each.abstain && each.decided >= state.now - MINUTE_MS) parts.push(draw("line", { class: "decided", x1: inside(each.decided), x2: inside(each.decided), y1: TOP[0], y2: LOW[1] }));
    const name = verdictWords(each), wide = name.length * 7.4;
    const start = Math.min(from, right - wide);
    if (start >= free) { parts.push(text(start, 16, name, "start", `label${kind}`)); free = start + wide + 8; }
  }
  parts.push(text(left - 6, TOP[0] + 8, "100%", "end"), text(left - 6, TOP[1], "0", "end"),
    text(left - 6, LOW[0] + 8, `${most.toFixed(1)} bit`, "end"), text(left - 6, LOW[1], "0", "end"));
  const points = known.minute.filter((point) => point[0] >= state.now - MINUTE_MS && point[0] <= state.now + 500);
  const path = (index, scale, [top, bottom]) => points.map((point, i) => {
    const gap = i === 0 || point[0] - points[i - 1][0] > 2000;
    return `${gap ? "M" : "L"}${x(point[0]).toFixed(1)} ${(bottom - (bottom - top) * Math.min(1, point[index] / scale)).toFixed(1)}`;
  }).join("");
  parts.push(draw("path", { class: "believed", d: path(2, 1, TOP) }), draw("path", { class: "bits", d: path(3, most, LOW) }));
  strip.replaceChildren(...parts);
}
function text(x, y, words, anchor, name = "") {
  const node = draw("text", { x, y, "text-anchor": anchor, class: name });
  node.textContent = words;
  return node;
}

/* The log: a row for each verdict, and below it, on request, its reasons. */
const rows = new Map();
function row(verdict) {
  const cells = ["time", "label", "took", "agree", "bits", "rule", "why-cell"].map((name) => make("td", name));
  const node = make("tr", "entry", ...cells), button = make("button", "", "Why?"), reasons = make("tr", "why", make("td"));
  reasons.firstChild.colSpan = cells.length;
  reasons.hidden = true;
  reasons.id = `why-${row.count = (row.count || 0) + 1}`;
  button.type = "button";
  button.setAttribute("aria-expanded", "false");
  button.setAttribute("aria-controls", reasons.id);
  button.addEventListener("click", () => {
    reasons.hidden = !reasons.hidden;
    button.setAttribute("aria-expanded", String(!reasons.hidden));
    showReasons(rows.get(verdict.id));
  });
  cells[6].append(button);
  return { node, cells, button, reasons, verdict };
}
function showRow(verdict) {
  if (!rows.has(verdict.id)) rows.set(verdict.id, row(verdict));
  const entry = rows.get(verdict.id), { cells } = entry;
  const changed = entry.verdict !== verdict;
  entry.verdict = verdict;
  entry.node.classList.toggle("abstain", verdict.abstain);
  const values = [clock(verdict.began), verdictWords(verdict), took(verdict), `${agree(verdict.agreement)}`, bits(verdict.entropy), verdict.rule];
  values.forEach((value, i) => put(cells[i], value));
  cells[3].setAttribute("aria-label", `${agree(verdict.agreement)} agree`);
  entry.button.setAttribute("aria-label", `Why ${words(verdict.label)} at ${clock(verdict.began)}?`);
  if (changed) showReasons(entry);
  return [entry.node, entry.reasons];
}
function showReasons({ reasons, verdict }) {
  if (reasons.hidden) return;
  const cell = (tag, value, name = "") => make(tag, name, value);
  // The log odds that each observer added to the verdict, and the likeliest answer without it.
  const contributed = verdict.votes.some((vote) => vote.gave !== null);
  const gave = (vote) => [
    cell("td", vote.gave === null ? "-" : `${vote.gave < 0 ? "" : "+"}${vote.gave.toFixed(2)} nat`.replace("-", "−"), "gave"),
    cell("td", vote.stands === null ? "-" : vote.stands ? "the same" : "another", vote.stands === false ? "needed" : "")];
  const head = make("tr", "", ...["Judge", "Held", "Entropy", "Weight", "Age", ...(contributed ? ["Contributed", "Without it"] : []), "Result"].map((title) => { const th = cell("th", title); th.scope = "col"; return th; }));
  const votes = verdict.votes.map((vote) => {
    const kind = vote.stance === "agreed" ? "agrees" : vote.stance.startsWith("held ") ? "differs" : vote.stance;
    const end = cell("td", make("span", "stance", words(vote.stance)));
    end.dataset.stance = kind;
    return make("tr", "", cell("th", vote.name), cell("td", vote.label === null ? "-" : words(vote.label)), cell("td", bits(vote.entropy)), cell("td", percent(vote.weight)), cell("td", age(vote.age)), ...(contributed ? gave(vote) : []), end);
  });
  const sums = verdict.fused.map(([label, p]) => `${words(label)} ${percent(p)}`).join(", ");
  const how = [...verdict.facets.filter((facet) => facet[4] !== "neither").map((facet) => `${facet[4]} ${percent(facet[5])}`), ...(verdict.facing ? [`facing ${verdict.facing[1]}`] : [])];
  const sentences = [...verdict.why, ...(sums ? [`Together, when it was decided: ${sums}.`] : []), ...(how.length ? [`How it was done: ${how.join(", ")}.`] : [])];
  reasons.firstChild.replaceChildren(make("ul", "", ...sentences.map((sentence) => cell("li", sentence))), make("table", contributed ? "votes contributed" : "votes", make("thead", "", head), make("tbody", "", ...votes)));
}
function showLog(fresh) {
  $("empty").hidden = known.verdicts.length > 0;
  $("log").hidden = known.verdicts.length === 0;
  const all = $("more").getAttribute("aria-expanded") === "true", shown = all ? known.verdicts : known.verdicts.slice(0, LOG_SHOWN);
  $("more").hidden = known.verdicts.length <= LOG_SHOWN;
  put($("more"), all ? "Show fewer" : `Show all ${known.verdicts.length}`);
  keep($("verdicts"), shown.flatMap(showRow));
  const ids = new Set(known.verdicts.map((each) => each.id));
  for (const id of rows.keys()) if (!ids.has(id)) rows.delete(id);
  if (fresh && rows.has(fresh.id)) rows.get(fresh.id).node.classList.add("fresh");
}

$("more").addEventListener("click", () => {
  attribute($("more"), "aria-expanded", $("more").getAttribute("aria-expanded") !== "true");
  showLog(null);
});

/* Events from the server. */
function onSnapshot(whole) {
  const same = known.setup && JSON.stringify(known.setup.positions) === JSON.stringify(whole.positions);
  known.setup = whole;
  known.verdicts = whole.verdicts;
  known.minute = whole.minute;
  announced = new Map(whole.verdicts.map((each) => [each.id, each.label]));
  put($("scene"), whole.scene);
  $("teach").hidden = !whole.teaches;
  document.title = `${whole.scene}: labanmesh`;
  if (!same) { cards.clear(); lines.clear(); layMat(); }
  if (whole.span !== null) layReplay(whole);
  showLog(null);
  onState(whole.state);
  if (whole.span !== null && !replay.playing) close();
}
function onState(state) {
  known.state = state;
  known.updated = performance.now();
  if (state.label !== null && !state.silent) remember([state.now, state.label, state.fused.length ? state.fused[0][1] : 0, state.entropy ?? 0]);
  if (state.head !== undefined) showHead(state.head);
  requestShow();
}
function remember(point) {
  const newest = known.minute[known.minute.length - 1];
  if (newest && point[0] >= newest[0] && point[0] - newest[0] < 150) return;
  known.minute = known.minute.filter((each) => each[0] > point[0] - MINUTE_MS && each[0] < point[0]);
  known.minute.push(point);
}
function onVerdict(verdict) {
  const place = known.verdicts.findIndex((each) => each.id === verdict.id);
  if (place < 0) known.verdicts = [verdict, ...known.verdicts].slice(0, LOG_LIMIT);
  else known.verdicts[place] = verdict;
  showLog(place < 0 ? verdict : null);
  const before = announced.get(verdict.id);
  if (before !== verdict.label) {
    announced.set(verdict.id, verdict.label);
    const kind = before === undefined ? "Verdict" : "Corrected verdict";
    put($("announcement"), verdict.abstain ? `${kind}: the judges did not agree` : `${kind}: ${words(verdict.label)}, ${agree(verdict.agreement)} agree`);
  }
  // At once and not with the next frame, because people wait for verdicts.
  if (known.state) showReferee(known.state);
  requestShow();
}
let asked = false;
function requestShow() {
  if (asked || document.hidden) return;
  asked = true;
  requestAnimationFrame(() => {
    asked = false;
    if (!known.setup || !known.state) return;
    showHeader(known.state);
    showReferee(known.state);
    showObservers(known.state);
    showMat(known.state);
    showStrip(known.state);
    attribute($("tatami"), "aria-label", `The tatami from above with ${count(Object.keys(known.setup.positions).length, "judge")} around the referee`);
    const last = known.verdicts[0];
    attribute($("strip"), "aria-label", `Belief and entropy over the last minute${last ? `; last verdict ${words(last.label)}` : ""}`);
  });
}

/* The connection: opened again whenever it breaks or falls silent, closed while the page is hidden. */
function open() {
  close();
  const capture = known.setup && known.setup.span !== null;
  source = new EventSource(capture ? `events?at=${replay.head}&speed=${replay.playing ? $("speed").value : 0}` : "events");
  known.updated = performance.now();
  const listen = (kind, act) => source.addEventListener(kind, (event) => { known.updated = performance.now(); act(JSON.parse(event.data)); });
  listen("snapshot", onSnapshot);
  listen("state", onState);
  listen("verdict", onVerdict);
  listen("end", () => setPlaying(false));
  source.onerror = () => { away(); close(); again = setTimeout(open, AGAIN_MS); };
}
function close() {
  clearTimeout(again);
  if (source) source.close();
  source = null;
}
function away() { link("away", "disconnected, trying again"); }
setInterval(() => {
  const still = known.setup && known.setup.span !== null && !replay.playing;
  if (source && !still && !document.hidden && performance.now() - known.updated > QUIET_MS) { away(); open(); }
}, 1000);
document.addEventListener("visibilitychange", () => {
  if (document.hidden) { if (!known.setup || known.setup.span === null) close(); } else if (!source && (!known.setup || known.setup.span === null || replay.playing)) open(); else requestShow();
});
addEventListener("resize", requestShow);

/* The replay bar. */
function layReplay(whole) {
  $("replay").hidden = false;
  attribute($("head"), "max", whole.span);
  $("marks").replaceChildren(...whole.marks.map(([at]) => {
    const tick = make("i");
    tick.style.left = `${whole.span ? 100 * at / whole.span : 0}%`;
    return tick;
  }));
  showHead(whole.head);
}
function showHead(at) {
  replay.head = at;
  if (!replay.dragging) $("head").value = at;
  const span = known.setup.span, place = (seconds) => `${Math.floor(seconds / 60)}:${String(Math.floor(seconds % 60)).padStart(2, "0")}`;
  put($("moment"), `${place(at)} / ${place(span)}`);
  attribute($("head"), "aria-valuetext", `${place(at)} of ${place(span)}`);
}
function setPlaying(playing) {
  replay.playing = playing;
  put($("play"), playing ? "Pause" : "Play");
  if (!playing) close();
}
$("play").addEventListener("click", () => {
  setPlaying(!replay.playing);
  if (replay.playing) { if (replay.head >= known.setup.span - 0.05) replay.head = 0; open(); }
});
$("head").addEventListener("input", () => { replay.dragging = true; });
$("head").addEventListener("change", () => { replay.dragging = false; replay.head = Number($("head").value); open(); });
$("speed").addEventListener("change", () => { if (replay.playing) open(); });
$("only").addEventListener("change", () => $("list").classList.toggle("only", $("only").checked));

/* Colours: those of the system, or as chosen here. */
function paint(theme) {
  if (theme === "auto") delete document.documentElement.dataset.theme;
  else document.documentElement.dataset.theme = theme;
}
let chosen = "auto";
try { chosen = localStorage.getItem("theme") || "auto"; } catch { /* a browser without storage */ }
$("theme").value = chosen;
paint(chosen);
$("theme").addEventListener("change", () => {
  paint($("theme").value);
  try { localStorage.setItem("theme", $("theme").value); } catch { /* the same */ }
});
open();
