// The day page: what the hub's machine has kept of one day, as a strip and as a list.
import { $, draw, hide, make, put, stored } from "./elements.js";
import { age, agree, clock, count, learnNames, nameOf, percent, ofPerson, scoreWords, words } from "./words.js";

const MINUTE_MS = 60000, PAGE = 200, AGAIN_MS = 10000;
const shown = { rows: [], remembered: 0, clips: {}, number: PAGE };
const twoDigits = (number) => String(number).padStart(2, "0");
const written = (day) => `${day.getFullYear()}-${twoDigits(day.getMonth() + 1)}-${twoDigits(day.getDate())}`;

/* Local midnight, and the next one: a day is not always 24 hours long. */
function span() {
  const [year, month, day] = $("date").value.split("-").map(Number);
  return [new Date(year, month - 1, day), new Date(year, month - 1, day + 1)];
}
async function load() {
  if (!$("date").value) return;
  const [begin, end] = span();
  try {
    const answer = await fetch(`history/data?from=${begin.getTime()}&until=${end.getTime()}`);
    if (!answer.ok) { clear(); put($("sum"), (await answer.text()).trim()); return; }
    const whole = await answer.json();
    put($("scene"), whole.scene);
    document.title = `${whole.scene}: ${$("date").value}`;
    shown.rows = whole.rows.map((row) => Object.fromEntries(row.map((value, n) => [whole.fields[n], value])));
    shown.remembered = whole.remembered;
    shown.clips = whole.clips;
    learnNames(whole.names);
    layLabels(whole.labels);
    show();
  } catch { put($("sum"), "The dashboard does not answer."); }
}
function clear() { shown.rows = []; $("rows").replaceChildren(); $("strip").replaceChildren(); hide($("log"), true); hide($("more"), true); }
function layLabels(labels) {
  const chosen = $("label").value, known = [...$("label").options].slice(1).map((each) => each.value);
  if (JSON.stringify(known) === JSON.stringify(labels)) return;
  $("label").replaceChildren(new Option("everything", ""), ...labels.map((label) => new Option(whatIs({ kind: label === "fallen" ? "fall" : "", label }), label)));
  $("label").value = labels.includes(chosen) ? chosen : "";
}
const whatIs = (row) => row.kind === "fall" ? "falls" : row.label === "abstain" ? "no agreement" : words(row.label);
function what(row) {
  if (row.kind === "fall") return `${row.person ? nameOf(row.person) : "Somebody"} ${row.ended === null ? "has fallen" : "fell, up again"}`;
  const label = (row.revises ? `${words(row.revises)} → ` : "") + whatIs(row);
  return ofPerson(row) + (row.repetitions ? `${label}, ${count(row.repetitions, "time")}` : label) + scoreWords(row);
}
function show() {
  const label = $("label").value, rows = shown.rows.filter((row) => !label || row.label === label);
  const falls = rows.filter((row) => row.kind === "fall").length, moves = rows.length - falls;
  put($("sum"), rows.length ? [count(moves, "movement"), ...(falls ? [count(falls, "fall")] : [])].join(", ") : "Nothing was kept of this day.");
  hide($("log"), rows.length === 0);
  $("rows").replaceChildren(...rows.slice(0, shown.number).map(line));
  hide($("more"), rows.length <= shown.number);
  strip(rows);
}
function line(row) {
  const node = make("tr", "entry"), cell = (name, ...content) => make("td", name, ...content);
  const correction = row.corrected === null ? [] : [make("span", "quiet", ` was ${row.corrected ? words(row.corrected) : "something else"}`)];
  const sure = row.p === null ? [] : [make("span", "quiet", ` ${percent(row.p)}`)];
  const acts = cell("acts"), ago = Date.now() - row.began;
  node.classList.toggle("abstain", row.label === "abstain");
  for (const [observer, word] of shown.clips[row.id] || []) {
    const clip = make("a", "wrong", shown.clips[row.id].length > 1 ? `Clip ${observer}` : "Clip");
    clip.href = `history/clip/${encodeURIComponent(observer)}/${encodeURIComponent(word)}`;
    clip.download = "";
    acts.append(clip, " ");
  }
  if (row.kind === "verdict" && ago >= 0 && ago < shown.remembered) {
    const wrong = make("a", "wrong", "Wrong?");
    wrong.href = `teach?wrong=${encodeURIComponent(row.id)}`;
    acts.append(wrong);
  }
  node.append(cell("time", clock(row.began)), cell("label", make("b", row.kind === "fall" ? "fell" : "", what(row)), ...sure, ...correction),
    cell("took", row.ended === null ? "" : age((row.ended - row.began) / 1000)), cell("agree", agree([row.agree, row.of])), acts);
  return node;
}
/* A mark at the minute of the day at which each began; the width of a day of 23 or 25 hours is that of its hours. */
function strip(rows) {
  const [begin, end] = span(), minutes = (end - begin) / MINUTE_MS, marks = [];
  for (let hour = 0; hour <= 24; hour += 6) marks.push(draw("line", { x1: 60 * hour, x2: 60 * hour, y1: 4, y2: 70, class: "axis" }));
  for (const row of [...rows].reverse()) {
    const x = (row.began - begin) / MINUTE_MS / minutes * 1440, kind = row.kind === "fall" ? "fell" : row.label === "abstain" ? "none" : "belief";
    const top = kind === "fell" ? 4 : 22;
    marks.push(draw("rect", { x: x - 2, y: top, width: 4, height: 70 - top, class: `at ${kind}` }));
  }
  $("strip").replaceChildren(...marks);
}
function move(days) {
  const [begin] = span();
  begin.setDate(begin.getDate() + days);
  $("date").value = written(begin);
  shown.number = PAGE;
  load();
}
$("before").addEventListener("click", () => move(-1));
$("after").addEventListener("click", () => move(1));
$("date").addEventListener("change", () => { shown.number = PAGE; load(); });
$("label").addEventListener("change", () => { shown.number = PAGE; show(); });
$("more").addEventListener("click", () => { shown.number += PAGE; show(); });
const theme = stored("theme");
if (theme && theme !== "auto") document.documentElement.dataset.theme = theme;
$("date").value = written(new Date());
load();
setInterval(() => { if (!document.hidden && $("date").value === written(new Date())) load(); }, AGAIN_MS);
