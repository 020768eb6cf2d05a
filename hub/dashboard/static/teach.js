/* The Teach page. The lesson lives in the server: this page shows its state and presses, so that it can be reloaded,
   sleep, or be open on two phones. All words of others are text, never markup. */
import { $, button, draw, make, part, put, showAdvice, store, stored } from "./elements.js";
import { extent, figure, square } from "./figures.js";
import { TAKING, capital, listed, listen, showLesson } from "./lesson.js";
import { count, words } from "./words.js";

const VIEW_MS = 300, AGAIN_MS = 1000;
const IDEAS = ["wave", "point", "clap", "circle", "stop"];
const LABEL = /^[a-z0-9_]{1,64}$/;
const [, reason, typed] = /^(.*: )(labanmesh [^;]*)$/s.exec($("off").textContent) || [];
if (typed) showAdvice($("off"), [reason, typed]);
let key = stored("teach-key"), state = null, chosen = [], wanted = null;

/* Small helpers. */
function complain(line) {
  put($("fault"), capital(line));
  $("fault").hidden = !line;
  if (line) $("fault").scrollIntoView({ block: "nearest" });
}

/* Requests: each has the key in a header; the answer of a POST is nothing, or a line that says why not. */
async function request(path, fields, token = key, signal = undefined) {
  const headers = { authorization: `Bearer ${token}` };
  const options = fields === undefined ? { headers, signal } : { method: "POST", headers: { ...headers, "content-type": "application/json" }, body: JSON.stringify(fields), signal };
  const answer = await fetch(path, { cache: "no-store", ...options });
  if (answer.status === 401 && path !== "teach/enter") { key = ""; store("teach-key", ""); show(); }
  return answer;
}
async function send(path, fields) {
  listen();
  try {
    const answer = await request(path, fields);
    complain(answer.ok ? "" : (await answer.text()).trim());
    return answer.ok;
  } catch { complain("The dashboard does not answer. Is this phone in the same network?"); return false; }
}
const press = (action, take = 0) => send("teach/press", { lesson: state.lesson.id, number: state.lesson.number, action, take });
const LESSON = {
  press, start: (plan) => send("teach/start", plan), stop: (lesson) => send("teach/stop", { lesson }), next: "Teach more",
  review: "Delete what went wrong. The lines show the way of the hands, green the right one and blue the left: they should look alike.",
  ways: (lesson, kept) => kept.slice(0, 2).map((each) => thumbnail(lesson.id, each.name, each.take.label, each.take.take, "large")),
};

/* The token: from the address, where it is after the #, or typed. The browser keeps a key made from it. */
async function enter(token) {
  let answer = null;
  try { answer = await request("teach/enter", {}, token); } catch { complain("The dashboard does not answer."); return; }
  if (!answer.ok) { complain(answer.status === 401 ? "That is not the token." : (await answer.text()).trim()); return; }
  key = (await answer.json()).key;
  store("teach-key", key);
  complain("");
  show();
  watch();
}
$("door").addEventListener("submit", (event) => { event.preventDefault(); enter($("token").value.trim()); $("token").value = ""; });

/* The state: each request waits in the server until something is new. */
let watching = null;
async function watch() {
  if (watching || document.hidden || !key) return;
  const mine = watching = new AbortController();
  while (watching === mine && key) {
    try {
      const answer = await request(`teach/state?after=${state ? state.version : ""}`, undefined, key, mine.signal);
      if (!answer.ok) throw new Error(answer.status);
      state = await answer.json();
      put($("scene"), state.scene);
      link(...(runs() ? ["live", "live"] : ["waiting", "no camera"]));
      show();
    } catch {
      if (watching !== mine) return;
      link("away", "no connection");
      await new Promise((done) => setTimeout(done, AGAIN_MS));
    }
  }
  if (watching === mine) watching = null;
}
function link(kind, text) {
  $("link").dataset.kind = kind;
  put($("link"), text);
}
/* Whether a camera can be taught: its observer runs and answers. */
const runs = () => state.observers.some((each) => each.state !== undefined);
document.addEventListener("visibilitychange", () => {
  if (!document.hidden) { watch(); return; }
  if (watching) watching.abort();
  watching = null;
});

