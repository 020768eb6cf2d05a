// What the page says about a scene. An observer is shown to people as a judge, and fusion as the referee.
import { store, stored } from "./elements.js";

const SLOW_CLOCK_S = 0.5, NAMES_LIMIT = 6;

export const percent = (value) => `${Math.round(value * 100)}%`;
export const bits = (value) => value === null ? "-" : `${value.toFixed(2)} bit`;
export const words = (label) => label.replaceAll("_", " ");
export const count = (number, noun) => `${number} ${noun}${number === 1 ? "" : "s"}`;
export const clock = (ms) => new Date(ms).toLocaleTimeString([], { hourCycle: "h23" });
export const agree = (pair) => pair ? `${pair[0]} of ${pair[1]}` : "-";
export function age(seconds) {
  if (seconds === null) return "-";
  if (seconds < 1) return `${Math.round(seconds * 1000)} ms`;
  return seconds < 120 ? `${seconds.toFixed(1)} s` : `${Math.round(seconds / 60)} min`;
}
function listed(names) {
  const shown = names.length > NAMES_LIMIT ? [...names.slice(0, NAMES_LIMIT), `${names.length - NAMES_LIMIT} more`] : names;
  return shown.length < 2 ? shown.join("") : `${shown.slice(0, -1).join(", ")} and ${shown[shown.length - 1]}`;
}

/* Verdicts. */
/* One of several people, by the name that they were given: for everybody who looks, or in this browser. */
let names = {};
export function learnNames(given = {}) {
  const changed = JSON.stringify(given) !== JSON.stringify(names);
  names = given;
  return changed;
}
/* Names that are on their way to the service. */
const sent = {};
export async function giveName(person, name, send) {
  sent[person] = name || person;
  if (await send()) { store(`name-${person}`, ""); learnNames({ ...names, [person]: name }); } else store(`name-${person}`, name);
  delete sent[person];
}
export const nameOf = (person) => sent[person] || stored(`name-${person}`) || names[person] || person;
export const ofPerson = (verdict) => verdict.person ? `${nameOf(verdict.person)}: ` : "";
export const labelWords = (verdict) => ofPerson(verdict) + (verdict.abstain ? "no agreement" : words(verdict.label));
export const verdictWords = (verdict) => (verdict.revises === null ? "" : `${words(verdict.revises)} → `) + labelWords(verdict);
export const scoreWords = (verdict) => typeof verdict.score === "number" ? `, ${verdict.score.toFixed(1)} of 10` : "";
export const took = (verdict) => verdict.ended === null ? "now" : age((verdict.ended - verdict.began) / 1000);
export function when(verdict, state) {
  const at = verdict.ended ?? verdict.decided, ago = Math.max(0, Math.round((state.now - at) / 1000));
  if (verdict.ended === null && !state.silent && !state.waiting) return "now";
  return ago < 100 ? `${ago} s ago` : `at ${clock(at)}`;
}
export function seenBy(verdict) {
  const names = verdict.votes.filter((vote) => vote.stance === "agreed").map((vote) => vote.name);
  return names.length && !verdict.abstain ? `Seen by ${listed(names)}` : "";
}
/* How many agreed at the decision, and how many hold what now: two things that are easily taken for one. */
export function agreementWords(verdict, state) {
  const then = verdict.abstain ? `at most ${agree(verdict.agreement)} agreed` : `${agree(verdict.agreement)} agreed when it was decided`;
  const now = nowWords(state, verdict.ended === null);
  return now ? `${then}; ${now}` : then;
}
export function nowWords(state, goesOn = false) {
  if (!state.judged || state.silent || state.waiting || state.label === null) return "";
  return state.moving || goesOn ? `now ${agree(state.agreement)} say ${words(state.label)}` : "now at rest";
}

