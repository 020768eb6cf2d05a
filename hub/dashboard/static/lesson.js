/* A lesson on a page: a stage with one thing, buttons for what can be done now, the course of it, sounds. The Teach page
   and the page of a phone that is a camera show the same. All words of others are text, never markup. */
import { $, button, make, part, put } from "./elements.js";
import { count, words } from "./words.js";

const AFTER = ["kept", "failed", "between"];
export const TAKING = ["waiting", "countdown", "now", ...AFTER];
let state = null, acts = null, sound = null, heard = "";

export const capital = (text) => text.charAt(0).toUpperCase() + text.slice(1);
export const listed = (labels) => labels.map(words).join(", ");
function minutes(seconds) {
  const whole = Math.max(0, Math.round(seconds));
  return whole < 60 ? `${whole} s` : `${Math.floor(whole / 60)}:${String(whole % 60).padStart(2, "0")} min`;
}

/* A lesson: a stage with one thing, buttons for what can be done now. */
const STAGES = {
  look: (lesson) => lesson.purpose === "forget" ? [make("div", "spin"), ...stage("", "The cameras forget", "They remove it, and learn anew from what is left.")]
    : lesson.purpose === "correct" ? [make("div", "spin"), ...stage("", "The cameras look", "Each cuts it out of what it remembers.")] : stage("", "One moment", "Looking for the cameras."),
  examples: (lesson) => stage("", lesson.examples.length === 1 ? `Is this ${words(lesson.examples[0].label)}?` : "Is it these?", "The cameras have cut out what moved nearest to that time. The lines show the way of the hands, green the right one and blue the left."),
  ready: (lesson, step) => step.label
    ? stage("", words(step.label), step.number ? `${step.number} of ${step.of} takes are done.` : "", `After 3, 2, 1 do it once, then stand still. ${count(step.of - step.number, "time")} in all. Put the phone where you see it, and stand where the cameras see head and hands.`)
    : stage("", "Ordinary life", `For ${minutes(step.left_s)} do whatever you like except the movements: sit down, walk through, reach for things, scratch your head. It learns what is no movement.`),
  countdown: (lesson, step) => [which(step), make("p", "number", String(Math.round(step.left_s))), make("p", "title-line", words(step.label))],
  now: (lesson, step) => [which(step), make("p", "title-line", isMoving() ? "…" : "Now!"), make("p", "under", isMoving() ? "then stand still" : step.is_test ? `do it: ${words(step.label)}` : `${words(step.label)}, then stand still`)],
  waiting: (lesson, step) => [which(step), make("p", "title-line", step.how === "clap" ? "Clap once" : "Stand still"), make("p", "under", step.how === "clap" ? "with both hands in front of you: then it counts down" : "where a camera sees head and hands: then it counts down")],
  between: (lesson, step) => step.is_test ? [which(step), make("p", "title-line", step.kind === "kept" ? "Recognised" : "Not recognised")] : afterTake(lesson, step),
  doubt: (lesson, step) => stage("", `${words(step.label)}: one take looks odd`, "It looks more like another movement; the lines below say which one. Is it worth another take?"),
  alarms: (lesson, step) => stage("", step.number ? count(step.number, "false alarm") : "No false alarm yet", "Do anything but the movements. Whatever it recognises now is a false alarm.", `${minutes(step.left_s)} to go`),
  review: (lesson, step) => stage("", `${words(step.label)}: ${count(step.number, "take")}`, acts.review),
  other: (lesson, step) => {
    const bar = make("progress");
    bar.max = Math.max(1, step.of); bar.value = step.of - step.left_s;
    bar.setAttribute("aria-label", "Ordinary life");
    return [...stage("", "Ordinary life", "Sit, walk, reach for things; none of the movements."), bar, make("p", "which", `${minutes(step.left_s)} to go`)];
  },
  learning: () => [make("div", "spin"), ...stage("", "The cameras learn", "Each on its own machine. You can put the phone away."), learners()],
  learned: (lesson) => [...stage("", "They have learned", "Recognised of your own takes, each left out of the learning:"), wordsOf(lesson.results)],
  adopting: () => [make("div", "spin"), ...stage("", "All change together", "A few seconds.")],
  test: (lesson) => stage("", "Now a test", `Do each movement once more: ${listed(lesson.labels)}. You see what it says.`),
  done: (lesson) => overStage(lesson),
};
STAGES.kept = STAGES.failed = STAGES.between;
function afterTake(lesson, step) {
  const good = lastTake(step.label);
  return [which(step), make("p", "title-line", good ? "Got it" : "Not usable"), make("p", "under", good || `${whyNot(step.label)}. Once more.`), make("div", "ways", ...acts.ways(lesson, keptTakes(step.label)))];
}
function stage(over, title, ...under) {
  return [...(over ? [make("p", "which", over)] : []), make("p", "title-line", title), ...under.filter(Boolean).map((line) => make("p", "under", line))];
}
const which = (step) => make("p", "which", step.is_test ? "test" : `${words(step.label)}: ${step.number} of ${step.of}`);
const wordsOf = (lines) => make("ul", "words", ...lines.map((line) => make("li", "", line)));
const isMoving = () => state.observers.some((each) => each.take && each.take.state === "moving");
const keptTakes = (label) => state.observers.filter((each) => each.take && each.take.label === label && each.take.state === "kept");
const lastTake = (label) => keptTakes(label).map((each) => `${each.name} ${each.take.seconds} s`).join(", ");
function whyNot(label) {
  const failed = state.observers.find((each) => each.take && each.take.label === label && each.take.fault);
  return failed ? capital(failed.take.fault) : "No camera kept it";
}
function learners() {
  return make("ul", "", ...state.observers.filter((each) => each.state !== undefined).map((each) => {
    const node = make("li", "learner", make("span", "", each.name), make("b", "", each.learned ? "has learned" : each.fault ? "cannot learn" : each.state === "learning" ? "learns …" : "waits"));
    node.toggleAttribute("data-done", Boolean(each.learned));
    node.toggleAttribute("data-bad", Boolean(each.fault) && !each.learned);
    return node;
  }));
}
function overStage(lesson) {
  const lines = lesson.done.length ? [wordsOf(lesson.done)] : [];
  if (lesson.purpose === "forget") return [...stage("", lesson.fault ? "Not all is forgotten" : "Forgotten", lesson.fault ? `${capital(lesson.fault)}.` : knows()), ...lines];
  if (lesson.purpose === "correct") return [...stage("", lesson.stopped ? "Stopped" : lesson.fault ? "Nothing was learned" : "Corrected", lesson.stopped ? "Nothing was learned." : lesson.fault ? `${capital(lesson.fault)}.` : "The cameras have learned from it."), ...lines];
  if (lesson.fault) return stage("", lesson.stopped ? "Stopped" : "It cannot go on", `${capital(lesson.fault)}.`);
  if (!lesson.adopted) return stage("", "Nothing has changed", "It goes on with what it knew. The takes are kept.");
  return [...stage("", "Done", `It recognises ${listed(state.known)}.`), ...(lesson.test.length ? [wordsOf(lesson.test)] : [])];
}
const knows = () => state.known.length ? `It recognises ${listed(state.known)}.` : "It knows no movement now.";
/* Shows the lesson of `newState`, and returns its step. page: {press(action), start(plan), stop(id), ways(lesson, observers):
   pictures of a take, review: what to do after a movement, next: the words for what follows a lesson}. */