/* What is shown. */
function show() {
  const off = $("off").textContent.trim() !== "", lesson = state && key ? state.lesson : null;
  const step = lesson && lesson.step, setup = Boolean(state && key && !lesson) && !off;
  $("off").hidden = !off;
  $("door").hidden = off || Boolean(key);
  const idle = setup && !runs();
  showAdvice($("idle"), !idle ? null : state.observers.some((each) => each.line !== "does not run")
    ? ["Cameras run, and none can be taught from here. Ask why:", `labanmesh doctor ${state.file}`] : ["No camera runs now, so nothing can be taught. Start them, and this page goes on by itself:", `labanmesh up ${state.file}`]);
  $("setup").hidden = !setup || idle;
  $("lesson").hidden = !lesson;
  $("course").hidden = !lesson || lesson.purpose !== "lesson";
  $("main").dataset.screen = lesson ? "lesson" : "setup";
  $("views").hidden = !(setup || (lesson && !lesson.over && lesson.waits && ["ready", "test"].includes(step.kind)));
  $("stop").hidden = !lesson || lesson.over || lesson.purpose === "forget";
  $("watch").hidden = Boolean(lesson) && !lesson.over;
  $("link").hidden = off || !key;
  if (off || !key || !state) return;
  showCameras();
  if (setup) showSetup();
  if (lesson) showTakes(lesson, showLesson(state, LESSON));
  showCorrections(setup || (lesson && lesson.over));
  showForgetting(setup);
  showHome(setup || (lesson && lesson.over));
}
function showCameras() {
  const list = $("cameras");
  list.classList.toggle("one", state.observers.length === 1);
  part(list, state.observers.map((each) => each.name), () => state.observers.map((each) => {
    const item = make("li", "", make("div", "view"), make("p", "", make("b", "", each.name), make("span")));
    item.dataset.name = each.name;
    return item;
  }));
  state.observers.forEach((each, i) => {
    const item = list.children[i];
    item.toggleAttribute("data-ready", each.ready);
    item.toggleAttribute("data-away", each.state === undefined);
    put(item.querySelector("span"), each.line);
  });
}

/* Before a lesson: which movements. */
function showSetup() {
  const { known, begun } = state;
  $("unfinished").hidden = begun.length === 0;
  put($("unfinished-labels"), `There are takes of ${listed(begun)} that are not learned yet.`);
  put($("known"), known.length ? `It knows: ${listed(known)}.` : "It knows none yet. Choose at least two.");
  $("how").hidden = known.length === 0;
  part($("chosen"), chosen, () => chosen.map((label) => {
    const node = button(words(label), () => { chosen = chosen.filter((each) => each !== label); keepDraft(); });
    node.setAttribute("aria-label", `Leave out ${words(label)}`);
    return make("li", "", node);
  }));
  const names = personsTaught().filter((each) => each !== "someone");
  part($("names"), names, () => names.map((each) => { const node = make("option"); node.value = each; return node; }));
  const ideas = IDEAS.filter((each) => !chosen.includes(each) && !known.includes(each)).slice(0, 3);
  part($("ideas"), ideas, () => ideas.map((label) => {
    const node = button(words(label), () => addLabel(label));
    node.setAttribute("aria-label", `Add ${words(label)}`);
    return make("li", "", node);
  }));
  const takes = Number($("takes").value) || 5, life = Number($("minutes").value) || 0;
  put($("estimate"), chosen.length ? `About ${count(Math.max(1, Math.round(chosen.length * takes * 10 / 60 + life + 1)), "minute")}. ` : "");
  $("start").disabled = chosen.length === 0;
}
function keepDraft() { store("teach-draft", JSON.stringify(chosen)); show(); }
function addLabel(text) {
  const label = text.trim().toLowerCase().replace(/[\s-]+/g, "_");
  if (!label) { complain("Type the name of a movement first, such as wave."); return false; }
  if (!LABEL.test(label)) { complain(`“${text.trim()}”: use letters from a to z, digits and spaces in the name of a movement.`); return false; }
  if (chosen.includes(label)) { complain(`${words(label)} is chosen already.`); return false; }
  complain("");
  chosen = [...chosen, label];
  keepDraft();
  return true;
}
$("adding").addEventListener("submit", (event) => {
  event.preventDefault();
  if (addLabel($("label").value)) $("label").value = "";
});
for (const id of ["takes", "minutes"]) $(id).addEventListener("input", show);
function plan(labels, more = {}) {
  const adds = !$("how").hidden && document.querySelector("input[name=how]:checked").value === "add";
  const seconds = $("seconds").value === "" ? null : Number($("seconds").value);
  return { labels, add: adds, takes: Number($("takes").value), minutes: Number($("minutes").value), person: $("person").value.trim(), seconds, begin: $("begin").value, alarm_minutes: Number($("alarm_minutes").value), ...more };
}
$("start").addEventListener("click", async () => {
  const typed = $("label").value;
  if (typed.trim() && !addLabel(typed)) return;
  $("label").value = "";
  if (await send("teach/start", plan(chosen))) { chosen = []; store("teach-draft", ""); }
});
$("resume").addEventListener("click", () => send("teach/start", plan(state.begun, { add: state.known.length > 0 })));

