// The counter: how often the newest repeated movement has been done; a target and a reset that this browser keeps. The number
// is large for an exercise: with a target, or while nothing else is done and it was done IN_A_ROW times, as repeated takes are.
import { $, hide, mark, put, store, stored } from "./elements.js";
import { words } from "./words.js";

const IN_A_ROW = 3;
let seen = new Map(), label = null, base = 0, reached = 0, latest = [[], null, () => {}];

export function clearCounter() { seen = new Map(); label = null; base = reached = 0; }
/* What is in progress counts live, what has ended by its verdict; a movement that is not the newest has its own count. */
export function showCounter(verdicts, state, announce) {
  latest = [verdicts, state, announce];
  const moves = verdicts.filter((each) => !each.abstain).map((each) => each.count).reverse();
  if (state.count && !state.silent) moves.push(state.count);
  const counted = moves.filter(Boolean);
  hide($("counter"), counted.length === 0);
  if (!counted.length) return;
  const newest = counted[counted.length - 1];
  if (newest.label !== label) { label = newest.label; base = reached = 0; seen = new Map(); }
  for (const each of counted) if (each.label === label) seen.set(each.id, each);
  const all = [...seen.values()], done = total(all, "done") - base, partial = Math.min(total(all, "partial"), done);
  const target = Number($("target").value) || 0, complete = target > 0 && done > 0 && done % target === 0;
  put($("counter-title"), words(label));
  put($("counted"), String(target && done ? (done - 1) % target + 1 : done));
  const sets = target ? Math.floor(done / target) : 0, set = sets + !complete;
  const times = target ? `of ${target}${set > 1 ? `, set ${set}` : ""}` : done === 1 ? "time" : "times";
  put($("counted-words"), times + (partial > 0 ? `, ${partial} partial` : ""));
  const exercised = target > 0 || (newest === moves[moves.length - 1] && all.some((each) => each.done >= IN_A_ROW));
  mark($("counter"), "size", exercised ? "large" : "small");
  mark($("counter"), "kind", complete ? "complete" : "open");
  if (sets > reached) announce(`${words(label)}: target reached`);
  reached = sets;
}
const total = (all, field) => all.reduce((sum, each) => sum + each[field], 0);
$("target").value = stored("target");
$("target").addEventListener("change", () => { store("target", $("target").value); showAgain(); });
$("reset").addEventListener("click", () => { base = total([...seen.values()], "done"); for (const each of seen.values()) each.partial = 0; showAgain(); });
function showAgain() { reached = 0; if (latest[1]) showCounter(...latest); }