export function showLesson(newState, page) {
  [state, acts] = [newState, page];
  const lesson = state.lesson;
  const step = lesson.over ? { kind: "done", label: "", number: 0, of: 0, left_s: 0, is_test: false } : lesson.step;
  const built = STAGES[step.kind] || STAGES.look;
  // The lesson tells what became of a take, and then waits a little: on the page that is one thing.
  if (AFTER.includes(step.kind) && !step.is_test) step.kind = "between";
  $("stage").dataset.kind = step.kind;
  const seen = step.kind === "learning" ? state.observers.map((each) => [each.state, each.fault, Boolean(each.learned)])
    : step.kind === "now" ? isMoving() : AFTER.includes(step.kind) ? [lastTake(step.label), whyNot(step.label)] : null;
  part($("stage"), [lesson.id, step.kind === "learning" ? { ...step, left_s: 0 } : step, seen, lesson.over, lesson.results, lesson.test, lesson.examples, lesson.over && lesson.done, state.known], () => built(lesson, step));
  showCourse(lesson, step);
  part($("buttons"), [lesson.id, lesson.over, lesson.fault, step.kind, step.label, step.number, step.of, lesson.waits, lesson.number * lesson.waits], () => buttons(lesson, step));
  const news = lesson.over && lesson.purpose !== "lesson" ? [] : lesson.news;
  part($("news"), news, () => news.map((line) => make("li", "", line)));
  signal(lesson, step);
  return step;
}
function buttons(lesson, step) {
  const own = lesson.purpose !== "lesson";
  if (lesson.over) return [
    ...((lesson.fault || !lesson.adopted) && !own ? [button("Go on with it", () => acts.start({ labels: lesson.labels, add: lesson.add, takes: lesson.takes, minutes: lesson.minutes, person: lesson.person, seconds: lesson.seconds, begin: lesson.begin, alarm_minutes: lesson.alarm_minutes }), "main")] : []),
    button(own ? "Back" : lesson.fault ? "Choose other movements" : acts.next, () => acts.stop(lesson.id), !own && (lesson.fault || !lesson.adopted) ? "second" : "main")];
  const following = lesson.labels[lesson.labels.indexOf(step.label) + 1];
  if (lesson.waits) switch (step.kind) {
    case "ready": return step.label ? [button("Start", () => acts.press("go"), "main")]
      : [button("Start", () => acts.press("go"), "main"), button("Leave it out", () => acts.press("skip"), "second")];
    case "review": return [button(following ? `Next: ${words(following)}` : "Go on", () => acts.press("go"), "main"), button("One more take", () => acts.press("more"), "second")];
    case "examples": return [button(lesson.examples.length === 1 ? "Yes, learn from it" : "Yes, learn from them", () => acts.press("go"), "main")];
    case "learned": return [button("Use it", () => acts.press("go"), "main"), button("Not yet", () => acts.press("skip"), "second")];
    case "test": return [button("Start the test", () => acts.press("go"), "main"), button("Leave it out", () => acts.press("skip"), "second")];
  }
  if (step.kind === "other") return [button("That is enough", () => acts.press("skip"), "second")];
  if (step.kind === "alarms") return [button("That is enough", () => acts.press("skip"), "second")];
  if (step.kind === "waiting") return [button("Begin now", () => acts.press("begin"), "main")];
  if (step.kind === "doubt") return [button("Make it again", () => acts.press("repeat"), "main")];
  if (TAKING.includes(step.kind) && !step.is_test) return [
    ...(step.kind === "between" && lastTake(step.label) ? [button("Make it again", () => acts.press("repeat"), "second")] : []),
    button("Wait after this take", async (event) => { const node = event.currentTarget; if (await acts.press("pause")) { node.textContent = "It will wait"; node.disabled = true; } }, "second")];
  return [];
}
function showCourse(lesson, step) {
  const parts = [...lesson.labels, "other", "learn", "test"];
  const at = lesson.over ? (lesson.fault ? -1 : parts.length) : step.is_test || ["test", "alarms"].includes(step.kind) ? parts.length - 1
    : ["learning", "learned", "adopting"].includes(step.kind) ? parts.length - 2 : step.kind === "other" || (step.kind === "ready" && !step.label) ? parts.length - 3 : lesson.labels.indexOf(step.label);
  part($("course"), [parts, at], () => parts.map((each, i) => {
    const item = make("li", "", make("span", "unseen", `${words(each)}${i < at ? ": done" : i === at ? ": now" : ""}`));
    item.dataset.state = i < at ? "done" : i === at ? "now" : "later";
    return item;
  }));
}