/* Takes: the ways of the hands, as each camera saw them. */
const pictures = new Map();
function showTakes(lesson, step) {
  if (!lesson.over && step.kind === "examples" && lesson.waits) { showExamples(lesson); return; }
  const label = !lesson.over && ["ready", "review", "doubt", ...TAKING].includes(step.kind) && !step.is_test ? step.label : "";
  const by = new Map();
  for (const each of state.observers) for (const take of (label && each.takes && each.takes[label]) || []) by.set(take, [...(by.get(take) || []), each.name]);
  const numbers = [...by.keys()].sort((a, b) => a - b), deletes = lesson.waits && step.kind === "review";
  $("takes-made").classList.toggle("several", [...by.values()].some((names) => names.length > 1));
  part($("takes-made"), [lesson.id, label, [...by], deletes ? lesson.number : 0], () => numbers.map((take, i) => {
    const item = make("li", "", make("div", "views", ...by.get(take).slice(0, 3).map((name) => thumbnail(lesson.id, name, label, take))), make("p", "", `${i + 1}: ${by.get(take).join(", ")}`));
    if (deletes) {
      const node = button("Delete", () => press("drop", take));
      node.setAttribute("aria-label", `Delete take ${i + 1}`);
      item.append(node);
    }
    return item;
  }));
}
/* What was cut out for movements that were missed. */
function showExamples(lesson) {
  $("takes-made").classList.toggle("several", lesson.examples.some((each) => Object.keys(each.takes).length > 1));
  part($("takes-made"), [lesson.id, lesson.examples, lesson.number], () => lesson.examples.map((each, i) => {
    const seen = Object.entries(each.takes), drop = button("No, drop it", () => press("drop", i + 1));
    drop.setAttribute("aria-label", `No, drop ${words(each.label)}`);
    return make("li", "", make("div", "views", ...seen.slice(0, 3).map(([name, take]) => thumbnail(lesson.id, name, each.label, take))), make("p", "", `${words(each.label)}: ${seen.map(([name]) => name).join(", ")}`), drop);
  }));
}
function thumbnail(lesson, name, label, take, size = "small") {
  const id = [lesson, name, label, take, size].join("/");
  if (!pictures.has(id)) {
    const node = draw("svg", { viewBox: "-80 -80 1160 1160", role: "img", "aria-label": `${words(label)} as ${name} saw it` });
    pictures.set(id, node);
    request(`teach/take/${name}/${label}/${take}`).then(async (answer) => {
      if (answer.status !== 200) { pictures.delete(id); return; }
      const tracks = await answer.json();
      node.replaceChildren(...figure(tracks, square(extent(tracks))));
    }).catch(() => pictures.delete(id));
  }
  return pictures.get(id);
}
/* What the cameras see now: a picture where the scene file switches pictures on, else the body. */
const boxes = new Map();
async function look() {
  if (!document.hidden && !$("views").hidden && key && state) await Promise.all([...$("cameras").children].map(lookAt));
  setTimeout(look, VIEW_MS);
}
async function lookAt(item) {
  const name = item.dataset.name, view = item.querySelector(".view"), each = state.observers.find((one) => one.name === name);
  if (!each || each.state === undefined) { view.replaceChildren(); return; }
  try {
    if (each.picture && await lookAtPicture(item, view, name)) return;
    const answer = await request(`teach/now/${name}`);
    if (answer.status !== 200) { view.replaceChildren(); return; }
    const tracks = await answer.json(), box = widened(name, extent(tracks));
    view.replaceChildren(draw("svg", { viewBox: "-80 -80 1160 1160", role: "img", "aria-label": `The body that ${name} sees` }, ...figure(tracks, box)));
  } catch { /* the state says that nobody answers */ }
}
async function lookAtPicture(item, view, name) {
  const answer = await fetch(`picture/${name}?after=${item.dataset.picture || ""}`, { cache: "no-store" });
  if (answer.status === 204 && item.dataset.picture) return true;
  if (answer.status !== 200) return false;
  const bitmap = await createImageBitmap(await answer.blob());
  item.dataset.picture = answer.headers.get("x-picture");
  const canvas = view.querySelector("canvas") || make("canvas");
  [canvas.width, canvas.height] = [bitmap.width, bitmap.height];
  canvas.getContext("2d").drawImage(bitmap, 0, 0);
  if (!canvas.isConnected) view.replaceChildren(canvas);
  return true;
}
/* The square in which somebody has been seen: it grows at once and shrinks slowly, so that the body does not jump. */
function widened(name, now) {
  const old = boxes.get(name) || now, edges = now.map((edge, i) => (i < 2 ? Math.min : Math.max)(edge, old[i] + (edge - old[i]) * 0.03));
  boxes.set(name, edges);
  return square(edges);
}

