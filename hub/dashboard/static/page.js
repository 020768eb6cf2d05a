// The page: takes server-sent events and shows what was decided, the judges and the charts.
import { $, attribute, hide, make, mark, part, put, showAdvice, store, stored } from "./elements.js";
import { MINUTE_MS, layMat, showCharts, watchCharts } from "./charts.js";
import { clearJudges, showJudges } from "./judges.js";
import { clearCounter, showCounter } from "./counter.js";
import { showPeople } from "./people.js";
import { offerPhones } from "./phones.js";
import { showLast, showList } from "./verdicts.js";
import { advice, agree, clock, count, labelWords, learnNames, nameOf } from "./words.js";

const QUIET_MS = 4000, AGAIN_MS = 1000, LOG_LIMIT = 100;
const known = { setup: null, state: null, verdicts: [], minute: [], updated: 0 };
const replay = { playing: true, head: 0, dragging: false };
let source = null, again = 0, announced = new Map(), asked = false;

/* Events from the server. */
function onSnapshot(whole) {
  const same = known.setup && JSON.stringify(known.setup.positions) === JSON.stringify(whole.positions);
  Object.assign(known, { setup: whole, verdicts: whole.verdicts, minute: whole.minute });
  announced = new Map(whole.verdicts.map((each) => [each.id, each.label]));
  put($("scene"), whole.scene);
  $("teach").hidden = !whole.teaches;
  $("day").hidden = !whole.history;
  offerPhones(whole);
  document.title = `${whole.scene}: labanmesh`;
  if (!same) { clearJudges(); clearCounter(); layMat(whole.positions); }
  if (whole.span !== null) layReplay(whole);
  showList(whole, known.verdicts, null);
  onState(whole.state);
  if (whole.span !== null && !replay.playing) close();
}
function onState(state) {
  known.state = state;
  if (learnNames(state.names)) showList(known.setup, known.verdicts, null);
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
  showList(known.setup, known.verdicts, place < 0 ? verdict : null);
  const before = announced.get(verdict.id);
  if (before !== verdict.label) {
    announced.set(verdict.id, verdict.label);
    const kind = before === undefined ? "Verdict" : "Corrected verdict";
    put($("announcement"), `${kind}: ${labelWords(verdict)}, ${agree(verdict.agreement)} agreed`);
  }
  // At once and not with the next frame, because people wait for verdicts.
  if (known.state) showLast(known.verdicts[0], known.state);
  requestShow();
}
function requestShow() {
  if (asked || document.hidden) return;
  asked = true;
  requestAnimationFrame(() => {
    asked = false;
    const { setup, state, verdicts, minute } = known;
    if (!setup || !state) return;
    showHeader(setup, state);
    showFall(state);
    showAdvice($("advice"), advice(setup, state));
    showLast(verdicts[0], state);
    showPeople(state.people ?? []);
    document.querySelectorAll(".whose").forEach((node) => put(node, state.person ? `: ${nameOf(state.person)}` : ""));
    showCounter(verdicts, state, (text) => put($("announcement"), text));
    showJudges(setup, state);
    showCharts(setup, state, verdicts, minute);
  });
}
/* The alarm stays until somebody is seen up: nobody in sight does not end it. */
function showFall(state) {
  const fall = state.fall, lies = fall !== null && (fall.stage === "low" || fall.stage === "fallen");
  hide($("fall"), !lies);
  if (!lies) return;
  mark($("fall"), "kind", fall.stage);
  const [k, n] = fall.agreement, who = fall.person ? nameOf(fall.person) : "Somebody", word = fall.stage === "fallen" ? `${who} has fallen` : `${who} lies`;
  const sight = n ? `${k} of ${count(n, "judge")} ${n === 1 ? "sees" : "see"} it` : "nobody is seen now";
  part($("fall"), [word, fall.since, k, n], () => [make("p", "verdict", word), make("p", "quiet", `since ${clock(fall.since)}, ${sight}`)]);
}
const LINKS = { capture: "capture", watch: "watching for falls", waiting: "waiting for a referee", silent: "referee silent", unobserved: "waiting for observers", live: "live" };
function showHeader(setup, state) {
  const kind = setup.span !== null ? "capture" : !state.judged ? (state.fall ? "watch" : "waiting") : state.silent ? "silent" : state.waiting ? "unobserved" : "live";
  link(kind, LINKS[kind]);
  const news = state.rule === null ? [] : [`${state.fusion}: ${state.rule}`];
  if (setup.quorum) news.push(`${setup.quorum} must agree`);
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
$("more").addEventListener("click", () => {
  attribute($("more"), "aria-expanded", $("more").getAttribute("aria-expanded") !== "true");
  showList(known.setup, known.verdicts, null);
});

/* The connection: opened again whenever it breaks or falls silent, closed while the page is hidden. */
const isCapture = () => known.setup !== null && known.setup.span !== null;
function open() {
  close();
  source = new EventSource(isCapture() ? `events?at=${replay.head}&speed=${replay.playing ? $("speed").value : 0}` : "events");
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
function away() {
  link("away", "disconnected, trying again");
  const file = known.setup && known.setup.file;
  if (file) showAdvice($("advice"), ["The dashboard does not answer. If it has ended, start it again:", `labanmesh dashboard ${file}`]);
}
setInterval(() => {
  const still = isCapture() && !replay.playing;
  if (source && !still && !document.hidden && performance.now() - known.updated > QUIET_MS) { away(); open(); }
}, 1000);
document.addEventListener("visibilitychange", () => {
  if (document.hidden) { if (!isCapture()) close(); } else if (!source && (!isCapture() || replay.playing)) open(); else requestShow();
});
addEventListener("resize", requestShow);
watchCharts(requestShow);

/* The replay bar. */
function layReplay(whole) {
  $("replay").hidden = false;
  document.body.toggleAttribute("data-capture", true);
  attribute($("head"), "max", whole.span);
  $("marks").replaceChildren(...whole.marks.map(([at]) => {
    const tick = document.createElement("i");
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

/* Colours: those of the system, or as chosen here. */
function paint(theme) {
  if (theme === "auto") delete document.documentElement.dataset.theme;
  else document.documentElement.dataset.theme = theme;
}
$("theme").value = stored("theme") || "auto";
paint($("theme").value);
$("theme").addEventListener("change", () => {
  paint($("theme").value);
  store("theme", $("theme").value);
});
open();