/* Sound, once the page has been touched: a beep for each second, a higher one for now, and one when the take is kept. */
export function listen() {
  if (sound === null && window.AudioContext) sound = new AudioContext();
  if (sound && sound.state === "suspended") sound.resume();
}
function beep(hertz, seconds) {
  if (!sound || sound.state !== "running") return;
  const tone = sound.createOscillator(), volume = sound.createGain();
  tone.frequency.value = hertz;
  volume.gain.setValueAtTime(0.3, sound.currentTime);
  volume.gain.exponentialRampToValueAtTime(0.001, sound.currentTime + seconds);
  tone.connect(volume).connect(sound.destination);
  tone.start();
  tone.stop(sound.currentTime + seconds);
}
function signal(lesson, step) {
  const what = `${lesson.id} ${step.kind} ${step.label} ${step.number} ${step.kind === "countdown" ? step.left_s : ""} ${lesson.over}`;
  if (what === heard) return;
  heard = what;
  if (step.kind === "countdown") beep(520, 0.12);
  if (step.kind === "now") { beep(1040, 0.5); if (navigator.vibrate) navigator.vibrate(200); }
  if (step.kind === "between" || step.kind === "learned") beep(780, 0.2);
  const spoken = step.kind === "now" ? "Now" : step.kind === "between" ? (lastTake(step.label) ? "Got it" : "Not usable") : lesson.waits || lesson.over ? $("stage").textContent : "";
  put($("announcement"), spoken);
}

