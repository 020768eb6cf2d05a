// The verdict that was decided last, and the list of verdicts: each with its reasons, and the way to correct it.
import { $, attribute, command, hide, keep, make, mark, part, put } from "./elements.js";
import { age, agree, agreementWords, bits, clock, labelWords, percent, scoreWords, seenBy, took, verdictWords, when, words } from "./words.js";

const ROWS_SHOWN = 6, LONG_WORD = 14;
const rows = new Map();

export function showLast(last, state) {
  mark($("last"), "kind", !last ? "none" : last.abstain ? "abstain" : last.ended === null ? "open" : "ended");
  put($("verdict"), last ? labelWords(last) : "nothing yet");
  $("verdict").classList.toggle("long", Boolean(last) && last.label.length > LONG_WORD);
  put($("when"), last ? when(last, state) : "");
  put($("corrected"), last && last.revises !== null ? `corrected from ${words(last.revises)}` : "");
  put($("seen"), last ? seenBy(last) : "");
  put($("agreed"), last ? agreementWords(last, state) : "");
  // A judgement of a moment ago may come after the verdict on the same movement.
  const undecided = state.why && !state.silent && last?.ended !== null;
  put($("undecided"), undecided ? `no verdict yet: ${words(state.why)}` : "");
}

/* The list: a row for each verdict, and below it, on request, its reasons. */
export function showList(setup, verdicts, fresh) {
  hide($("empty"), verdicts.length > 0);
  hide($("log"), verdicts.length === 0);
  const all = $("more").getAttribute("aria-expanded") === "true", shown = all ? verdicts : verdicts.slice(0, ROWS_SHOWN);
  hide($("more"), verdicts.length <= ROWS_SHOWN);
  put($("more"), all ? "Show fewer" : `Show all ${verdicts.length}`);
  keep($("verdicts"), shown.flatMap((each) => showRow(setup, each)));
  const ids = new Set(verdicts.map((each) => each.id));
  for (const id of rows.keys()) if (!ids.has(id)) rows.delete(id);
  if (fresh && rows.has(fresh.id)) rows.get(fresh.id).node.classList.add("fresh");
}
function row(setup, verdict) {
  const cells = ["time", "label", "took", "agree", "acts"].map((name) => make("td", name));
  const node = make("tr", "entry", ...cells), why = make("button", "", "Why?"), reasons = make("tr", "why", make("td"));
  reasons.firstChild.colSpan = cells.length;
  reasons.hidden = true;
  reasons.id = `why-${row.count = (row.count || 0) + 1}`;
  why.type = "button";
  attribute(why, "aria-controls", reasons.id);
  const entry = { node, cells, why, reasons, verdict, wrong: wrongOf(setup, verdict, () => open(entry, "wrong")), opened: "" };
  why.addEventListener("click", () => open(entry, "why"));
  cells[4].append(why, ...(entry.wrong ? [entry.wrong] : []));
  open(entry, "");
  return entry;
}
/* Corrections are made on the Teach page; where there is none, a line says how to get it. Of a capture nothing is learned. */
function wrongOf(setup, verdict, explain) {
  if (setup.span !== null) return null;
  const node = make(setup.teaches ? "a" : "button", "wrong", "Wrong?");
  if (setup.teaches) node.href = `teach?wrong=${encodeURIComponent(verdict.id)}`;
  else { node.type = "button"; node.addEventListener("click", explain); }
  return node;
}
function open(entry, what) {
  entry.opened = entry.opened === what ? "" : what;
  entry.reasons.hidden = entry.opened === "";
  attribute(entry.why, "aria-expanded", entry.opened === "why");
  if (entry.wrong && entry.wrong.type === "button") attribute(entry.wrong, "aria-expanded", entry.opened === "wrong");
  showReasons(entry);
}
function showRow(setup, verdict) {
  if (!rows.has(verdict.id)) rows.set(verdict.id, row(setup, verdict));
  const entry = rows.get(verdict.id), { cells } = entry, changed = entry.verdict !== verdict || entry.setup !== setup;
  Object.assign(entry, { verdict, setup });
  entry.node.classList.toggle("abstain", verdict.abstain);
  [clock(verdict.began), verdictWords(verdict) + scoreWords(verdict), took(verdict), agree(verdict.agreement)].forEach((value, i) => put(cells[i], value));
  attribute(entry.why, "aria-label", `Why? ${labelWords(verdict)} at ${clock(verdict.began)}`);
  if (entry.wrong) attribute(entry.wrong, "aria-label", `Wrong? ${labelWords(verdict)} at ${clock(verdict.began)}`);
  if (changed) showReasons(entry);
  return [entry.node, entry.reasons];
}
function showReasons({ reasons, verdict, opened, setup }) {
  if (opened === "why") reasons.firstChild.replaceChildren(...reasonsOf(verdict));
  else if (opened === "wrong") reasons.firstChild.replaceChildren(make("p", "", "To correct verdicts, and to teach, start the page with:"), command(`labanmesh dashboard ${setup.file} --teach`));
}
function reasonsOf(verdict) {
  const sums = verdict.fused.map(([label, p]) => `${words(label)} ${percent(p)}`).join(", ");
  const how = verdict.facets.filter((facet) => facet[4] !== "neither").map((facet) => `${facet[4]} ${percent(facet[5])}`);
  if (verdict.facing) how.push(`facing ${verdict.facing[1]}`);
  const sentences = [...verdict.why, ...(sums ? [`Together, when it was decided: ${sums}; entropy ${bits(verdict.entropy)}, by the rule ${verdict.rule}.`] : []), ...(how.length ? [`How it was done: ${how.join(", ")}.`] : [])];
  return [make("ul", "", ...sentences.map((sentence) => make("li", "", sentence))), votesOf(verdict)];
}
/* The log odds that each observer added to the verdict, and the likeliest answer without it. */
function votesOf(verdict) {
  const contributed = verdict.votes.some((vote) => vote.gave !== null);
  const gave = (vote) => [
    make("td", "gave", vote.gave === null ? "-" : `${vote.gave < 0 ? "" : "+"}${vote.gave.toFixed(2)} nat`.replace("-", "−")),
    make("td", vote.stands === false ? "needed" : "", vote.stands === null ? "-" : vote.stands ? "the same" : "another")];
  const titles = ["Judge", "Held", "Entropy", "Weight", "Age", ...(contributed ? ["Contributed", "Without it"] : []), "Result"];
  const head = make("tr", "", ...titles.map((title) => heading(title, "col")));
  const votes = verdict.votes.map((vote) => {
    const end = make("td", "", make("span", "stance", words(vote.stance)));
    end.dataset.stance = vote.stance === "agreed" ? "agrees" : vote.stance.startsWith("held ") ? "differs" : vote.stance;
    const figures = [vote.label === null ? "-" : words(vote.label), bits(vote.entropy), percent(vote.weight), age(vote.age)];
    return make("tr", "", heading(vote.name, "row"), ...figures.map((figure) => make("td", "", figure)), ...(contributed ? gave(vote) : []), end);
  });
  return make("table", contributed ? "votes contributed" : "votes", make("thead", "", head), make("tbody", "", ...votes));
}
function heading(text, scope) {
  const node = make("th", "", text);
  node.scope = scope;
  return node;
}