/* Judges. "agrees" is what the judgement counts as its k of n; a stale observer is still heard. */
export function stance(observer) {
  if (observer.gone) return "gone";
  if (!observer.heard) return observer.state;
  return observer.label === null ? "undecided" : observer.agrees ? "agrees" : "differs";
}
const isStale = (observer) => observer.state === "stale" && !observer.gone;
export const stanceWords = (observer) => (observer.sees_nobody && !observer.gone ? "sees nobody" : stance(observer) + (isStale(observer) ? ", stale" : ""));
/* Its colour; at rest no opinion is nothing unusual. */
export function tone(observer, moving = true) {
  const kind = observer.gone ? "silent" : isStale(observer) ? "stale" : stance(observer);
  return kind === "undecided" && !moving ? "rests" : kind;
}
const STATES = { silent: "is not heard", late: "late", foreign: "knows other movements", invalid: "sends what cannot be read" };
/* What a judge sees and how sure it is. sure: the probability that a verdict needs. */
export function sight(observer, { moving }, sure) {
  if (observer.gone) return "does not run";
  if (!observer.heard) return STATES[observer.state] || observer.state;
  if (observer.sees_nobody) return "sees nobody";
  if (isStale(observer)) return observer.label === null ? "late" : `${words(observer.label)}, late`;
  if (observer.label === null) return moving ? "not sure" : "sees no movement";
  return `${words(observer.label)}, ${observer.ranked.length && observer.ranked[0][1] >= sure ? "sure" : "not sure"}`;
}
/* What is wrong with a judge, in words; "" if all is well. */
export function trouble(observer) {
  const clockOff = observer.skew !== null && Math.abs(observer.skew) >= SLOW_CLOCK_S ? `its clock is ${age(Math.abs(observer.skew))} ${observer.skew > 0 ? "ahead" : "behind"}` : "";
  const rejected = observer.same_id ? "two processes have this id" : observer.rejected ? count(observer.rejected, "bad message") : "";
  const lies = observer.contradicted === null ? "" : `the others contradict it: ${percent(observer.contradicted)} trusted`;
  const doubted = observer.rest_contradicted ?? null;
  const aboutRest = doubted === null ? "" : `its rest contradicts the others: ${percent(doubted)} trusted`;
  const ill = observer.health && !observer.gone && observer.health.state !== "running";
  return [ill ? observer.health.reason || observer.health.state : "", clockOff, lies, aboutRest, rejected].filter(Boolean).join(", ");
}
export function processWords(observer) {
  if (!observer.health) return "";
  return [observer.health.state, observer.health.rate === null ? "" : `${observer.health.rate} Hz`].filter(Boolean).join(", ");
}

/* What to do next: [sentence, command], or null if all is well. */
export function advice(setup, state) {
  if (setup.span !== null) return null;
  const { observers } = state, gone = observers.filter((each) => each.gone), runs = observers.some((each) => each.present);
  const verb = (name, ...more) => ["labanmesh", name, setup.file, ...more].join(" ");
  const up = verb("up"), doctor = verb("doctor"), all = (kind) => observers.every((each) => each.gone || each.state === kind);
  const blind = observers.find((each) => setup.phones.includes(each.name) && each.present && !each.heard && each.health?.state === "degraded");
  if (blind) return [`${blind.name} waits for its phone. "Use a phone" shows the code; this has to run:`, verb("phone", blind.name)];
  // A scene may watch for falls before anybody has taught it a movement.
  if (!state.judged && state.fall) return null;
  if (!state.judged) return runs ? ["Judges run, and no referee is heard. Start it:", verb("fuse")] : ["Nothing runs here yet. Start it:", up];
  if (state.silent && !runs) return ["Nothing is heard any more. Start it again:", up];
  if (state.silent) return ["The referee has fallen silent. If it does not come back, start it:", verb("fuse")];
  if (gone.length === observers.length && gone.length) return ["No judge runs. Start them:", up];
  if (state.waiting && all("late")) return ["All judges are late: their machines are too busy, or their clocks or the network are wrong. Ask which:", doctor];
  if (state.waiting && all("silent")) return runs ? ["No judge is heard. Ask what is wrong:", doctor] : ["No judge is heard. If none runs, start them:", up];
  if (state.waiting) return ["No judge counts now; their lines say why. Ask what to do:", doctor];
  if (gone.length) return [`${listed(gone.map((each) => each.name))} ${gone.length === 1 ? "does" : "do"} not run. Start ${gone.length === 1 ? "it" : "the first"} again:`, verb("observe", gone[0].name)];
  const ill = observers.find((each) => each.health && (each.health.state === "failed" || (each.health.state === "degraded" && !each.heard)));
  return ill ? [`${ill.name}: ${trouble(ill)}. Ask what to do:`, doctor] : null;
}