/* What it said in the last minutes, or missed, which can be corrected. */
const MOMENTS = [["just now", 4], ["half a minute ago", 30], ["a minute ago", 60], ["two minutes ago", 120]], ELSE = "?";
let wrong = new Map(), missed = [], pressed = 0, moment = 0;
/* The verdict that is open: at first the one whose "Wrong?" led here from the page that watches. */
let opened = new URLSearchParams(location.search).get("wrong") || "", led = Boolean(opened);
function showCorrections(possible) {
  const said = possible ? state.said.filter((each) => each.ended) : [], count_ = () => wrong.size + missed.length;
  $("corrections").hidden = !possible || !state.remembers || state.known.length === 0;
  wrong = new Map([...wrong].filter(([id]) => said.some((each) => each.id === id)));
  part($("said"), [said, state.known, [...wrong], opened, missed], () => [...missed.map(missedLine), ...said.map(verdictLine)]);
  const lost = opened && !state.said.some((each) => each.id === opened);
  put($("said-what"), lost ? "That verdict can no longer be corrected: the cameras remember only the last minutes." : said.length ? "These are the verdicts of the last minutes. Say what it really was, and the cameras learn from it." : "It has recognised nothing in the last minutes.");
  part($("missing"), [state.known, pressed, moment], missing);
  showPersons(count_() > 0);
  $("learn-again").hidden = count_() === 0;
  put($("learn-again"), `Learn from ${count(count_(), "correction")}`);
  if (led && !$("corrections").hidden) { led = false; $("corrections").scrollIntoView(); }
}
function saidLine(ms, text, right) {
  return make("p", "", make("span", "quiet", `${clock(ms)} `), make("b", "", text), ...(right === undefined ? [] : [` → ${right ? words(right) : "nothing"}`]));
}
function missedLine(each) {
  return make("li", "", saidLine(each.at, "no verdict", each.label), button("Undo", () => { missed = missed.filter((one) => one !== each); show(); }));
}
function verdictLine(verdict) {
  const chosen = wrong.get(verdict.id), open = opened === verdict.id;
  const act = button(chosen !== undefined ? "Undo" : open ? "It was right" : "Wrong?", () => {
    if (chosen !== undefined) wrong.delete(verdict.id);
    opened = open || chosen !== undefined ? "" : verdict.id;
    show();
  });
  const item = make("li", "", saidLine(verdict.began, verdict.label ? words(verdict.label) : "no agreement", chosen), act);
  if (open) {
    item.append(make("p", "quiet", "What was it?"), chips([...state.known.filter((each) => each !== verdict.label), ""].map((label) =>
      button(label ? words(label) : "none of them", () => { wrong.set(verdict.id, label); opened = ""; show(); }))));
  }
  return item;
}
const chips = (buttons) => make("ul", "chips", ...buttons.map((each) => make("li", "", each)));
/* A movement that had no verdict. The time counts from the first press, not from the choice. */
function missing() {
  if (!pressed) return [button("I did one and nothing happened", () => { pressed = Date.now(); moment = 0; show(); }, "second")];
  const close = () => { pressed = 0; show(); };
  return [
    make("h3", "", "When was it?"), chips(MOMENTS.map(([text], i) => {
      const node = button(text, () => { moment = i; show(); });
      node.setAttribute("aria-pressed", String(i === moment));
      return node;
    })),
    make("h3", "", "What did you do?"), chips(state.known.map((label) => button(words(label), () => {
      missed = [...missed, { label, at: pressed - 1000 * MOMENTS[moment][1] }];
      close();
    }))),
    button("Never mind", close, "second")];
}
/* Who performed: by default the only person who has taught. */
function personsTaught() { return [...new Set(state.observers.flatMap((each) => Object.keys(each.persons || {})))].sort(); }
function showPersons(possible) {
  const names = personsTaught(), named = names.filter((each) => each !== "someone");
  $("whose").hidden = !possible;
  const options = names.length === 1 ? [["", named.length ? named[0] : "whoever taught it"]] : [["", names.length ? "not said" : "whoever taught it"], ...names.map((each) => [each, each === "someone" ? "someone without a name" : each])];
  part($("who"), options, () => [...options, [ELSE, "somebody else"]].map(([value, text]) => { const node = make("option", "", text); node.value = value; return node; }));
  $("who-else").hidden = $("who").value !== ELSE;
}
$("who").addEventListener("change", show);
const clock = (ms) => new Date(ms).toLocaleTimeString([], { hour: "2-digit", minute: "2-digit", second: "2-digit", hour12: false });
$("learn-again").addEventListener("click", async () => {
  const person = $("who").value === ELSE ? $("who-name").value.trim() : $("who").value;
  if ($("who").value === ELSE && !person) { complain("Type their name first, such as anna."); return; }
  const moments = missed.map((each) => ({ label: each.label, ago_s: Math.max(0, (Date.now() - each.at) / 1000) }));
  if (await send("teach/correct", { labels: Object.fromEntries(wrong), missed: moments, person })) { wrong.clear(); missed = []; pressed = 0; show(); }
});

