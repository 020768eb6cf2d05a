// The judges: one line each in plain words, with figures and the live picture on demand; many are a bare list.
import { $, attribute, hide, keep, make, mark, put, rowsOf, share } from "./elements.js";
import { age, bits, percent, processWords, sight, stance, stanceWords, tone, trouble, words } from "./words.js";

export const CROWD = 12;
const QUIET_MS = 4000;
const judges = new Map(), lines = new Map();
let pictures = {};

/* Bars: rows of name, bar and share, one for each answer. */
export function bars(list, ranked) {
  const nodes = rowsOf(list, ranked.length, () => make("li", "", make("span", "name"), make("span", "bar", make("i")), make("span", "share")));
  ranked.forEach(([label, p], i) => {
    const [name, bar, figure] = nodes[i].children;
    put(name, words(label));
    share(bar.firstChild, p);
    put(figure, percent(p));
  });
}

export function showJudges(setup, state) {
  pictures = setup.pictures;
  const crowd = state.observers.length > CROWD;
  hide($("crowd"), !crowd);
  hide($("judges"), crowd);
  keep($("judges"), crowd ? [] : state.observers.map((each) => showJudge(setup, state, each)));
  keep($("list"), crowd ? state.observers.map(showLine) : []);
  if (!crowd) { put($("count"), ""); return; }
  const counts = new Map();
  for (const each of state.observers) counts.set(stance(each), (counts.get(stance(each)) || 0) + 1);
  put($("count"), `${state.observers.length}: ` + [...counts].map(([word, number]) => `${number} ${word.replace(/^(agree|differ)s$/, "$1")}`).join(", "));
}
/* Forgets all of them: the scene has others now. */
export function clearJudges() {
  judges.clear();
  lines.clear();
}
function judge(name) {
  const node = make("li", "observer"), parts = {
    node, name: make("h3", "", name), sight: make("span", "what"), trouble: make("span", "trouble"), bars: make("ul", "bars"), weight: make("i"),
    share: make("span", "share"), stance: make("b"), entropy: make("b"), age: make("b"), process: make("b"), ...picture(name),
  };
  const fact = (title, value) => make("span", "", make("span", "quiet", `${title} `), value);
  node.append(make("details", "", make("summary", "", make("span", "lamp"), parts.name, parts.sight, parts.trouble),
    parts.bars, make("div", "weigh", make("span", "", "weight"), make("span", "bar", parts.weight), parts.share),
    make("p", "facts", fact("vote", parts.stance), fact("entropy", parts.entropy), fact("age", parts.age), fact("process", parts.process)), parts.box));
  node.firstChild.addEventListener("toggle", () => showFigures(parts, parts.newest));
  parts.eye.addEventListener("click", () => watch(name, parts, parts.canvas.hidden));
  return parts;
}
function showJudge(setup, state, observer) {
  if (!judges.has(observer.name)) judges.set(observer.name, judge(observer.name));
  const parts = judges.get(observer.name);
  mark(parts.node, "stance", tone(observer, state.moving));
  put(parts.sight, sight(observer, state, setup.sure));
  put(parts.trouble, trouble(observer));
  parts.newest = observer;
  if (parts.node.firstChild.open) showFigures(parts, observer);
  hide(parts.box, !pictures[observer.name]);
  return parts.node;
}
function showFigures(parts, observer) {
  bars(parts.bars, observer.ranked.length || !observer.label ? observer.ranked : [[observer.label, 0]]);
  share(parts.weight, observer.weight);
  put(parts.share, percent(observer.weight));
  put(parts.stance, stanceWords(observer));
  put(parts.entropy, bits(observer.entropy));
  put(parts.age, age(observer.age));
  put(parts.process, processWords(observer) || "not heard");
}

/* Live pictures: only of observers that the scene file switches on, and only after a click. Nothing is kept. */
function picture(name) {
  const eye = make("button", "eye"), canvas = make("canvas"), note = make("p", "quiet");
  eye.type = "button";
  canvas.hidden = true;
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", `What ${name} sees`);
  const parts = { box: make("div", "sight-box", eye, canvas, note), eye, canvas, note, shown: "", shownAt: 0 };
  labelEye(name, parts);
  return parts;
}
function labelEye(name, parts) {
  const open = !parts.canvas.hidden;
  put(parts.eye, open ? "Hide picture" : "Show picture");
  attribute(parts.eye, "aria-expanded", open);
  attribute(parts.eye, "aria-label", `${parts.eye.textContent} of ${name}`);
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
  const rate = pictures[name], watched = () => !parts.canvas.hidden && judges.get(name) === parts;
  if (!watched() || !rate) return;
  if (!document.hidden && parts.node.firstChild.open) {
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

/* A crowd: one line each, with the share of its answer, its weight and age. */
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
$("only").addEventListener("change", () => $("list").classList.toggle("only", $("only").checked));