/* Forgetting: a movement, a person or everything. Nothing happens before what will be removed has been shown. */
let unwanted = null;
function showForgetting(possible) {
  const taken = state.observers.flatMap((each) => Object.keys(each.takes || {})), labels = [...new Set([...state.known, ...taken])], persons = personsTaught();
  $("forgetting").hidden = !possible;
  if (!possible) unwanted = null;
  const choice = (fields, text, name) => {
    const node = button(text, () => ask(fields));
    node.setAttribute("aria-label", name);
    return node;
  };
  part($("forget-what"), [labels, persons], () => [
    ...(labels.length ? [make("h3", "", "A movement, in the takes of everybody"), chips(labels.map((label) => choice({ label }, words(label), `Forget the movement ${words(label)}`)))] : []),
    ...(persons.length ? [make("h3", "", "A person, with all their takes"), chips(persons.map((person) => choice({ person }, person === "someone" ? "someone without a name" : person, `Forget the person ${person}`)))] : []),
    choice({ everything: true }, "Everything that was taught", "Forget everything that was taught")]);
  $("forget-choice").hidden = Boolean(unwanted);
  $("sure").hidden = !unwanted;
  part($("sure"), unwanted && [unwanted, state.known, state.observers.map((each) => [each.name, each.takes, each.persons, each.other, each.state === undefined])], () => unwanted ? sure() : []);
}
/* The question takes the focus, so that a keyboard and a screen reader meet it next. */
function ask(fields) {
  complain("");
  unwanted = fields;
  show();
  $("sure-title").focus();
  $("sure").scrollIntoView({ block: "nearest" });
}
function sure() {
  const { person, label, everything } = unwanted, what = everything ? "everything" : words(label || person), title = make("h3", "", everything ? "Forget everything that was taught?" : person ? `Forget all takes of ${person}?` : `Forget the movement ${words(label)}?`);
  title.id = "sure-title";
  title.tabIndex = -1;
  const left = state.known.filter((each) => !everything && each !== label && state.observers.some((one) => takesOf(one, (name, of) => of === each && name !== person)));
  const gone = state.known.filter((each) => !left.includes(each));
  const then = state.known.length === 0 ? "" : left.length < 2 ? "Then it knows no movement any more, and waits to be taught." : gone.length ? `Then it no longer recognises ${listed(gone)}.` : `It still recognises ${listed(left)}.`;
  const films = make("input");
  films.type = "checkbox";
  const keepers = state.observers.filter((each) => each.clips).map((each) => each.name);
  const filmed = keepers.length ? [make("label", "check", films, make("span", "", `Also the films of ${label ? `verdicts that said ${words(label)}` : "all verdicts"} that ${keepers.join(", ")} kept`))] : [];
  return [title, make("p", "", "Removed are"), make("ul", "", ...state.observers.map((each) => make("li", "", `${each.name}: ${removed(each)}`))),
    make("p", "", "and old models that were learned from it, takes of it that were set aside, and what the cameras remember of the last minutes."), ...(then ? [make("p", "", then)] : []), ...filmed,
    button(`Forget ${what}`, async () => { if (await send("teach/forget", { ...unwanted, clips: films.checked })) { unwanted = null; $("forget-person").value = ""; show(); } }, "second danger"),
    button("Keep it", () => { unwanted = null; show(); }, "second")];
}
/* How many recordings of an observer are of those (person, movement); "" is something else. */
function takesOf(each, isMeant) {
  if (!each.persons) return 0;
  return Object.entries(each.persons).flatMap(([person, labels]) => Object.entries(labels).filter(([label]) => isMeant(person, label))).reduce((sum, [, number]) => sum + number, 0);
}
function removed(each) {
  if (each.state === undefined) return "does not run now; forget it again when it runs";
  const { person, label, everything } = unwanted, meant = (name, of) => everything || (person ? name === person : of === label);
  const takes = takesOf(each, (name, of) => of && meant(name, of)), other = takesOf(each, (name, of) => !of && meant(name, of));
  const parts = [...(takes ? [count(takes, "take")] : []), ...(other ? [count(other, "piece") + " of ordinary life"] : []), ...(everything && each.labels.length ? ["its model"] : [])];
  return parts.join(", ") || "no takes";
}
$("forget-name").addEventListener("submit", (event) => {
  event.preventDefault();
  const person = $("forget-person").value.trim();
  if (!person) { complain("Type the name of the person first."); return; }
  ask({ person });
});

/* Home Assistant. */
let asked = 0;
function showHome(possible) {
  $("home").hidden = !possible;
  if (possible && performance.now() - asked > 5000) { asked = performance.now(); askHome(); }
}
async function askHome() {
  try {
    const answer = await request("teach/home");
    if (!answer.ok) return;
    const home = await answer.json();
    put($("home-state"), `${capital(home.state)}.`);
    part($("home-steps"), home.steps, () => home.steps.map((step) => make("li", "", capital(step))));
  } catch { /* asked again with the next state */ }
}

/* Stop asks once more: the button says so. */
$("stop").addEventListener("click", () => {
  if (wanted) { clearTimeout(wanted); wanted = null; calm(); send("teach/stop", { lesson: state.lesson.id }); return; }
  put($("stop"), "Really stop?");
  $("stop").classList.add("sure");
  wanted = setTimeout(() => { wanted = null; calm(); }, 4000);
});
function calm() { put($("stop"), "Stop"); $("stop").classList.remove("sure"); }

/* Colours as chosen on the page that watches. */
const theme = stored("theme");
if (theme && theme !== "auto") document.documentElement.dataset.theme = theme;
try { chosen = JSON.parse(stored("teach-draft") || "[]"); } catch { chosen = []; }
show();
if (location.hash.length > 1) {
  const token = decodeURIComponent(location.hash.slice(1));
  history.replaceState(null, "", location.pathname);
  if ($("off").hidden) enter(token);
} else watch();
look();
